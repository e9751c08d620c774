#!/usr/bin/env bash
# Builds and runs the benchmarks; prints the machine, the commit and the medians of five repetitions.
source "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
usage() {
  cat <<'H'
usage: deploy/bench.sh [--no-install] [BENCHMARK ARGUMENT ...]
  then telenano-lab bench: round trip, codec, capacity and memory beside their floors
  other words go to Google Benchmark, for example:  deploy/bench.sh --benchmark_filter=session
H
}
parse_common_flags "$@"
[ "$install" = no ] || install_missing "${build_packages[@]}"
configure_and_build bench_contact bench_link bench_scene bench_security bench_session telenano-lab telenano-nve >&2
printf '# %s, %s\n' "$(git -C "$project" describe --always --dirty 2>/dev/null || echo unknown)" "$(date -u +%F)"
printf '# %s, %s cores\n' "$(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -n 1)" "$(nproc)"
for b in bench_contact bench_link bench_scene bench_security bench_session; do
  printf '\n# %s\n' "$b"
  "$project/build/release/bin/$b" --benchmark_repetitions=5 --benchmark_report_aggregates_only=true "${rest[@]}" 2>/dev/null |
    grep -E '^Benchmark|_median|_cv' || true
done
# The product beside its floors, in a short form; a machine with one processor has none to spare for the stations.
lab="$project/build/release/bin/telenano-lab"
benches=("codec" "memory")
[ "$(nproc)" -lt 2 ] || benches+=("net --rounds 7" "server --rounds 5" "server --sessions 200 --seconds 5")
for b in "${benches[@]}"; do
  printf '\n# telenano-lab bench %s\n' "$b"
  # shellcheck disable=SC2086
  "$lab" bench $b || true
done
