#!/usr/bin/env bash
# The packages under a real systemd: installed, started, hung, killed, used, reloaded, stopped, misconfigured, purged; in a
# small virtual machine, so that this machine stays as it is.
#   service_vm.sh BUILD_DIR [MODE] afm: instead, with a simulated AFM whose tip must not stay out however the unit ends
#                                  stop: instead, a stop while a station presses, with a deadman (quiet machine)
#                                  both: instead, server and guard killed together, with a deadman (likewise; not run to its end yet)
#                                  scan: instead, the first start with a scan, whose fields take longer than systemd waits
# Exit status 77: no virtual machine can be had here (vm.sh says why).
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

# 3: what systemd runs. Every check is a line on standard output.
checks() {
  failed=0
  check() { # words, then a command that must succeed
    local words=$1; shift
    if "$@" >/out/last 2>&1; then echo "ok   $words"; else echo "FAIL $words: $(tail -n 1 /out/last)"; failed=1; fi
  }
  value() { systemctl show -P "$1" telenano-nve; }
  is() { [ "$(value "$1")" = "$2" ] || { echo "$1 is $(value "$1"), not $2"; return 1; }; }
  until_is() { # property value seconds
    local i
    for ((i = 0; i < 10 * $3; ++i)); do [ "$(value "$1")" = "$2" ] && [ "$(value ActiveState)" != activating ] && return 0; sleep 0.1; done
    is "$1" "$2"
  }
  status_of() { grep -E "^$1:" "/proc/$(value MainPID)/status" | awk '{print $2}'; }
  equals() { [ "$1" = "$2" ] || { echo "'$1', not '$2'"; return 1; }; }
  session() { telenano-master run --server 127.0.0.1:5100 --task position --duration-s 1 --rate 200 --quiet; }

  # However the unit ends, the tip of an AFM does not stay out: the guard outlives it. The simulated controller says at its
  # end where the tip was. Its server is patient, since everything is slow here.
  simulate() { : >/tmp/faults; telenano-afm-sim --ports 6501-6504 --control /tmp/faults 2>"/out/$1" & simulator=$!; }
  ended() { kill -TERM "$simulator"; wait "$simulator" || true; grep 'stopped after' "/out/$1"; }
  tip_of() { ended "$1" | grep -q "tip $2" || { tail -n 1 "/out/$1"; return 1; }; }
  silent() { # seconds, simulator: for so long the controller hears nothing; 0: it hears again
    echo "silent $1s" >/tmp/faults
    local i
    for ((i = 0; i < 200; ++i)); do grep -q "silent $1s" "/out/$2" && return 0; sleep 0.05; done
    return 1
  }
  guards() { { grep -la 'afm-guar[d]' /proc/[0-9]*/cmdline 2>/dev/null || true; } | wc -l; }
  until_no_guard() { local i; for ((i = 0; i < 10 * $1; ++i)); do [ "$(guards)" = 0 ] && return 0; sleep 0.1; done; return 1; }
  approve() { telenano-nve afm approve --afm-state /var/lib/telenano; }
  approaches() { grep -c 'afm: approaching' /out/server.log || true; }
  until_approaches() { local i; for ((i = 0; i < 600; ++i)); do [ "$(approaches)" = "$1" ] && return 0; sleep 0.1; done; approaches; return 1; }
  with_an_afm() {
    local i
    # Not in /tmp, which this systemd may clean while the checks run.
    cp /etc/telenano/nve.env /etc/telenano/nve.env.before
    sed -e 's/^link_loss_ms = .*/link_loss_ms = 5000.0/' -e 's/^reply_timeout_ms = .*/reply_timeout_ms = 5000.0\nstale_force_ms = 5000.0/' \
      /usr/share/telenano/afm.toml >/etc/telenano/afm.toml
    echo 'TELENANO_SERVE=--slave nanonis --controller 127.0.0.1 --ports 6501-6504 --afm /etc/telenano/afm.toml --without-deadman --listen 127.0.0.1:5100' \
      >/etc/telenano/nve.env
    # Not there to be reset where systemd has unloaded the unit since it stopped.
    systemctl reset-failed telenano-nve 2>/dev/null || true

    simulate sim1
    check "AFM: starts" systemctl start telenano-nve
    check "AFM: and approaches" until_approaches 1
    check "AFM: with a guard" equals "$(guards)" 1
    check "AFM: in a unit of its own" equals "$(systemctl list-units --no-legend 'telenano-nve-afm-guard@*' | wc -l)" 1
    check "AFM: stops" systemctl stop telenano-nve
    check "AFM: the guard ends too" until_no_guard 20
    check "AFM: stopped, the tip is withdrawn" tip_of sim1 withdrawn

    simulate sim2
    check "AFM: starts again" systemctl start telenano-nve
    check "AFM: a controller that hears nothing" silent 3600 sim2
    check "AFM: is stopped meanwhile" systemctl stop telenano-nve
    check "AFM: the unit is inactive" is ActiveState inactive
    check "AFM: the guard has outlived it" equals "$(guards)" 1
    check "AFM: it hears again" silent 0 sim2
    check "AFM: and the guard ends" until_no_guard 40
    check "AFM: stopped while it heard nothing, the tip is withdrawn" tip_of sim2 withdrawn

    simulate sim3
    # That server could not know that the tip was up: the next one serves, withdrawn, until an operator says so.
    local seen; seen=$(approaches)
    check "AFM: starts a third time" systemctl start telenano-nve
    sleep 2
    check "AFM: and does not approach by itself" equals "$(approaches)" "$seen"
    check "AFM: is approved" approve
    check "AFM: and approaches" until_approaches $((seen + 1))
    check "AFM: silent once more" silent 3600 sim3
    local before; before=$(value MainPID)
    check "AFM: a restart while it hears nothing" systemctl --no-block restart telenano-nve
    for ((i = 0; i < 600; ++i)); do [ "$(value MainPID)" != "$before" ] && [ "$(value MainPID)" != 0 ] && break; sleep 0.1; done
    sleep 2
    check "AFM: the new server waits" is ActiveState activating
    check "AFM: for the guard of the last" equals "$(guards)" 1
    check "AFM: it hears again" silent 0 sim3
    check "AFM: the new server serves" until_is ActiveState active 120
    kill -STOP "$(value MainPID)"
    check "AFM: a hung one is killed and started again" until_is NRestarts 1 60
    check "AFM: and serves" until_is ActiveState active 60
    systemctl --no-block kill --kill-whom=main -s KILL telenano-nve
    check "AFM: a killed one is started again" until_is NRestarts 2 60
    check "AFM: and serves again" until_is ActiveState active 60
    sleep 2
    check "AFM: none of them approached by itself" equals "$(approaches)" $((seen + 1))
    check "AFM: is approved once more" approve
    check "AFM: and approaches" until_approaches $((seen + 2))
    systemctl --no-block kill -s KILL telenano-nve
    check "AFM: one killed with its whole group is started again" until_is NRestarts 3 60
    check "AFM: and serves, as its guard has withdrawn the tip" until_is ActiveState active 60
    check "AFM: stops at last" systemctl stop telenano-nve
    check "AFM: no guard is left" until_no_guard 20
    check "AFM: at last the tip is withdrawn" tip_of sim3 withdrawn
    mv /etc/telenano/nve.env.before /etc/telenano/nve.env
    rm /etc/telenano/afm.toml
  }

  # A stop while a station presses; and what neither server nor guard can do any more, the deadman does.
  press() { # log
    printf 't_s,x_nm,y_nm,z_nm\n0,0,0,20\n2,0,0,20\n8,0,0,-5\n3000,0,0,-5\n' >/tmp/press.csv
    telenano-master run --server 127.0.0.1:5100 --task script --script /tmp/press.csv --duration-s 3000 --rate 200 --rt-priority 0 \
      2>"/out/$1" >/dev/null & station=$!
  }
  says() { # log, words
    local i
    for ((i = 0; i < 900; ++i)); do grep -q "$2" "$1" && return 0; sleep 0.1; done
    tail -n 1 "$1"; return 1
  }
  presses() { says "/out/$1" engaged && sleep 20 && kill -0 "$station"; }
  pressed() { # simulator, least force
    local force; force=$(sed -n 's/.*greatest \([0-9]*\).*/\1/p' "/out/$1" | tail -n 1)
    [ "${force:-0}" -ge "$2" ] && [ "$force" -le 340 ] || { echo "peak force '$force' nN"; return 1; }
  }
  of_server() { sed -n "$((seen + 1)),\$p" /out/server.log; }
  server_says() { local i; for ((i = 0; i < 900; ++i)); do of_server | grep -q "$1" && return 0; sleep 0.1; done; of_server | tail -n 1; return 1; }
  never_says() { ! of_server | grep "$1"; }
  serve_afm() { # more words
    echo "TELENANO_SERVE=--slave nanonis --controller 127.0.0.1 --ports 6501-6503,$(grep -q '^.deadman' /etc/telenano/afm.toml && echo 6514 || echo 6504) --afm /etc/telenano/afm.toml --listen 127.0.0.1:5100 $*" \
      >/etc/telenano/nve.env
    systemctl reset-failed telenano-nve 2>/dev/null || true
    seen=$(wc -l </out/server.log)
  }
  deadman() { /usr/bin/python3 -B "$here/../../deploy/afm/deadman.py" "$@"; }
  with_a_deadman() { # simulator
    touch /out/server.log
    mkdir -p /run/deadman
    deadman new-key /run/deadman/deadman.key >/dev/null
    install -m 600 -o telenano /run/deadman/deadman.key /etc/telenano/server.key
    printf 'listen = "127.0.0.1:6514"\ncontroller = "127.0.0.1:6504"\nkey = "deadman.key"\nsilence_ms = 900\n' >/run/deadman/deadman.toml
    { sed -e 's/^link_loss_ms = .*/link_loss_ms = 5000.0/' -e 's/^reply_timeout_ms = .*/reply_timeout_ms = 5000.0\nstale_force_ms = 5000.0/' \
        /usr/share/telenano/afm.toml; printf '\n[deadman]\nkey = "server.key"\n'; } >/etc/telenano/afm.toml

    simulate "$1"
    # Not by the function above: in the background that is a shell of its own, and a signal would end that alone.
    /usr/bin/python3 -B "$here/../../deploy/afm/deadman.py" run --config /run/deadman/deadman.toml 2>/out/deadman.log & watcher=$!
    check "a deadman" says /out/deadman.log 'connected to the controller'
  }
  without_the_deadman() {
    kill -TERM "$watcher" || true; wait "$watcher" || true
    sed -i '/^\[deadman\]/,$d' /etc/telenano/afm.toml
  }
  stop_in_contact() {
    local i seen station simulator watcher
    with_a_deadman stop1
    serve_afm
    check "stop: starts" systemctl start telenano-nve
    check "stop: the deadman watches" says /out/deadman.log 'watching over the server'
    press station1
    check "stop: a station presses" presses station1
    check "stop: stops" systemctl stop telenano-nve
    check "stop: that was no failure" is Result success
    check "stop: well" is ExecMainStatus 0
    check "stop: the guard ends too" until_no_guard 20
    check "stop: nothing is latched" bash -c '! ls /run/deadman/*.latch'
    kill -TERM "$station" 2>/dev/null || true; wait "$station" || true
    check "stop: the tip is withdrawn" tip_of stop1 withdrawn
    check "stop: and had pressed within its limit" pressed stop1 40
    without_the_deadman
  }
  both_killed() {
    local i seen station simulator watcher
    with_a_deadman deadman1
    serve_afm
    check "deadman: starts" systemctl start telenano-nve
    press station3
    check "deadman: a station presses" presses station3
    # Neither sees the other die.
    systemctl kill -s STOP telenano-nve || true
    systemctl kill -s KILL 'telenano-nve-afm-guard@*' || true
    systemctl --no-block kill -s KILL telenano-nve || true
    check "deadman: withdraws the tip" says /out/deadman.log 'the tip is withdrawn'
    check "deadman: keeps that" ls /run/deadman/deadman.latch
    check "deadman: the restarted server is told" server_says 'has withdrawn the tip: look at it'
    check "deadman: which is not tried for ever" until_is ActiveState failed 60
    kill -TERM "$station" 2>/dev/null || true; wait "$station" || true
    check "deadman: is cleared" deadman clear --config /run/deadman/deadman.toml
    systemctl reset-failed telenano-nve 2>/dev/null || true
    seen=$(wc -l </out/server.log)
    check "deadman: then the server starts" systemctl start telenano-nve
    check "deadman: without an approach" never_says 'afm: approaching'
    check "deadman: is approved" approve
    check "deadman: and approaches" server_says 'afm: approaching'
    check "deadman: stops" systemctl stop telenano-nve
    check "deadman: no guard is left" until_no_guard 20
    kill -TERM "$watcher" || true; wait "$watcher" || true
    check "deadman: the tip is withdrawn at last" tip_of deadman1 withdrawn
  }

  serving() {
    check "starts, and says when it is ready" systemctl start telenano-nve
    check "runs as its own user" equals "$(stat -c %U "/proc/$(value MainPID)")" telenano
    check "no new privileges" equals "$(status_of NoNewPrivs)" 1
    check "no capability" equals "$(status_of CapBnd)" 0000000000000000
    check "system calls filtered" equals "$(status_of Seccomp)" 2
    check "may run in real time" grep -q 'Max realtime priority *90' "/proc/$(value MainPID)/limits"
    check "may lock memory" grep -q 'Max locked memory *unlimited' "/proc/$(value MainPID)/limits"
    check "serves a station" session
    check "tells its state" grep -qE '^[0-9]+ sessions|^serving' <(value StatusText)
    local first; first=$(value MainPID)
    check "reloads" systemctl reload telenano-nve
    sleep 1
    check "is the same process after a reload" is MainPID "$first"
    kill -STOP "$first"
    check "a hung one is killed and started again" until_is NRestarts 1 20
    kill -KILL "$(value MainPID)"
    check "a killed one is started again" until_is NRestarts 2 20
    check "serves a station again" session
    check "stops" systemctl stop telenano-nve
    check "ended well" is ExecMainStatus 0
    sed -i 's/flat_silicon_oxide/nowhere/' /etc/telenano/nve.env
    systemctl start telenano-nve 2>/dev/null || true
    sleep 2
    check "a wrong scene is told once, not tried for ever" is ExecMainStatus 2
    check "and is a failure" is ActiveState failed
    sed -i 's/nowhere/flat_silicon_oxide/' /etc/telenano/nve.env
    check "starts when mended" systemctl start telenano-nve
    check "is removed" dpkg --purge telenano-server
    check "and stopped by that" is ActiveState inactive
    check "nothing is left" bash -c '! ls -d /etc/telenano /var/lib/telenano /lib/systemd/system/telenano* /usr/lib/systemd/system/telenano* 2>/dev/null | grep .'
  }

  # Some minutes here, where no processor computes; the unit's own limit would be 90 s.
  first_start_with_a_scan() {
    sed -i 's/flat_silicon_oxide/flakes/' /etc/telenano/nve.env
    systemctl --no-block start telenano-nve
    local i
    for ((i = 0; i < 600; ++i)); do value StatusText | grep -q '^making the fields' && break; sleep 0.1; done
    check "tells what it does" grep -q '^making the fields' <(value StatusText)
    check "stops while it does" systemctl stop telenano-nve
    check "at once, and well" is ExecMainStatus 0
    check "was not killed" is Result success
    check "starts, however long it takes" systemctl start telenano-nve
    check "serves a station" session
    check "starts again from what it has kept" timeout 60 systemctl restart telenano-nve
  }

  case ${1:-} in
    afm) with_an_afm ;;
    stop) stop_in_contact ;;
    both) both_killed ;;
    scan) first_start_with_a_scan ;;
    *) serving ;;
  esac
  echo "failed $failed"
}

