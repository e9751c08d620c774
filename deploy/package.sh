#!/usr/bin/env bash
# Makes the Debian packages: installs what is missing, configures, builds, packs.
source "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
usage() {
  cat <<'H'
usage: deploy/package.sh [--no-install] [--out DIR]
  --no-install   do not call apt; fail if something is missing
  --out DIR      where the packages go (default: packages)
then, on the machines that use them:
  apt-get install ./telenano-common_*.deb ./telenano-server_*.deb     a server
  apt-get install ./telenano-station_*.deb                            a station
H
}
parse_common_flags "$@"
out=$project/packages
while [ ${#rest[@]} -gt 0 ]; do
  case ${rest[0]} in
    --out) [ ${#rest[@]} -ge 2 ] || { usage >&2; exit 2; }; out=$(realpath -m "${rest[1]}"); rest=("${rest[@]:2}") ;;
    *) printf 'error: unknown argument %s\n' "${rest[0]}" >&2; usage >&2; exit 2 ;;
  esac
done
[ "$install" = no ] || install_missing "${build_packages[@]}" dpkg-dev file
configure_and_build programs
say "Packing"
mkdir -p "$out"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
(cd "$project/build/release" && cpack -B "$out") >"$log" 2>&1 || { tail -n 20 "$log" >&2; die "cpack failed"; }
rm -rf "$out/_CPack_Packages"
ls "$out"/*.deb
