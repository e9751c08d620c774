#!/usr/bin/env bash
# Makes a site to browse of all documents. Not part of the build; needs Debian's package mkdocs.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/../lib.sh"
usage() {
  cat <<'H'
usage: deploy/docs/build.sh [--out DIR]
  --out DIR   where the site goes (default: site); open DIR/index.html
H
}
out=$project/site
while [ $# -gt 0 ]; do
  case $1 in
    --out) [ $# -ge 2 ] || die "--out needs a folder; see --help" 2; out=$(realpath -m "$2"); shift 2 ;;
    -h|--help) usage; exit 0 ;;
    *) die "there is no option $1; see --help" 2 ;;
  esac
done
command -v mkdocs >/dev/null || die "mkdocs is missing: apt-get install mkdocs" 2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp "$project/deploy/docs/mkdocs.yml" "$work"
python3 -B "$project/deploy/docs/stage.py" "$project" "$work/documents"
mkdocs build --strict --clean --quiet --config-file "$work/mkdocs.yml" --site-dir "$out" || die "mkdocs failed"
say "Open $out/index.html"
