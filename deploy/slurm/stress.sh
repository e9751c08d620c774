#!/usr/bin/env bash
# Runs telenano-lab stress as a Slurm job array, one shard a task, and merges the shards when all are done.
set -euo pipefail
usage() {
  cat <<'H'
usage: deploy/slurm/stress.sh --out DIR [--tasks N] [--cpus N] [--wait] [-- SBATCH OPTION ...] STRESS OPTION ...
  --out DIR     folder that every node sees; tables, report and the tasks' logs go there
  --tasks N     shards [16]
  --cpus N      cores a task [1]
  --wait        come back when the report is there
  STRESS OPTION --full or --quick, --seed, --methods ...: see telenano-lab stress --help
  after --      options for sbatch, for example  -- --partition=short --time=30
The program is $TELENANO_LAB, or build/release/bin/telenano-lab of this tree: every node must see it, and the scenes.
A folder that is half done goes on where it was, with the same number of tasks: submit once more.
H
}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
out= tasks=16 cpus=1 wait=no stress=() sbatch=()
while [ $# -gt 0 ]; do
  case $1 in
    --out) out=${2:?--out needs a folder}; shift 2 ;;
    --tasks) tasks=${2:?--tasks needs a number}; shift 2 ;;
    --cpus) cpus=${2:?--cpus needs a number}; shift 2 ;;
    --wait) wait=yes; shift ;;
    -h|--help) usage; exit 0 ;;
    --) shift; while [ $# -gt 0 ] && [[ $1 == -* ]]; do
          case $1 in --full|--quick|--seed|--methods|--scenes|--rtt-ms|--loss|--no-report) break ;; esac
          sbatch+=("$1"); shift
        done ;;
    *) stress+=("$1"); shift ;;
  esac
done
die() { echo "error: $*" >&2; exit 2; }
[ -n "$out" ] || { usage >&2; exit 2; }
[[ $tasks =~ ^[1-9][0-9]{0,3}$ ]] || die "--tasks $tasks: expected 1 to 9999"
[[ $cpus =~ ^[1-9][0-9]*$ ]] || die "--cpus $cpus: expected a number"
command -v sbatch >/dev/null || die "sbatch is not here: submit from a machine of the cluster"
export TELENANO_LAB=${TELENANO_LAB:-$here/../../build/release/bin/telenano-lab}
[ -x "$TELENANO_LAB" ] || die "$TELENANO_LAB: no such program; build it or set TELENANO_LAB"
mkdir -p "$out/log" || die "$out: cannot be created"
out=$(realpath "$out")
array=$(sbatch --parsable --array="0-$((tasks - 1))" --cpus-per-task="$cpus" --output="$out/log/%A_%a.log" --export=ALL \
  "${sbatch[@]}" "$here/stress.sbatch" "${stress[@]}" --out "$out")
echo "array $array: $tasks shards" >&2
# A task that fails for good leaves a gap; merging then says which runs are missing.
merge=$(sbatch --parsable --dependency="afterany:$array" --kill-on-invalid-dep=yes --job-name=telenano-merge \
  --output="$out/log/merge-%j.log" --open-mode=append --export=ALL "${sbatch[@]}" \
  --wrap "\"$TELENANO_LAB\" stress --merge '$out'; code=\$?; echo \"exit \$code\"; exit \$code")
echo "merge $merge, then $out/report/index.html; logs in $out/log" >&2
echo "$array $merge"
[ "$wait" = yes ] || exit 0
while squeue -h -j "$array,$merge" -o %i 2>/dev/null | grep -q .; do sleep 1; done
tail -n 20 "$out/log/merge-$merge.log"
grep -q '^exit 0$' "$out/log/merge-$merge.log"
