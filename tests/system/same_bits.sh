#!/usr/bin/env bash
# The states of every scene of the project over many steps: the same to the bit by this build, by this build without
# glibc's code for fused multiply-add and AVX2, and by a build of another compiler, if one is named.
#   same_bits.sh SOURCE TELENANO-SAME-BITS STEPS [COMPILER]     clang++: that of any version from 14 on
source "$1/deploy/lib.sh"
source_dir=$1 program=$2 steps=$3 other=${4:-}
[ "$other" != clang++ ] || other=$(newest_clang clang++) || die "there is no clang++ of version 14 or later; apt-get install clang"
scenes=("$source_dir"/deploy/scenes/*.toml)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

"$program" "$steps" "${scenes[@]}" | tee "$work/this"
[ "$(wc -l < "$work/this")" -eq "${#scenes[@]}" ]
GLIBC_TUNABLES=glibc.cpu.hwcaps=-FMA,-AVX2,-AVX2_Usable,-FMA_Usable "$program" "$steps" "${scenes[@]}" > "$work/plain"
diff "$work/this" "$work/plain" || { echo "other states without FMA and AVX2"; exit 1; }
echo "the same with and without FMA and AVX2, by $("$program" --compiler)"
if [ -n "$other" ]; then
  cmake -S "$source_dir" -B "$work/other" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_COMPILER="$other" \
    -DTELENANO_TESTS=OFF -DTELENANO_VIEWER=OFF -DTELENANO_METRICS=OFF -DTELENANO_UNITY=OFF > "$work/log"
  cmake --build "$work/other" --target telenano-same-bits > "$work/log" || { tail "$work/log"; exit 1; }
  by_other=$(find "$work/other" -name telenano-same-bits -type f)
  "$by_other" "$steps" "${scenes[@]}" > "$work/other.out"
  diff "$work/this" "$work/other.out" || { echo "other states by $("$by_other" --compiler)"; exit 1; }
  echo "the same by $("$by_other" --compiler)"
fi
