# Shared by deploy/*.sh: installs what is missing, configures, builds. Sourced, not run.
set -euo pipefail
project=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
jobs=${TELENANO_JOBS:-$(nproc)}

say() { if [ -t 2 ]; then printf '\033[1m== %s\033[0m\n' "$*" >&2; else printf '== %s\n' "$*" >&2; fi; }
die() { printf 'error: %s\n' "$1" >&2; exit "${2:-1}"; }

# Packages of Debian 12 and 13: what the build needs, what the plots and tests need. Only missing ones are installed.
build_packages=(g++ cmake ninja-build pkg-config git ca-certificates libboost-dev libprotobuf-dev protobuf-compiler
  libeigen3-dev libhdf5-dev zlib1g-dev libssl-dev libsystemd-dev libtomlplusplus-dev libcli11-dev libspdlog-dev libfmt-dev nlohmann-json3-dev libhidapi-dev libgtest-dev libgmock-dev libbenchmark-dev
  prometheus-cpp-dev gnuplot-nox libglfw3-dev libimgui-dev libstb-dev libepoxy-dev libgl-dev libegl-dev libgl1-mesa-dri fonts-dejavu-core)
test_packages=(python3 python3-h5py python3-protobuf python3-yaml xvfb xauth x11-xserver-utils xdotool dpkg-dev file strace)
# The layout is checked by one version alone, which Debian 12 has: elsewhere that test is skipped.
layout_packages=()
[[ ! -r /etc/os-release || $(</etc/os-release) != *VERSION_CODENAME=bookworm* ]] || layout_packages=(clang-format-14)

install_missing() {
  local missing=() p
  for p in "$@"; do
    dpkg-query -W -f='${Status}' "$p" 2>/dev/null | grep -q 'ok installed' || missing+=("$p")
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  say "Installing ${#missing[@]} Debian packages: ${missing[*]}"
  local as_root=()
  if [ "$(id -u)" != 0 ]; then
    command -v sudo >/dev/null || die "these packages are missing and there is no sudo; as root run: apt-get install ${missing[*]}" 2
    as_root=(sudo)
  fi
  "${as_root[@]}" apt-get update -qq
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
}

newest_clang() { # clang++ or clang-tidy: prints the command of its newest version that is installed, if that is 14 or later
  local found newest=13 command=
  for found in "$1" $(compgen -c -- "$1-"); do
    [[ $found =~ ^"$1"(-[0-9]+)?$ && $("$found" --version 2>/dev/null) =~ version\ ([0-9]+) ]] || continue
    if [ "${BASH_REMATCH[1]}" -gt "$newest" ]; then newest=${BASH_REMATCH[1]} command=$found; fi
  done
  [ -n "$command" ] && echo "$command"
}

configure_and_build() {
  cd "$project"
  say "Configuring (CMake preset release)"
  cmake --preset release ${TELENANO_WERROR:+"-DTELENANO_WERROR=$TELENANO_WERROR"} >build-configure.log 2>&1 || { tail -n 30 build-configure.log >&2; die "CMake failed; the whole output is in $project/build-configure.log"; }
  rm -f build-configure.log
  say "Building with $jobs jobs"
  cmake --build --preset release --parallel "$jobs" -- "$@"
}

parse_common_flags() { # sets install=yes|no, leaves the rest in rest[]
  install=yes; rest=()
  local a
  for a in "$@"; do
    case $a in
      --no-install) install=no ;;
      -h|--help) usage; exit 0 ;;
      *) rest+=("$a") ;;
    esac
  done
}
