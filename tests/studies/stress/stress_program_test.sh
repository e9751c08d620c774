#!/usr/bin/env bash
# telenano-lab stress as its users run it: the quick profile on all cores, the same in shards of which one is killed
# and resumed, wrong controllers, bad input. One table, the same bits.
set -euo pipefail
lab=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

fail() { echo "FAILED: $*" >&2; exit 1; }
# refuses STATUS WORDS COMMAND...: ends with STATUS and says WORDS
refuses() {
  local status=$1 words=$2 got=0
  shift 2
  "$@" >out.txt 2>err.txt || got=$?
  [ "$got" = "$status" ] || { cat err.txt >&2; fail "exit $got instead of $status: $*"; }
  grep -q -- "$words" err.txt || { cat err.txt >&2; fail "does not say '$words': $*"; }
}

echo "== the quick profile, whole"
"$lab" stress --quick --out whole --seed 7 --results kept
[ -s whole/report/index.html ] || fail "no report"
if command -v gnuplot >/dev/null; then
  [ "$(grep -c '<svg' whole/report/index.html)" -ge 4 ] || fail "figures are missing"
fi

cmp whole/report/index.html kept/index.html || fail "the page was not kept"
grep -q "seed=7" kept/run.txt && grep -q "threads" kept/run.txt || fail "does not say where it was made"
[ "$(wc -l <kept/broken.csv)" = 1 ] || fail "broken promises"
[ "$(du -sk kept | cut -f1)" -lt 3000 ] || fail "too much is kept"

echo "== some of it: one thread, two threads, shards, one of them killed and resumed"
part=(--quick --methods model,tank --scenes wall,oxide --rtt-ms 0:20 --no-report)
some=("${part[@]}" --seed 7)
"$lab" stress "${some[@]}" --out one --threads 1 >/dev/null
"$lab" stress "${some[@]}" --out two --threads 3 >/dev/null
cmp one/runs.csv two/runs.csv || fail "the table depends on the number of threads"
"$lab" stress "${some[@]}" --out shards --shard 0/3
"$lab" stress "${some[@]}" --out shards --shard 2/3
"$lab" stress "${some[@]}" --out shards --shard 1/3 --threads 1 2>/dev/null &
victim=$!
for _ in $(seq 1500); do
  [ "$(cat shards/shards/0001-of-0003.csv 2>/dev/null | wc -l)" -gt 5 ] && break
  sleep 0.04
done
kill -9 $victim 2>/dev/null || true
wait $victim 2>/dev/null || true
table=shards/shards/0001-of-0003.csv
head -c -20 "$table" >cut.csv && cat cut.csv >"$table" # in the middle of a line
refuses 2 "half-written" "$lab" stress --merge shards --no-report
"$lab" stress "${some[@]}" --out shards --shard 1/3 2>resumed.txt
grep -q "half-written last line was dropped" resumed.txt || fail "does not say that a line was dropped"
grep -q "were there already" resumed.txt || fail "did not go on from where it was"
"$lab" stress --merge shards --no-report >/dev/null
cmp one/runs.csv shards/runs.csv || fail "shards give another table"

echo "== a sample: its rates in bounds.csv and on the page, also where it was made in shards"
drawn=(--sample 40 --methods tank,ks-clamp --scenes wall --rtt-ms 0:50 --seed 3)
"$lab" stress "${drawn[@]}" --out drawn >/dev/null
grep -q '^tank,,,' drawn/bounds.csv || fail "no rate of a method over all"
grep -q '<h2>Rates</h2>' drawn/report/index.html || fail "the page of a sample has no rates"
grep -q '<h2>Rates</h2>' whole/report/index.html && fail "a grid has no rates"
for i in 0 1; do "$lab" stress "${drawn[@]}" --out drawn-shards --shard $i/2 --no-report; done
"$lab" stress --merge drawn-shards --no-report >/dev/null
cmp drawn/bounds.csv drawn-shards/bounds.csv || fail "shards give other rates"

echo "== bad input"
before=$(cat one/runs.csv one/shards/* | cksum)
refuses 2 "another sweep" "$lab" stress "${part[@]}" --seed 8 --out one
refuses 2 "another sweep" "$lab" stress --quick --seed 7 --out one
[ "$before" = "$(cat one/runs.csv one/shards/* | cksum)" ] || fail "something was overwritten"
refuses 2 "unknown" "$lab" stress --quick --methods magic --out x
refuses 2 "unknown" "$lab" stress --quick --scenes moon --out x
refuses 2 "contradicts itself" "$lab" stress --quick --rtt-ms 50:10 --out x
refuses 2 "out of range" "$lab" stress --quick --loss 0:2 --out x
refuses 2 "no number" "$lab" stress --quick --loss a:b --out x
refuses 2 "expected I/N" "$lab" stress --quick --shard 3/3 --out x
refuses 2 "expected I/N" "$lab" stress --quick --shard 1 --out x
refuses 2 "contradict" "$lab" stress --quick --full --out x
refuses 2 "expected one of" "$lab" stress
refuses 2 "range" "$lab" stress --replay "rtt-ms=-1"
refuses 2 "is unknown" "$lab" stress --replay "speed=1"
refuses 2 "manifest" "$lab" stress --merge nowhere
[ ! -e x ] || fail "bad input left a folder behind"
refuses 2 "cannot be" "$lab" stress --quick --out /proc/stress
cp -r shards lacking && rm lacking/runs.csv lacking/shards/0002-of-0003.csv
refuses 2 "missing" "$lab" stress --merge lacking
cp -r shards double && rm double/runs.csv && cp one/shards/0000-of-0001.csv double/shards/
refuses 2 "overlap" "$lab" stress --merge double
cp -r shards foreign && rm foreign/runs.csv
"$lab" stress "${part[@]}" --seed 8 --out other --shard 2/3 2>/dev/null
cp other/shards/0002-of-0003.csv foreign/shards/
refuses 2 "another sweep" "$lab" stress --merge foreign
echo "== wrong controllers"
"$lab" stress --mutants
