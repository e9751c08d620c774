#!/usr/bin/env bash
# Makes the Debian packages: installs what is missing, configures, builds, packs.
source "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
usage() {
  cat <<'H'
usage: deploy/package.sh [--no-install] [--out DIR] [--only server|station|lab|dev ...]
  --no-install   do not call apt; fail if something is missing
  --out DIR      where the packages go (default: packages)
  --only NAME    builds and packs this one and what it needs; may be given again
then, on the machines that use them:
  apt-get install ./telenano-common_*.deb ./telenano-server_*.deb     a server
  apt-get install ./telenano-station_*.deb                            a station
  apt-get install ./telenano-dev_*.deb                                the libraries, for programs of one's own
H
}
parse_common_flags "$@"
out=$project/packages
components=()
while [ ${#rest[@]} -gt 0 ]; do
  case ${rest[0]} in
    --out) [ ${#rest[@]} -ge 2 ] || die "--out needs a folder; see --help" 2; out=$(realpath -m "${rest[1]}"); rest=("${rest[@]:2}") ;;
    --only)
      case ${rest[1]:-} in
        server|lab) components+=(common "${rest[1]}") ;;
        station|dev) components+=("${rest[1]}") ;;
        *) die "--only is '${rest[1]:-}', expected server, station, lab or dev" 2 ;;
      esac
      rest=("${rest[@]:2}") ;;
    *) die "there is no option ${rest[0]}; see --help" 2 ;;
  esac
done
[ "$install" = no ] || install_missing "${build_packages[@]}" dpkg-dev file
targets=(programs) only=()
if [ ${#components[@]} -gt 0 ]; then
  targets=()
  for c in "${components[@]}"; do [ "$c" = common ] || targets+=("programs-$c"); done
  only=(-D "CPACK_COMPONENTS_ALL=$(printf '%s\n' "${components[@]}" | sort -u | paste -sd ';')")
fi
configure_and_build "${targets[@]}"
say "Packing"
mkdir -p "$out"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
(cd "$project/build/release" && cpack -B "$out" "${only[@]}") >"$log" 2>&1 || { tail -n 20 "$log" >&2; die "cpack failed"; }
rm -rf "$out/_CPack_Packages"
ls "$out"/*.deb
