#!/bin/bash
# telenano-lab fidelity as a user runs it: table, page, same seed same bits, bad input.
set -euo pipefail
lab=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
fail() {
  echo "FAILED: $*" >&2
  exit 1
}
refuses() {
  local words=$1 code=0
  shift
  "$@" >out.txt 2>&1 || code=$?
  [ $code -eq 2 ] || fail "exit $code instead of 2: $*"
  grep -q "$words" out.txt || fail "does not say '$words': $(cat out.txt)"
}
some=(fidelity --quick --scenes flat_silicon_oxide,lithography/plough)
"$lab" "${some[@]}" --out one >one.csv 2>progress.txt
"$lab" "${some[@]}" --out two >two.csv 2>/dev/null
cmp one.csv two.csv || fail "same seed, other bits"
cmp one.csv one/fidelity.csv || fail "the file is not what was printed"
[ "$(wc -l <one.csv)" -eq 25 ] || fail "expected 3 motions x 4 methods x 2 round trips: $(wc -l <one.csv) lines"
[ "$(grep -c ",5," one/companding.csv)" -eq 6 ] || fail "expected 3 motions x 2 round trips with companding"
# Silicon oxide on the way in: not noticed as it is, noticed with companding, and as true as without.
awk -F, '$2 == "indent_fast" && $5 == 1 { plain = $7 < 0.05 } $2 == "indent_fast" && $5 == 5 { felt = $7 > 0.05 && $8 < 0.05 } END { exit !(plain && felt) }' one/companding.csv ||
  fail "companding: $(cat one/companding.csv)"
grep -q "With companding" one/index.html || fail "no table of companding"
grep -q "As haptic communication measures it" one/index.html || fail "no table of haptic communication"
# Over 200 ms, the newest answer is 200 ms late, and nothing else is wrong with it.
awk -F, 'NR == 1 { for (i = 1; i <= NF; ++i) at[$i] = i; next }
  $3 == "none" && $4 == 200 && $2 == "indent_fast" { found = 1; good = $at["time_offset_ms"] == 200 && $at["value_gain"] > 0.99 && $at["value_gain"] < 1.01 && $at["value_offset_n"] < 0.01 }
  END { exit !(found && good) }' one.csv || fail "time and value of none over 200 ms: $(grep none,200 one.csv)"
grep -q "cells" progress.txt || fail "no progress"
grep -q "<table" one/index.html || fail "no heat map"
! grep -qE 'src="http|href="http' one/index.html || fail "the page needs other files"
if command -v gnuplot >/dev/null; then grep -q "<svg" one/index.html || fail "no picture"; fi
# Over 200 ms, the newest answer is 200 ms late.
awk -F, '$3 == "none" && $4 == 200 && $2 == "indent_fast" { found = 1; exit !($12 == 200) } END { exit !found }' one.csv ||
  fail "the lag of none over 200 ms is not 200 ms: $(grep none,200 one.csv)"
refuses "moon" "$lab" fidelity --quick --scenes moon --out x
refuses "out of range" "$lab" fidelity --quick --rtt -1 --out x
refuses "out of range" "$lab" fidelity --quick --loss 1 --out x
refuses "unknown" "$lab" fidelity --quick --methods magic --out x
refuses "cannot be created" "$lab" fidelity --quick --out /proc/fidelity
[ ! -e x ] || fail "bad input left a folder behind"
