#!/bin/bash
# What is felt by `twin` through the real programs, a round trip of 100 ms and 2 % of loss each way: every motion within 0.03.
#   fidelity_real_test.sh TELENANO_LAB
set -euo pipefail
lab=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
scenes=flat_silicon_oxide,flat_polystyrene,flat_pdms,flat_table,flakes,flakes_potential,humid_flakes,lithography,particle
"$lab" fidelity --real --methods twin --scenes "$scenes" --out real >real.csv
awk -F, '
  NR == 1 { for (i = 1; i <= NF; ++i) at[$i] = i; next }
  { printf "%-20s %-12s %s: NRMSE %s, %s ticks without a step\n", $at["scene"], $at["motion"], $at["method"], $at["nrmse"], $at["unexecuted"] }
  $at["method"] != "twin" || $at["nrmse"] > 0.03 { bad = 1; print "FAILED" }
  END { if (NR != 16) { print "FAILED: " NR - 1 " motions, expected 15"; bad = 1 } exit bad }' real.csv
