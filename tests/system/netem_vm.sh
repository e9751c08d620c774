#!/usr/bin/env bash
# The real programs over the kernel's own bad link: server and station in network namespaces of their own, a veth pair between
# them, tc netem at both ends, encrypted as off loopback. Run by vm.sh as root in a virtual machine.
#   netem_vm.sh PROJECT TELENANO_NVE TELENANO_MASTER
set -euo pipefail
project=$1 nve=$2 master=$3
work=$(mktemp -d)
cd "$work"
failed=0
say() { printf 'netem_vm: %s\n' "$*"; }
expect() { # TEXT AWK-CONDITION NAME=VALUE ...
  local text=$1 condition=$2 assign=() pair
  shift 2
  for pair in "$@"; do assign+=(-v "$pair"); done
  if awk "${assign[@]}" "BEGIN { exit !($condition) }"; then say "ok: $text ($*)"; else say "FAILED: $text ($*), expected $condition"; failed=1; fi
}
line_of() { grep -m1 "^  $1" "$2" | sed "s|^  $1 *||"; }

for side in station server; do
  ip netns add $side
  ip -n $side link set lo up
done
ip link add name to_server netns station type veth peer name to_station netns server
ip -n station address add 10.9.0.1/24 dev to_server
ip -n server address add 10.9.0.2/24 dev to_station
ip -n station link set to_server up
ip -n server link set to_station up

netem() { # ACTION OPTION ...: at both ends
  local action=$1
  shift
  ip netns exec station bash "$project/deploy/netem.sh" "$action" to_server "$@"
  ip netns exec server bash "$project/deploy/netem.sh" "$action" to_station "$@"
}
run() { # NAME OPTION ...
  local name=$1
  shift
  ip netns exec station "$master" run --server 10.9.0.2:5100 --key omega-1.key --connect-timeout-s 20 --rate 200 \
    --rt-priority 0 --quiet "$@" >"$name.log" 2>&1
}

"$nve" keys new omega-1 --rights operate >/dev/null
ip netns exec server "$nve" serve --scene "$project/deploy/scenes/flat_pdms.toml" --listen 10.9.0.2:5100 --keys keys.toml \
  >server.log 2>&1 &
server=$!
for _ in $(seq 100); do grep -q ' on 10.9.0.2:5100' server.log && break; sleep 0.1; done

# A link that delays, varies, loses in bursts and repeats.
netem apply --delay-ms 20 --jitter-ms 2 --loss 0.04 --burst 3 --duplicate 0.02
run bad --task contact --duration-s 6 && status=0 || status=$?
expect 'a session over a bad link ends well' 'status == 0' status=$status
[ $status = 0 ] || cat bad.log
round_trip=$(line_of 'round trip p50 / p99 / max' bad.log)
expect 'round trip' 'p50 >= 38000 && p50 <= 200000' p50="${round_trip%% *}"
lost=$(line_of 'replies lost' bad.log | sed 's/.*(\(.*\) %)/\1/')
expect 'replies lost, percent: 4 % each way' 'lost > 1 && lost < 20' lost="$lost"
# A run of losses leaves a force older than the hold time now and then (station fault 0x80); nothing else goes wrong.
expect 'no fault' 'faults ~ /^(none|station: no new reply)$/' faults="$(line_of 'faults' bad.log)"
for where in 'station to_server' 'server to_station'; do
  # shellcheck disable=SC2086
  set -- $where
  dropped=$(ip netns exec "$1" bash "$project/deploy/netem.sh" show "$2" | grep -o 'dropped [0-9]*' | head -1 | cut -d' ' -f2)
  expect "the kernel dropped on the way from $1" 'dropped > 0' dropped="$dropped"
done

# A path that is gone for a second and a half, in contact, and comes back. The commands are made beforehand, one process each:
# on an emulated machine whose host is busy netem.sh takes seconds, and the path was gone for longer than a station waits (10 s).
# How long it really was is measured, and the station waits for longer here: when to give up is not what is tested.
netem apply --delay-ms 5
at_both() { # OPTION ...
  printf 'ip netns exec station %s\n' "$(bash "$project/deploy/netem.sh" apply to_server --dry-run "$@")"
  printf 'ip netns exec server %s\n' "$(bash "$project/deploy/netem.sh" apply to_station --dry-run "$@")"
}
at_both --loss 1 >cut.sh
at_both --delay-ms 5 >mend.sh
# It is cut when the station says that the hand is engaged, however long this machine takes to get there.
station_mode() { # of the station of namespace station, as its metrics say
  ip netns exec station bash -c 'exec 3<>/dev/tcp/127.0.0.1/9200 && printf "GET /metrics HTTP/1.0\r\n\r\n" >&3 && cat <&3' 2>/dev/null |
    sed -n 's/^telenano_station_mode{mode="\([a-z]*\)"} 1$/\1/p'
}
run outage --task contact --duration-s 15 --give-up-s 60 --metrics 127.0.0.1:9200 &
station=$!
mode=
for _ in $(seq 200); do
  mode=$(station_mode || true)
  [ "$mode" != engaged ] || break
  kill -0 $station 2>/dev/null || break
  sleep 0.1
done
expect 'the hand is engaged' 'mode == "engaged"' mode="$mode"
sleep 1
. ./cut.sh
cut_ns=$(date +%s%N)
sleep 1.5
. ./mend.sh
gone_ms=$((($(date +%s%N) - cut_ns) / 1000000))
say "the path was gone for $gone_ms ms"
wait $station && status=0 || status=$?
expect 'a session outlives an outage of 1.5 s' 'status == 0' status=$status
[ $status = 0 ] || cat outage.log
stale=$(line_of 'stale force' outage.log | cut -d' ' -f1)
# 200 a second while it was gone; afterwards the server has caught up with the steps that came late within a few seconds.
expect 'ticks without a fresh force' 'stale > 20 && stale < 0.2 * gone + 800' stale="$stale" gone="$gone_ms"

# A link that is good again is as good as new.
netem remove
run good --task position --duration-s 2 && status=0 || status=$?
expect 'a session over the mended link ends well' 'status == 0' status=$status
round_trip=$(line_of 'round trip p50 / p99 / max' good.log)
expect 'round trip' 'p50 < 20000' p50="${round_trip%% *}"

kill -TERM $server
wait $server && status=0 || status=$?
expect 'the server ends well' 'status == 0' status=$status
# What netem sent twice the channel took once: its replay window counts the copies.
copies=$(grep -o 'forged [0-9]*' server.log | tail -1 | cut -d' ' -f2)
expect 'copies were dropped' 'copies > 0' copies="${copies:-0}"
grep -E 'stopped|channels' server.log | tail -n 2 | sed 's/^/netem_vm: /'
exit $failed
