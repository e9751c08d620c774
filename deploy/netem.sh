#!/usr/bin/env bash
# Makes a network interface as bad as a bad link (tc netem), and good again.
set -euo pipefail
usage() {
  cat <<'H'
usage: deploy/netem.sh apply INTERFACE [OPTION ...]      what leaves INTERFACE, from now on (replaces what was there)
       deploy/netem.sh show INTERFACE
       deploy/netem.sh remove INTERFACE

  --delay-ms D          one way
  --jitter-ms J         around D, normally distributed; needs D >= J
  --any-order           jitter reorders (otherwise what is behind a late datagram waits, as on a real path)
  --loss P              probability, 0 to 1
  --burst N             mean run of losses, datagrams (Gilbert-Elliott); 1: independent
  --reorder P           probability of going ahead of those that are delayed; needs --delay-ms
  --duplicate P         probability of going twice
  --corrupt P           probability that one bit is flipped
  --rate-bit-s R        what the link carries
  --limit N             room for datagrams on their way (default 10000)
  --dry-run             print the tc command instead of running it

Both directions of a path have an interface each: apply it at both ends. Needs root, iproute2 and a kernel with netem
(Debian's has it; many containers' have not: telenano-lab relay does the same between two programs anywhere).
H
}
fail() { printf 'netem.sh: %s\n' "$*" >&2; exit "${code:-2}"; }
number() { # FLAG VALUE LOW HIGH
  awk -v x="$2" -v low="$3" -v high="$4" 'BEGIN { exit !(x ~ /^[0-9]+(\.[0-9]*)?([eE][-+]?[0-9]+)?$/ && x + 0 >= low && x + 0 <= high) }' ||
    fail "$1 is '$2', expected a number from $3 to $4"
}
percent() { awk -v p="$1" 'BEGIN { printf "%.9g%%", 100 * p }'; }

case ${1:-} in
  -h|--help) usage; exit 0 ;;
  apply|show|remove) action=$1 ;;
  '') fail 'nothing is asked for; see --help' ;;
  *) fail "'$1' is unknown, expected apply, show or remove" ;;
esac
[ $# -ge 2 ] || fail "$action: no interface is named; ip -br link lists them"
interface=$2
shift 2
delay_ms=0 jitter_ms=0 any_order=no loss=0 burst=1 reorder=0 duplicate=0 corrupt=0 rate_bit_s=0 limit=10000 dry_run=no
while [ $# -gt 0 ]; do
  case $1 in
    --any-order) any_order=yes; shift; continue ;;
    --dry-run) dry_run=yes; shift; continue ;;
  esac
  [ $# -ge 2 ] || fail "$1 is unknown or has no value; see --help"
  case $1 in
    --delay-ms) number "$1" "$2" 0 60000; delay_ms=$2 ;;
    --jitter-ms) number "$1" "$2" 0 60000; jitter_ms=$2 ;;
    --loss) number "$1" "$2" 0 1; loss=$2 ;;
    --burst) number "$1" "$2" 1 1e6; burst=$2 ;;
    --reorder) number "$1" "$2" 0 1; reorder=$2 ;;
    --duplicate) number "$1" "$2" 0 1; duplicate=$2 ;;
    --corrupt) number "$1" "$2" 0 1; corrupt=$2 ;;
    --rate-bit-s) number "$1" "$2" 1000 1e11; rate_bit_s=$2 ;;
    --limit) number "$1" "$2" 1 1e7; limit=$2 ;;
    *) fail "$1 is unknown; see --help" ;;
  esac
  shift 2
done

larger() { awk -v a="$1" -v b="$2" 'BEGIN { exit !(a + 0 > b + 0) }'; }
larger "$jitter_ms" "$delay_ms" && fail "--jitter-ms is $jitter_ms, expected at most --delay-ms, $delay_ms"
larger "$reorder" 0 && ! larger "$delay_ms" 0 && fail "--reorder needs --delay-ms: only what waits can be overtaken"

arguments=(limit "$(awk -v n="$limit" 'BEGIN { printf "%d", n }')")
if larger "$delay_ms" 0; then
  arguments+=(delay "${delay_ms}ms")
  larger "$jitter_ms" 0 && arguments+=("${jitter_ms}ms" distribution normal)
fi
if larger "$loss" 0; then
  if larger "$burst" 1; then
    # Gilbert-Elliott: out of a burst with 1/N; into one so often that the mean is as asked.
    larger 1 "$loss" || fail "--burst with --loss 1 is no burst"
    arguments+=(loss gemodel "$(awk -v p="$loss" -v n="$burst" 'BEGIN { q = p / ((1 - p) * n); if (q > 1) q = 1; printf "%.9g%% %.9g%% 100%% 0%%", 100 * q, 100 / n }')")
  else
    arguments+=(loss "$(percent "$loss")")
  fi
fi
larger "$reorder" 0 && arguments+=(reorder "$(percent "$reorder")")
larger "$duplicate" 0 && arguments+=(duplicate "$(percent "$duplicate")")
larger "$corrupt" 0 && arguments+=(corrupt "$(percent "$corrupt")")
# With a rate netem keeps the order, whatever the jitter.
if larger "$rate_bit_s" 0; then
  arguments+=(rate "$(awk -v r="$rate_bit_s" 'BEGIN { printf "%d", r }')bit")
elif larger "$jitter_ms" 0 && [ $any_order = no ] && ! larger "$reorder" 0; then
  arguments+=(rate 100gbit)
fi
# shellcheck disable=SC2206  # one word for gemodel's four numbers
arguments=(${arguments[@]})

if [ $action = apply ] && [ $dry_run = yes ]; then
  echo "tc qdisc replace dev $interface root netem ${arguments[*]}"
  exit 0
fi
code=1
command -v tc >/dev/null || PATH=$PATH:/usr/sbin:/sbin
command -v tc >/dev/null || fail 'tc is not installed; run: apt-get install iproute2'
ip link show dev "$interface" >/dev/null 2>&1 || code=2 fail "there is no interface $interface; ip -br link lists them"
case $action in
  show) tc -s qdisc show dev "$interface" ;;
  remove)
    [ "$(id -u)" = 0 ] || fail 'needs root; run it with sudo'
    tc qdisc show dev "$interface" | grep -q netem || fail "$interface has no netem to remove"
    tc qdisc del dev "$interface" root ;;
  apply)
    [ "$(id -u)" = 0 ] || fail 'needs root; run it with sudo'
    modprobe sch_netem 2>/dev/null || true
    said=$(tc qdisc replace dev "$interface" root netem "${arguments[@]}" 2>&1) || case $said in
      *'qdisc kind is unknown'*) fail 'this kernel has no netem (modprobe sch_netem); use telenano-lab relay instead' ;;
      *'not permitted'*) fail 'this container may not change its network; run it where CAP_NET_ADMIN is, or use telenano-lab relay' ;;
      *) fail "tc refuses: $(printf '%s' "$said" | tr '\n' ' ')" ;;
    esac ;;
esac
