#!/usr/bin/env bash
# Draws viewer.png: the simulated hand presses on the scan, seen by the station's own picture. Needs a build, no display.
source "$(dirname "${BASH_SOURCE[0]}")/../lib.sh"
bin=$project/build/release/bin data=$project/deploy/data
[ -x "$bin/telenano-master" ] || die "build first: bash deploy/demo.sh"
log=$(mktemp)
"$bin/telenano-nve" serve --scene "$project/deploy/scenes/flakes.toml" --listen 127.0.0.1:5190 2>"$log" & server=$!
trap 'kill $server 2>/dev/null; rm -f "$log"' EXIT
for i in $(seq 50); do grep -q serving "$log" && break; sleep 0.1; done
"$bin/telenano-master" run --server 127.0.0.1:5190 --device sim --task indent --duration-s 10 --quiet \
  --surface "$data/wsxm_600nm.gsf" --screenshot "$project/deploy/pictures/viewer.png" --at 4.6 2>&1 | tail -n 1
say "$project/deploy/pictures/viewer.png"
