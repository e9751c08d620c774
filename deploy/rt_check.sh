#!/usr/bin/env bash
# Says what this machine can hold in real time, and what to change: kernel, permissions, power saving, then how late a thread
# wakes. Changes nothing.
set -euo pipefail
usage() {
  cat <<'H'
usage: deploy/rt_check.sh [--seconds S] [--no-measure]
  --seconds S     of each measurement (default 5)
  --no-measure    only look
Run it as the user who runs the station: permissions are theirs. Exit status 0: 1 kHz holds; 1: it does not, or something is
missing that the station's loop asks for.
H
}
seconds=5 measure=yes
while [ $# -gt 0 ]; do
  case $1 in
    -h|--help) usage; exit 0 ;;
    --no-measure) measure=no; shift ;;
    --seconds) [[ ${2:-} =~ ^[1-9][0-9]*$ ]] || { echo "error: --seconds needs a whole number" >&2; exit 2; }; seconds=$2; shift 2 ;;
    *) printf 'error: unknown argument %s\n' "$1" >&2; usage >&2; exit 2 ;;
  esac
done
project=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
bad=0
good() { printf '  ok    %-26s %s\n' "$1" "$2"; }
note() { printf '  note  %-26s %s\n' "$1" "$2"; }
poor() { printf '  BAD   %-26s %s\n' "$1" "$2"; bad=1; }
first_of() { cat "$1" 2>/dev/null || true; }

echo "Kernel and processors"
if [ "$(first_of /sys/kernel/realtime)" = 1 ]; then good "kernel" "$(uname -r), PREEMPT_RT"
else note "kernel" "$(uname -r), without PREEMPT_RT: good for 1 kHz as a rule; for 4 kHz install linux-image-rt-amd64"; fi
processors=$(nproc)
if [ "$processors" -ge 2 ]; then good "processors" "$processors"; else poor "processors" "1: viewer and recorder will get in the loop's way"; fi
source_=$(first_of /sys/devices/system/clocksource/clocksource0/current_clocksource)
case $source_ in
  tsc|kvm-clock|hyperv_clocksource*|arch_sys_counter) good "clock source" "$source_" ;;
  '') note "clock source" "not told" ;;
  *) poor "clock source" "$source_ costs about a microsecond a look; boot with tsc=reliable" ;;
esac
if grep -qw hypervisor /proc/cpuinfo 2>/dev/null; then note "virtual machine" "yes: the longest delays are the host's"; fi
governor=$(first_of /sys/devices/system/cpu/cpu0/cpufreq/scaling_governor)
case $governor in
  ''|performance) good "frequency" "${governor:-not scaled here}" ;;
  *) note "frequency" "$governor: as root, cpupower frequency-set -g performance" ;;
esac

echo "What this user may do ($(id -un))"
priority=$(ulimit -r)
if [ "$(id -u)" = 0 ] || [ "$priority" = unlimited ] || [ "$priority" -ge 80 ]; then
  if [ "$(id -u)" = 0 ]; then good "real-time priority" "any"; else good "real-time priority" "$priority"; fi
else poor "real-time priority" "up to $priority, the loop asks for 80: adduser $(id -un) telenano-rt, then log in again"; fi
locked=$(ulimit -l)
if [ "$(id -u)" = 0 ] || [ "$locked" = unlimited ]; then good "locked memory" "unlimited"
else poor "locked memory" "$locked KiB: adduser $(id -un) telenano-rt, then log in again"; fi
if [ -w /dev/cpu_dma_latency ]; then good "/dev/cpu_dma_latency" "can be held: --cpu-awake"
else note "/dev/cpu_dma_latency" "cannot be opened: --cpu-awake will be refused"; fi
runtime=$(first_of /proc/sys/kernel/sched_rt_runtime_us) period=$(first_of /proc/sys/kernel/sched_rt_period_us)
if [ "${runtime:-0}" = -1 ]; then good "real-time share" "unlimited"
elif [ -n "$runtime" ]; then good "real-time share" "$((runtime / 1000)) ms of $((period / 1000)) ms: the loop sleeps each period, so this never bites"; fi
[ "$measure" = yes ] || exit "$bad"

echo "How late a thread wakes, µs ($seconds s each)"
printf '  %-34s %8s %8s %8s %8s\n' "" p50 p99 p99.9 max
holds=yes
if command -v cyclictest >/dev/null; then
  rt=(-p80); [ "$(id -u)" = 0 ] || [ "$priority" = unlimited ] || [ "$priority" -ge 80 ] || rt=()
  for rate in 1000 4000; do
    line=$(cyclictest --laptop -q -t1 -h 20000 "-i$((1000000 / rate))" "-l$((seconds * rate))" "${rt[@]}" 2>/dev/null | awk '
      /^[0-9]/ && $2 > 0 { late[++n] = $1; count[n] = $2; total += $2 }
      function quantile(part,   i, seen) { for (i = 1; i <= n; ++i) { seen += count[i]; if (seen >= part * total) return late[i] + 0 } return late[n] + 0 }
      END { if (total) printf "%d %d %d %d", quantile(0.5), quantile(0.99), quantile(0.999), quantile(1) }')
    read -r p50 p99 p999 max <<<"$line" || true
    printf '  %-34s %8s %8s %8s %8s\n' "cyclictest --laptop at $rate Hz" "$p50" "$p99" "$p999" "$max"
    # A tick may start late by a tenth of its period; the rest is for its work and for the answer.
    if [ "${p999:-999999}" -gt $((500000 / rate)) ]; then
      [ "$rate" != 1000 ] || holds=no
      note "$rate Hz" "one wake-up in a thousand is later than half a period"
    fi
  done
else
  note "cyclictest" "not installed: apt-get install rt-tests"
fi
lab=$(command -v telenano-lab || true)
[ -n "$lab" ] || lab=$project/build/release/bin/telenano-lab
if [ -x "$lab" ] && command -v cyclictest >/dev/null; then
  "$lab" bench loop --pairs 1 --seconds "$seconds" 2>/dev/null | awk -F, 'NR > 1 && $3 == "station" { printf "  %-34s %8s %8s %8s %8s\n", "the station at " $1 " Hz, recording", $4, $5, $6, $7 }' ||
    note "the station" "did not run"
fi
if [ "$holds" = no ]; then poor "1 kHz" "does not hold"; else good "1 kHz" "holds"; fi
exit "$bad"
