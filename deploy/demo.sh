#!/usr/bin/env bash
# Takes a fresh Debian 12 or 13 all the way to a recorded session: installs what is missing, configures, builds, then runs a
# server and a station as two processes over loopback UDP, with a simulated Omega and a simulated hand: the three tasks of
# Kim & Sitti on a real AFM scan, then silicon oxide at a scaling that oscillates without control. Ends with a report.
# With --view instead: the same scan in a window, and the mouse is the hand.
source "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
usage() {
  cat <<'H'
usage: deploy/demo.sh [--no-install] [--view] [--out DIR]
  --no-install   do not call apt; fail if something is missing
  --view         no tasks and no report: a window on the scan, with your mouse as the hand, until you close it
  --out DIR      where recordings and report go (default: demo-out; an earlier demo there is replaced)
H
}
parse_common_flags "$@"
out=$project/demo-out
view=no
while [ ${#rest[@]} -gt 0 ]; do
  case ${rest[0]} in
    --out) [ ${#rest[@]} -ge 2 ] || { usage >&2; exit 2; }; out=$(realpath -m "${rest[1]}"); rest=("${rest[@]:2}") ;;
    --view) view=yes; rest=("${rest[@]:1}") ;;
    *) printf 'error: unknown argument %s\n' "${rest[0]}" >&2; usage >&2; exit 2 ;;
  esac
done
if [ "$view" = yes ] && [ -z "${DISPLAY:-}${WAYLAND_DISPLAY:-}" ]; then
  die "--view: there is no display; log in graphically or with ssh -X" 2
fi
[ "$install" = no ] || install_missing "${build_packages[@]}"
if [ "$view" = yes ]; then configure_and_build telenano-nve telenano-master
else configure_and_build telenano-nve telenano-master telenano-lab; fi

bin=$project/build/release/bin scenes=$project/deploy/scenes
mkdir -p "$out/recordings"
rm -f "$out"/recordings/*.h5 "$out"/*.csv "$out"/*.log
rm -rf "$out/report"

server=
stop_server() { [ -z "$server" ] || { kill -TERM "$server" 2>/dev/null && wait "$server" 2>/dev/null; server=; } || true; }
trap stop_server EXIT
start_server() { # scene; sets $address
  local port
  for port in $(seq 5100 5119); do
    "$bin/telenano-nve" serve --scene "$scenes/$1" --listen "127.0.0.1:$port" 2>>"$out/server.log" & server=$!
    address=127.0.0.1:$port
    local i
    for i in $(seq 50); do
      kill -0 "$server" 2>/dev/null || break
      if grep -q "serving .*127.0.0.1:$port" "$out/server.log"; then return 0; fi
      sleep 0.1
    done
    if kill -0 "$server" 2>/dev/null; then die "the server did not say that it serves; see $out/server.log"; fi
    wait "$server" || true; server=
    tail -n 1 "$out/server.log" | grep -q "in use" || { tail -n 3 "$out/server.log" >&2; die "the server did not start; see $out/server.log"; }
  done
  die "no free port in 5100-5119"
}

run() { # label, then arguments of telenano-master run
  local label=$1; shift
  say "$label"
  "$bin/telenano-master" run --server "$address" --device sim --rate 1000 "$@"
}

say "Server: a real AFM scan (flakes on a flat substrate, 600 x 600 nm)"
start_server flakes.toml
if [ "$view" = yes ]; then
  say "Your mouse is the hand: drag down in the right picture until you touch. F1 tells the keys; close the window to end"
  status=0
  "$bin/telenano-master" run --server "$address" --device mouse --surface "$project/deploy/data/wsxm_600nm.gsf" \
    --record "$out/recordings/mouse.h5" || status=$?
  stop_server
  exit "$status"
fi
run "Task (a): hold 10-20 nm above the surface"  --task position --record "$out/recordings/position.h5"
run "Task (b): just in contact"                  --task contact  --record "$out/recordings/contact.h5"
run "Task (c): below the surface"                --task indent   --record "$out/recordings/indent.h5"
run "Scanning lines in light contact"            --task scan     --record "$out/recordings/scan.h5"
stop_server

say "Server: flat silicon oxide, at a scaling that oscillates without control"
start_server flat_silicon_oxide.toml
# The force scale asks the device to show 11 times the stiffness that it can show passively at 1 kHz with one sample of
# delay; the force limit stays on.
unsafe=(--velocity-scale 1e-6 --force-scale 8e8 --allow-unsafe-scaling --task indent)
run "Without control (KS fig. 13)"               --method none     "${unsafe[@]}" --record "$out/recordings/sio2_none.h5" ||
  say "The station stopped this run itself, as it should when the hand gets too fast; its recording is kept"
# Published without a bound: on a busy machine, with late ticks, the hand may get too fast here too.
run "KS's controller as published"               --method ks       "${unsafe[@]}" --record "$out/recordings/sio2_ks.h5" ||
  say "The station stopped this run itself, too; its recording is kept"
run "With an energy clamp, ks-clamp"             --method ks-clamp "${unsafe[@]}" --record "$out/recordings/sio2_ks_clamp.h5"
run "With a local model (KS fig. 14)"    --method model    "${unsafe[@]}" --record "$out/recordings/sio2_model.h5"
stop_server

say "Force against distance on silicon oxide, approach and retract (KS fig. 6)"
"$bin/telenano-nve" curve --scene "$scenes/flat_silicon_oxide.toml" --from-nm 20 --to-nm -5 --step-nm 0.01 >"$out/curve.csv"

say "Report"
r=$out/recordings
"$bin/telenano-lab" report --out "$out/report" --title "Telenano demo" --curve "$out/curve.csv" \
  --run "Task (a): position=$r/position.h5" --run "Task (b): contact=$r/contact.h5" \
  --run "Task (c): indent=$r/indent.h5" --run "Scan=$r/scan.h5" \
  --run "Silicon oxide, no control=$r/sio2_none.h5" --run "Silicon oxide, ks=$r/sio2_ks.h5" \
  --run "Silicon oxide, ks-clamp=$r/sio2_ks_clamp.h5" --run "Silicon oxide, model=$r/sio2_model.h5" \
  --pair "none=$r/sio2_none.h5" --pair "ks=$r/sio2_ks.h5" --pair "model=$r/sio2_model.h5"
say "Open $out/report/index.html"
