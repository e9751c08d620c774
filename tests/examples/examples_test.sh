#!/usr/bin/env bash
# Each example does what its first lines say.
#   examples_test.sh SOURCE 01_force_curve 02_virtual_session 03_station 04_slave 05_device 06_contact_law
set -euo pipefail
source=$1 curve=$2 virtual=$3 station=$4 slave=$5 device=$6 law=$7
work=$(mktemp -d)
server=
trap '[ -z "$server" ] || kill "$server" 2>/dev/null || true; rm -rf "$work"' EXIT
cd "$work"
fail() { printf 'FAILED: %s\n' "$*" >&2; exit 1; }
between() { awk -v x="$1" -v low="$2" -v high="$3" 'BEGIN { exit !(x >= low && x <= high) }' || fail "$4: $1, expected $2 to $3"; }

for file in "$source"/deploy/examples/*.cpp; do
  [ "$(wc -l <"$file")" -le 80 ] || fail "$file has more than 80 lines"
done

# Silicon oxide: between DMT (2πwR = 50.3 nN) and JKR (1.5πwR = 37.7 nN); with w = 0.4 N/m and R = 20 nm.
"$curve" >curve.csv 2>said || fail "$(cat said)"
between "$(sed -n 's/.*pull-off \([0-9.]*\) nN.*/\1/p' said)" 37.7 50.3 'pull-off'
[ "$(wc -l <curve.csv)" -gt 1000 ] || fail 'the curve is short'

# Virtual time: the same at every run; 40 ms of round trip lose a hundredth of the datagrams.
"$virtual" "$source/deploy/scenes/flat_pdms.toml" >first || fail "it ended with $?"
"$virtual" "$source/deploy/scenes/flat_pdms.toml" >second
cmp first second || fail 'two runs differ'
cat first
"$virtual" nowhere.toml 2>said && fail 'a scene that is not there was taken'
grep -q '^error: .*nowhere.toml' said || fail "said: $(cat said)"

# A station and a slave that have nothing of the programs in them; a port that is free.
port=$(python3 -c 'import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
"$slave" "$port" 2>slave.log &
server=$!
for _ in $(seq 100); do grep -q "127.0.0.1:$port" slave.log && break; sleep 0.05; done
# On a machine that is busy with other work the station holds through a whole press and feels nothing, as it should: it presses
# again then. What it feels when it presses is what is tested.
for try in $(seq 8); do
  "$station" "127.0.0.1:$port" >felt && break
  status=$?
  [ "$status" = 1 ] || fail "it ended with $status"
  [ "$try" -lt 8 ] || fail "pressed $try times and felt nothing: $(cat felt)"
done
cat felt
between "$(sed -n 's/^tip \([0-9.]*\) nN.*/\1/p' felt)" 1 200 'force on the tip'

# A hand behind a pipe: down to 5 mm below the wall (20 nm is 20 mm at the default scale) and up. The wall pushes up, at most 25 nN, which are 0.5 N.
python3 - <<'P' | "$device" "127.0.0.1:$port" >forces
import sys, time
for i in range(151):
    depth = min(i, 150 - i) / 75 * 25
    print(f"0 0 {-depth:.4f}", flush=True)
    time.sleep(0.02)
P
most=$(awk '$3 > most { most = $3 } END { print most + 0 }' forces)
between "$most" 0.05 1 'force on the piped hand'
between "$(tail -n 1 forces | awk '{ print $3 < 0 ? -$3 : $3 }')" 0 0.1 'force at the end'

"$law" >/dev/null
kill -TERM "$server"
wait "$server" || fail "the slave ended with $?"
server=
echo 'examples: passed'
