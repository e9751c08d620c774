#!/usr/bin/env bash
# Others' ways to the libraries: find_package after an install, add_subdirectory.
#   library_test.sh installed|subproject|subproject-built SOURCE BUILD
set -euo pipefail
how=$1 source=$2 build=$3
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { printf 'FAILED: %s\n' "$*" >&2; exit 1; }
quietly() { "$@" >"$work/log" 2>&1 || { tail -n 40 "$work/log" >&2; fail "$*"; }; }

case $how in
  installed)
    quietly cmake --install "$build" --component dev --prefix "$work/usr"
    # Nothing but what begins with telenano: `common/` in /usr/include would be anybody's.
    [ "$(ls "$work/usr/include")" = telenano ] || fail "include holds $(ls "$work/usr/include" | tr '\n' ' ')"
    # Nor does a header lean on one that is not there, or on the checkout.
    (cd "$work/usr/include" && grep -rhoE '^#include "[^"]+"' . | sort -u | sed -E 's/#include "(.*)"/\1/') >"$work/includes"
    while read -r header; do [ -f "$work/usr/include/$header" ] || fail "$header is included, and not installed"; done <"$work/includes"
    if grep -rqF -e "$source" "$work/usr/lib/cmake"; then fail "the package names $source"; fi
    quietly cmake -S "$source/deploy/examples" -B "$work/build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$work/usr"
    quietly cmake --build "$work/build" --parallel 2
    "$work/build/06_contact_law" >/dev/null
    "$work/build/01_force_curve" >/dev/null
    "$work/build/02_virtual_session" "$source/deploy/scenes/flat_pdms.toml"
    ;;
  subproject | subproject-built)
    mkdir "$work/project"
    cat >"$work/project/CMakeLists.txt" <<H
cmake_minimum_required(VERSION 3.25)
project(somebody_else LANGUAGES C CXX)
add_subdirectory($source telenano EXCLUDE_FROM_ALL)
add_subdirectory($source/deploy/examples examples)
foreach(program telenano-master telenano-nve telenano-lab unit_base)
  if(TARGET \${program})
    message(FATAL_ERROR "\${program} is a target of a project that only wanted the libraries")
  endif()
endforeach()
H
    quietly cmake -S "$work/project" -B "$work/build" -G Ninja -DCMAKE_BUILD_TYPE=Release
    if [ $how = subproject-built ]; then
      quietly cmake --build "$work/build" --parallel 2
      "$work/build/examples/06_contact_law" >/dev/null || "$work/build/bin/06_contact_law" >/dev/null
    else
      # What they need is named, and nothing of tests and windows.
      quietly cmake --build "$work/build" --parallel 2 -- -n
      ! grep -qE 'gtest|benchmark|viewer' "$work/log" || fail "a library needs tests or the window"
    fi
    ;;
  *) fail "'$how' is unknown" ;;
esac
echo "library_test $how: passed"
