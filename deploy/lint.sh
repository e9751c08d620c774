#!/usr/bin/env bash
# Looks over the C++ sources: layout by clang-format, then bugs by clang-tidy (.clang-format, .clang-tidy).
source "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
usage() {
  cat <<'H'
usage: deploy/lint.sh [--no-install] [--format | --fix] [FILE.cpp ...]
  --no-install   do not call apt; exit 77 if the tools are missing
  --format       layout only, some seconds; also a test (ctest -R clang_format)
  --fix          lays the sources out anew instead of complaining
  FILE.cpp ...   clang-tidy over these only: the whole takes about 10 s of a processor for each file
exit: 0 nothing found, 1 something found, 2 wrong arguments, 77 no tools
H
}
parse_common_flags "$@"
cd "$project"
what=all
files=()
for a in "${rest[@]}"; do
  case $a in
    --format) what=format ;;
    --fix) what=fix ;;
    -*) die "there is no option $a; see --help" 2 ;;
    *.cpp) [ -f "$a" ] || die "there is no file $a" 2; files+=("$a") ;;
    *) die "$a is no .cpp file: a header is looked at with a file that includes it" 2 ;;
  esac
done
[ "$what" = all ] || [ ${#files[@]} = 0 ] || die "--$what looks at every source; name no files" 2

skip() { printf 'skipped: %s\n' "$1"; exit 77; }
if [ "$install" = yes ]; then
  install_missing "${layout_packages[@]}"
  [ "$what" != all ] || newest_clang clang-tidy >/dev/null || install_missing clang-tidy
fi
# Another version lays out differently.
lays_out=yes
command -v clang-format-14 >/dev/null || lays_out='no clang-format-14 (Debian 12 has it)'
[ "$what" = all ] || [ "$lays_out" = yes ] || skip "$lays_out"
tidy=
[ "$what" != all ] || tidy=$(newest_clang clang-tidy) || skip 'no clang-tidy of version 14 or later (apt-get install clang-tidy)'

sources() { find common master nve_server tests \( -name '*.cpp' -o -name '*.h' \) -print0; }
if [ "$what" = fix ]; then
  sources | xargs -0 -P "$jobs" -n 64 clang-format-14 -i
  exit
fi
if [ "$lays_out" = yes ]; then
  sources | xargs -0 -P "$jobs" -n 64 clang-format-14 --dry-run -Werror || die "the layout is not that of .clang-format: bash deploy/lint.sh --fix"
else
  say "The layout is not looked at: $lays_out"
fi
[ "$what" = all ] || exit 0

# clang-tidy reads the commands of the gcc build, and headers that the build generates.
build=build/release
[ -e $build/compile_commands.json ] || cmake --preset release >/dev/null
cmake --build $build --target telenano_proto --parallel "$jobs" >/dev/null
found=$(mktemp)
commands=$(mktemp -d)
trap 'rm -rf "$found" "$commands"' EXIT
# clang reads no header that gcc has precompiled, and has not all of gcc's warnings and ways to copy.
sed -E 's/ -Winvalid-pch| -include [^ ]*cmake_pch\.hxx| -Wno-(restrict|stringop-[a-z]+)| -mmem(set|cpy)-strategy=[^ "]*//g' $build/compile_commands.json >"$commands/compile_commands.json"
if [ ${#files[@]} -gt 0 ]; then printf '%s\0' "${files[@]}"; else
  # Only what this build compiles: the other half of an option has no command.
  sed -n 's|^ *"file": "\(.*\.cpp\)",\?$|\1|p' $build/compile_commands.json | grep -E "^$project/(common|master|nve_server|tests)/" | sort -u | tr '\n' '\0'
fi | xargs -0 -P "$jobs" -n 1 "$tidy" -p "$commands" --quiet 2>/dev/null >"$found" || true
# What is found in a header is found again by each file that includes it.
awk '/(warning|error): .*\[/ { new = !seen[$0]++ } new' "$found"
! grep -qE '(warning|error): .*\[' "$found" || die "clang-tidy found something"
