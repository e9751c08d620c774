#!/usr/bin/env bash
# Which tests the last run of deploy/test.sh skipped, and why: each says so itself when it runs.
set -euo pipefail
usage() {
  cat <<'H'
usage: deploy/skipped.sh [FOLDER]
  FOLDER   with said.txt, which is what CTest printed, and Temporary/LastTest.log, what the tests printed;
           default: build/release/Testing

Prints how many tests were skipped of how many, and a line for each reason with the tests that gave it.
H
}
case ${1-} in -h|--help) usage; exit 0 ;; -*) echo "error: there is no option $1; see --help" >&2; exit 2 ;; esac
folder=${1-$(dirname "${BASH_SOURCE[0]}")/../build/release/Testing}
for file in "$folder/said.txt" "$folder/Temporary/LastTest.log"; do
  [ -r "$file" ] || { echo "error: there is no file $file: run deploy/test.sh" >&2; exit 2; }
done
# CTest's log has each test's output, but calls passed what it skipped; its last words list these. GoogleTest's reason stands
# between its line "FILE:LINE: Skipped" and "[  SKIPPED ]", a script's in a line with "skipped:" or "cannot run here:".
awk '
  FNR == NR { if (/^\t *[0-9]+ - .* \(Skipped\)$/) { sub(/^\t *[0-9]+ - /, ""); sub(/ \(Skipped\)$/, ""); test[++tests] = $0 } next }
  /^[0-9]+\/[0-9]+ Testing: / { ++all; name = $0; sub(/^[^:]*: /, "", name); reason = ""; taking = inside = 0; next }
  /^Output:$/ { inside = 1; next }
  /^<end of output>/ {
    inside = 0
    why[name] = reason == "" ? "no reason given" : reason
  }
  !inside { next }
  /^\[  SKIPPED \]/ { taking = 0 }
  taking && NF { line = $0; sub(/^[ \t]+/, "", line); reason = reason (reason == "" ? "" : " ") line }
  /^[^ ]*:[0-9]+: Skipped$/ { taking = 1; reason = "" }
  !taking && reason == "" && /(^|[^A-Za-z])(skipped|cannot run here): / {
    reason = $0; sub(/^.*(skipped|cannot run here): /, "", reason)
  }
  END {
    printf "Skipped: %d of %d tests\n", tests, all
    for (i = 1; i <= tests; ++i) {  # in the order of their numbers; the log has that in which they ended
      reason = why[test[i]]
      if (!(reason in count)) order[++reasons] = reason
      if (++count[reason] <= 3) names[reason] = names[reason] (count[reason] == 1 ? "" : ", ") test[i]
    }
    for (i = 1; i <= reasons; ++i) {
      reason = order[i]
      printf "  %s: %s%s\n", reason, names[reason], (count[reason] > 3 ? " and " count[reason] - 3 " more" : "")
    }
  }' "$folder/said.txt" "$folder/Temporary/LastTest.log"
