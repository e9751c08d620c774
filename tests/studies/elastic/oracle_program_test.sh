#!/usr/bin/env bash
# Wrong words to telenano-elastic-oracle: one line that names them, exit code not 0, no table.
#   oracle_program_test.sh PROGRAM SCAN.gsf
set -uo pipefail
program=$1 scan=$2 failed=0
refuses() { # what the message names, then the words
  local names=$1 said
  shift
  if said=$(timeout 20 "$program" "$@" 2>&1); then
    echo "taken: $*"; failed=1
  elif ! grep -q -- "$names" <<<"$said" || grep -q '^[a-z0-9-]*,[0-9]*,[0-9]*,' <<<"$said"; then
    echo "$*: said: ${said:0:200}"; failed=1
  fi
}
refuses --modulus-gpa --modulus-gpa nan flat
refuses --modulus-gpa --modulus-gpa -3 flat
refuses --spacing-nm --spacing-nm 0 flat
refuses --spacing-nm --spacing-nm -1 flat
refuses --elements --elements 100 flat
refuses --radius-nm --radius-nm 0 flat
refuses --adhesion-n-m --adhesion-n-m -1 flat
refuses --heights-times --heights-times inf "$scan" 5,5
refuses --step-nm --step-nm nan flat
refuses --from-nm --from-nm -1e9 flat
refuses --from-nm --from-nm 1 --to-nm -1 flat
refuses COLUMN,ROW "$scan"
refuses COLUMN,ROW "$scan" x
refuses COLUMN,ROW "$scan" 5,5x
refuses COLUMN,ROW "$scan" 9999,2
refuses 'no such shape' round
refuses missing.gsf missing.gsf 1,2
exit "$failed"