# 2: in the machine: installs, then a systemd of its own that runs the checks.
inside() {
  mount -t cgroup2 cgroup2 /sys/fs/cgroup
  mount -t tmpfs run /run
  # Dependencies are this machine's: the programs were built here.
  dpkg --install --force-depends /out/telenano-common_*.deb /out/telenano-server_*.deb /out/telenano-station_*.deb >/out/install.log 2>&1 ||
    { tail -n 5 /out/install.log; exit 1; }
  # A scene that needs no fields: nothing here is quick.
  sed -i 's/flakes/flat_silicon_oxide/' /etc/telenano/nve.env
  cat >/etc/systemd/system/checks.service <<UNIT
[Unit]
DefaultDependencies=no
[Service]
Type=oneshot
ExecStart=/bin/bash $here/service_vm.sh --checks ${1:-}
StandardOutput=append:/out/checks.log
StandardError=append:/out/checks.log
ExecStopPost=/bin/systemctl exit 0
UNIT
  # The service wants a network and a whole system to be up; here there is only what it needs. There is no journal either:
  # what the server says goes to a file.
  mkdir -p /etc/systemd/system/telenano-nve.service.d
  printf '[Unit]\nDefaultDependencies=no\nWants=\nAfter=\n[Service]\nStandardOutput=append:/out/server.log\nStandardError=append:/out/server.log\n' \
    >/etc/systemd/system/telenano-nve.service.d/alone.conf
  env -i container=vm PATH="$PATH" unshare --fork --pid --mount-proc /lib/systemd/systemd --unit=checks.service --log-target=console \
    --show-status=0 >/out/systemd.log 2>&1
}

case ${1:-} in
  --checks) checks "${2:-}"; exit ;;
  --inside) inside "${2:-}"; exit ;;
  '') sed -n '2,7p' "$0"; exit 2 ;;
esac

[ -x /lib/systemd/systemd ] || { echo "service_vm: cannot run here: systemd is not installed" >&2; exit 77; }
build=$(realpath "$1")
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
bash "$here/vm.sh" --help >/dev/null
(cd "$build" && cpack -B "$out") >"$out/cpack.log" 2>&1 || { tail -n 5 "$out/cpack.log"; exit 1; }
bash "$here/vm.sh" --out "$out" --seconds 1500 "$here/service_vm.sh" --inside "${2:-}" || { rc=$?; [ "$rc" = 77 ] || cat "$out"/*.log; exit "$rc"; }
cat "$out/checks.log"
grep -q '^failed 0$' "$out/checks.log" || { tail -n 40 "$out/systemd.log"; exit 1; }
