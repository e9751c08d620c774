#!/usr/bin/env python3
"""Hazards of an AFM that are neither a lost connection nor a dead signal, with the real programs over TCP: the latch on disk, ports
that are not the last run's, two stations, two deadmen, a termination while the tip presses, withdrawals that are answered and not
done, a controller that is slow in the checks, a signal that dips.

afm_hazards_test.py SOURCE_DIR TELENANO_NVE TELENANO_AFM_SIM TELENANO_MASTER [unittest's arguments]
"""
import pathlib
import re
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
import unittest
import urllib.request

sys.path[:0] = [str(pathlib.Path(__file__).parent)]
import deadman_test  # noqa: E402
import nanonis  # noqa: E402
import side_by_side  # noqa: E402
from deadman_test import LONG_S, MASTER, NVE  # noqa: E402

LIMIT_NN = 300
LATE_NN = 40  # one step of the base, by the lever


class Base(deadman_test.Rig):
    def serve_words(self, **options):
        """The patience that a machine with many programs needs: no real-time promise here."""
        words = super().serve_words(**options)
        text = (self.path / "afm.toml").read_text()
        (self.path / "afm.toml").write_text(text.replace("_ms = 1000.0", "_ms = 3000.0"))
        return words

    def deadman(self, silence_ms=900, **options):
        """As patient as one may be: how soon it withdraws is another file's."""
        return super().deadman(silence_ms=silence_ms, **options)

    def direct(self, *flags):
        """Words of a server without a deadman."""
        return [*self.serve_words(with_deadman=False), "--without-deadman", *flags]

    def serving(self, *flags):
        program = self.start(*self.direct(*flags))
        self.assertTrue(program.says("serving an AFM on"), program.text)
        return program

    def latches(self):
        return sorted(path.name for path in self.path.glob("*.out"))

    def end_of(self, simulator):
        """Whether the tip is up, and the rig's own greatest force, in nN."""
        text = simulator.stop()
        return "tip withdrawn" in text, float(re.search(r"greatest ([0-9.]+)", text)[1]), text

    SETTINGS = ("SafeTip.OnOffGet", "SafeTip.PropsGet", "ZCtrl.LimitsEnabledGet", "ZCtrl.LimitsGet", "FolMe.SpeedGet",
                "Util.AcqPeriodGet", "ZCtrl.TipLiftGet", "ZCtrl.SwitchOffDelayGet", "ZCtrl.WithdrawRateGet")

    def settings(self):
        """What the controller is set to; while no server is connected."""
        client = nanonis.Client("127.0.0.1", self.ports[0])
        try:
            return {name: client.call(name) for name in self.SETTINGS}
        finally:
            client.close()

    def press(self, server, *words, to_nm=-5):
        (self.path / "press.csv").write_text(f"t_s,x_nm,y_nm,z_nm\n0,0,0,20\n0.5,0,0,20\n1.5,0,0,{to_nm}\n600,0,0,{to_nm}\n")
        port = re.search(r"serving an AFM on 127\.0\.0\.1:(\d+)", server.text)[1]
        return self.start(MASTER, "run", "--server", f"127.0.0.1:{port}", "--task", "script", "--script", self.path / "press.csv",
                          "--duration-s", "600", "--rt-priority", "0", *words)

    def contact(self, station):
        self.assertTrue(station.says("engaged"), station.text)
        time.sleep(3)
        self.assertIsNone(station.process.poll(), station.text)


class Hazards(Base):
    def refused_where_nothing_moves(self, simulator, words, expected, **how):
        done = subprocess.run([str(w) for w in words], capture_output=True, text=True, timeout=LONG_S, check=False, **how)
        self.assertNotEqual(done.returncode, 0)
        self.assertRegex(done.stderr, expected)
        up, _, text = self.end_of(simulator)
        self.assertTrue(up)
        self.assertIn("; 0 calls that move", text)
        return done

    def test_a_latch_that_cannot_be_written_moves_nothing(self):
        """A full disk, as far as a process can have one of its own: not a byte may be written into files."""
        simulator = self.simulator()

        def full():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
        done = self.refused_where_nothing_moves(simulator, self.direct(), "the latch of the AFM's tip .*cannot be written",
                                                preexec_fn=full, restore_signals=False)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertEqual(self.latches(), [])

    def test_a_latch_that_is_none_moves_nothing(self):
        for make, expected in (
                (lambda p: p.write_text("nonsense\n"), "this is no latch"),
                (lambda p: p.write_bytes(b"\0" * 64), "this is no latch"),
                (lambda p: p.write_text(""), "this is no latch"),
                (lambda p: p.mkdir(), "is not a plain file"),
                (lambda p: p.symlink_to("/none"), "cannot be read"),
                (lambda p: (p.write_text("0123456789abcdef\n"), p.chmod(0o644)), "chmod 600")):
            with self.subTest(expected):
                simulator = self.simulator()
                latch = self.path / f"afm-127.0.0.1_{self.ports[3]}.out"
                make(latch)
                if not latch.is_symlink() and latch.is_file() and "chmod" not in expected:
                    latch.chmod(0o600)
                self.refused_where_nothing_moves(simulator, self.direct(), expected)
                if latch.is_dir() and not latch.is_symlink():
                    latch.rmdir()
                else:
                    latch.unlink()

    def test_a_copy_of_the_state_of_another_machine_asks_for_an_operator(self):
        simulator = self.simulator()
        latch = self.path / f"afm-127.0.0.1_{self.ports[3]}.out"
        latch.write_text("0123456789abcdef\n")
        latch.chmod(0o600)
        server = self.serving()
        self.assertIn("did not end with the tip withdrawn", server.text)
        self.assertNotIn("approaching", server.text)
        server.stop()
        self.assertEqual(self.latches(), [latch.name], "still nobody has looked")
        self.assertTrue(self.end_of(simulator)[0])

    def test_a_latch_that_is_half_written_asks_for_an_operator(self):
        """Cut off by a power failure: what is left of its id still says that the tip may be out; and what was begun beside it
        is no latch."""
        simulator = self.simulator()
        latch = self.path / f"afm-127.0.0.1_{self.ports[3]}.out"
        latch.write_text("0123")
        latch.chmod(0o600)
        (self.path / (latch.name + ".abcdef")).write_text("")
        server = self.serving()
        self.assertIn("did not end with the tip withdrawn", server.text)
        time.sleep(0.5)
        self.assertNotIn("approaching", server.text)
        approved = subprocess.run([NVE, "afm", "approve", "--afm-state", self.path], capture_output=True, text=True, check=False)
        self.assertEqual(approved.returncode, 0, approved.stderr)
        self.assertTrue(server.says("surface found"), server.text)
        self.assertRegex(latch.read_text(), "^[0-9a-f]{16}\n$", "written whole before anything moves")
        server.stop()
        self.assertEqual(self.latches(), [])
        self.assertTrue(self.end_of(simulator)[0])

    def test_an_approval_on_a_full_disk_is_none(self):
        simulator = self.simulator()
        latch = self.path / f"afm-127.0.0.1_{self.ports[3]}.out"
        latch.write_text("0123456789abcdef\n")
        latch.chmod(0o600)
        server = self.serving()

        def full():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
        approved = subprocess.run([NVE, "afm", "approve", "--afm-state", self.path], capture_output=True, text=True, check=False,
                                  preexec_fn=full, restore_signals=False)
        self.assertEqual(approved.returncode, 1, approved.stderr)
        self.assertRegex(approved.stderr, "the approval .*cannot be written")
        self.assertEqual(len(approved.stderr.strip().splitlines()), 1, approved.stderr)
        time.sleep(1)
        self.assertNotIn("approaching", server.text)
        server.stop()
        self.assertEqual(self.latches(), [latch.name])
        self.assertTrue(self.end_of(simulator)[0])

    def test_a_latch_of_another_port_of_the_same_controller_counts(self):
        """Killed without a deadman, started again with one: the emergency port is another, the tip the same."""
        simulator = self.simulator()
        server = self.serving()
        server.kill(signal.SIGKILL)
        server.process.wait(LONG_S)
        self.assertEqual(self.latches(), [f"afm-127.0.0.1_{self.ports[3]}.out"])
        end = time.monotonic() + LONG_S
        while any("afm-guard" in text for text in self.guards()) and time.monotonic() < end:
            time.sleep(0.05)
        watcher = self.deadman()
        again = self.server()
        self.assertIn("did not end with the tip withdrawn", again.text)
        time.sleep(0.5)
        self.assertNotIn("approaching", again.text)
        approved = subprocess.run([NVE, "afm", "approve", "--afm-state", self.path], capture_output=True, text=True, check=False)
        self.assertEqual(approved.returncode, 0, approved.stderr)
        self.assertTrue(again.says("surface found"), f"{again.text}\n{watcher.text}")
        self.assertEqual(self.latches(), [f"afm-127.0.0.1_{self.port}.out"], "one tip, one latch")
        again.stop()
        self.assertEqual(self.latches(), [])
        self.assertTrue(self.end_of(simulator)[0])

    def guards(self):
        mine = f"127.0.0.1:{self.ports[3]}"
        for path in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
            try:
                text = path.read_text()
            except OSError:
                continue  # it has ended meanwhile
            if mine in text.split("\0"):
                yield text

    def test_a_running_servers_latch_on_the_same_host_is_its_own(self):
        first = self.simulator()
        one = self.serving()
        ports = self.ports
        second = self.simulator()
        other = self.serving()
        self.assertNotIn("did not end with the tip withdrawn", other.text)
        self.assertTrue(other.says("surface found"), other.text)
        self.assertEqual(len(self.latches()), 2)
        for server in (one, other):
            server.stop()
        self.assertEqual(self.latches(), [])
        self.assertTrue(self.end_of(first)[0] and self.end_of(second)[0])
        self.ports += ports

    def test_a_second_station_does_not_move_the_tip(self):
        simulator = self.simulator()
        server = self.serving()
        first = self.press(server)
        self.contact(first)
        second = self.press(server)
        self.assertTrue(second.says("\n"))
        time.sleep(3)
        self.assertNotIn("engaged", second.text, "the tip is the first one's")
        second.stop()
        self.assertIsNone(first.process.poll(), first.text)
        self.assertNotIn("withdrawing", server.text.partition("surface found")[2], server.text)
        first.stop()
        server.stop()
        up, force_nn, text = self.end_of(simulator)
        self.assertTrue(up, text)
        self.assertGreater(force_nn, 20)
        self.assertLess(force_nn, LIMIT_NN)

    def test_a_second_deadman_gets_no_port_and_disturbs_nothing(self):
        simulator = self.simulator()
        watcher = self.deadman()
        port = self.port
        server = self.server()
        self.assertTrue(watcher.says("watching over the server"))
        (self.path / "second.toml").write_text(
            f'listen = "127.0.0.1:0"\ncontroller = "127.0.0.1:{self.ports[3]}"\nkey = "deadman.key"\nlog = "second.log"\n')
        second = self.start(sys.executable, "-B", deadman_test.SOURCE / "deploy/afm/deadman.py", "run", "--config",
                            self.path / "second.toml")
        time.sleep(3)
        self.assertIn("surface found", server.text)
        self.assertNotIn("withdrawing", server.text, f"{watcher.text}\n{second.text}")
        second.stop()
        self.port = port
        killed = self.kill_both(server)
        self.assertTrue(watcher.says("the tip is withdrawn"), watcher.text)
        print(f"with two deadmen: withdrawn {time.monotonic() - killed:.2f} s after the death of server and guard", file=sys.stderr)
        self.assertTrue(self.end_of(simulator)[0])

    def test_a_termination_withdraws_what_presses(self):
        simulator = self.simulator()
        self.before = self.settings()
        server = self.serving()
        station = self.press(server, "--give-up-s", "1")
        self.contact(station)
        server.kill(signal.SIGTERM)
        self.assertEqual(server.process.wait(LONG_S), 0, server.text)
        self.assertTrue(station.says("the server is shutting down: the force is zero"), station.text)
        self.assertRegex(server.text, "withdrawn: (exit|stop)")
        self.assertEqual(self.latches(), [])
        self.assertEqual(self.settings(), self.before, "given back")
        up, force_nn, text = self.end_of(simulator)
        self.assertTrue(up, text)
        self.assertGreater(force_nn, 20, "it did press")
        self.assertLess(force_nn, LIMIT_NN + LATE_NN)
        self.assertIn("SafeTip 0 times", text)

    def test_a_signal_that_dips_lets_the_tip_no_deeper(self):
        control = self.path / "faults.txt"
        simulator = self.simulator("--control", control)
        server = self.serving()
        station = self.press(server, "--force-scale", "1e6", to_nm=-20)  # so that the force does not push the hand back
        self.contact(station)
        time.sleep(2)
        for depth_nm, length_ms in ((4, 12), (8, 12), (4, 30), (8, 30)):
            control.write_text(f"dip {depth_nm}nm {length_ms}ms\n")
            self.assertTrue(simulator.says(f"dip {depth_nm}nm {length_ms}ms"), simulator.text)
            time.sleep(0.5)
        station.stop()
        server.stop()
        up, force_nn, text = self.end_of(simulator)
        self.assertTrue(up, text)
        print(f"a signal that dips: pressed with {force_nn} nN of {LIMIT_NN}", file=sys.stderr)
        self.assertGreater(force_nn, 0.95 * LIMIT_NN, "held by the limit")
        self.assertLess(force_nn, LIMIT_NN + 5, "noise, thermal bending since the tare")

    def test_what_is_published(self):
        self.simulator()
        server = self.serving("--metrics", "127.0.0.1:0")

        page = re.search(r"metrics at (http://\S+)", server.text)[1]
        time.sleep(1)
        text = urllib.request.urlopen(page, timeout=LONG_S).read().decode()
        self.assertIn("telenano_afm_following 1", text)
        bound_m = float(re.search(r"^telenano_afm_surface_bound_metres (\S+)", text, re.MULTILINE)[1])
        self.assertGreater(bound_m, 0.1e-9)
        self.assertLess(bound_m, 20e-9)
        server.stop()


class Withdrawals(Base):
    """Answered as if they were done. The server is killed while it presses: the tip is its guard's."""

    def killed_while_it_presses(self, fault, sign=1, range_nm=1000, withdraw_nm_s=20000):
        control = self.path / "faults.txt"
        simulator = self.simulator("--control", control, "--z-sign", sign, "--range-z-nm", range_nm)
        words = self.direct()
        text = (self.path / "afm.toml").read_text()
        for key, was, now in (("z_sign", "1", sign), ("withdraw_nm_s", "20000.0", withdraw_nm_s)):
            self.assertIn(f"\n{key} = {was} ", text)
            text = text.replace(f"\n{key} = {was} ", f"\n{key} = {float(now) if '.' in was else now} ")
        (self.path / "afm.toml").write_text(text)
        server = self.start(*words)
        self.assertTrue(server.says("serving an AFM on"), server.text)
        self.contact(self.press(server))
        control.write_text(fault + "\n")
        self.assertTrue(simulator.says(fault), simulator.text)
        server.kill(signal.SIGKILL)
        server.process.wait(LONG_S)
        return simulator, server, control

    def told(self, server):
        """What its guard has said: lines of one pipe."""
        return re.findall(r"afm-guard: (.*)", server.text)

    def ends_up(self, simulator, server, least_nm=489):
        self.assertTrue(server.says("afm-guard: the tip is withdrawn, at Z = "), server.text)
        last = self.told(server)[-1]
        self.assertGreaterEqual(abs(float(re.search(r"at Z = (-?[0-9.]+) nm", last)[1])), least_nm, last)
        _, force_nn, text = self.end_of(simulator)
        self.assertGreaterEqual(float(re.search(r"tip \w+ at ([0-9.]+) nm", text)[1]), least_nm, text)
        self.assertGreater(force_nn, 20, "it did press")
        self.assertLess(force_nn, LIMIT_NN + LATE_NN)

    def test_one_that_is_not_done_is_no_withdrawn_tip(self):
        for sign in (1, -1):
            with self.subTest(sign):
                simulator, server, control = self.killed_while_it_presses("withdraw undone ever", sign)
                self.assertTrue(server.says("afm-guard: the tip is NOT up: Z = "), server.text)
                time.sleep(3)
                said = self.told(server)
                self.assertEqual(len(said), 1, "once in ten seconds")
                z_nm, up_nm = map(float, re.match(r"the tip is NOT up: Z = (-?[0-9.]+) nm, up is (-?[0-9.]+) nm; withdrawing it "
                                                  r"again; press Withdraw at the controller$", said[0]).groups())
                self.assertLess(abs(z_nm), 50, "at the sample")
                self.assertEqual(up_nm, 500 * sign)
                self.assertNotIn("is up again", simulator.text)
                # Done at the fourth of those that come now.
                control.write_text("withdraw undone 3\n")
                self.ends_up(simulator, server, 499.9)
                self.assertEqual(len(self.told(server)), 2)
                for latch in self.path.glob("*.out"):
                    latch.unlink()

    def test_the_eleventh_is_done(self):
        simulator, server, _ = self.killed_while_it_presses("withdraw undone 10")
        self.ends_up(simulator, server, 499.9)
        self.assertIn("NOT up", self.told(server)[0])

    def test_a_slow_one_is_not_up_before_it_is(self):
        """Five seconds, where the guard waits for two."""
        simulator, server, _ = self.killed_while_it_presses("withdraw undone 0", range_nm=10000, withdraw_nm_s=1000)
        self.ends_up(simulator, server, 4890)
        self.assertRegex(self.told(server)[0], r"NOT up: Z = [12]\d\d\d\.\d nm, up is 5000.0 nm")

    def test_ones_that_stop_half_way_get_there(self):
        simulator, server, _ = self.killed_while_it_presses("withdraw half ever")
        self.ends_up(simulator, server)
        self.assertRegex(self.told(server)[0], r"NOT up: Z = 2\d\d\.\d nm, up is 500.0 nm")


class Port:
    """Stands before a port of the controller, passes everything on, and notes the requests' names; `act` is called with each name
    before its request goes on."""

    def __init__(self, port, act=lambda name: None):
        self.names, self.act = [], act
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.to = port
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        near, _ = self.listener.accept()
        self.listener.close()
        far = socket.create_connection(("127.0.0.1", self.to))
        threading.Thread(target=self.copy, args=(far, near), daemon=True).start()
        self.copy(near, far, self.note)

    def note(self, data):
        """Requests come one at a time, each in one piece on the loopback."""
        self.names.append(data[:32].rstrip(b"\0").decode())
        self.act(self.names[-1])

    def copy(self, source, target, note=None):
        with source, target:
            try:
                while data := source.recv(65536):
                    if note:
                        note(data)
                    target.sendall(data)
            except OSError:
                pass  # the other end has closed


class Checks(Base):
    """The guard waits for 2 s of silence here; as many replies as the checks need, 60 ms late each, take longer."""
    FLAGS = ("--fault", "slow 3600s 60ms")

    def words_by(self, index, act=lambda name: None):
        """Of a server that reaches one of the controller's ports through this test."""
        through = Port(self.ports[index], act)
        words = self.direct()
        ports = list(self.ports)
        ports[index] = through.port
        words[words.index("--ports") + 1] = ",".join(map(str, ports))
        text = (self.path / "afm.toml").read_text()
        (self.path / "afm.toml").write_text(text.replace("reply_timeout_ms = 3000.0", "reply_timeout_ms = 500.0"))
        self.port = through.port  # of its guard, for the end
        return through, words

    def test_a_controller_that_answers_late_is_no_silent_server(self):
        simulator = self.simulator(*self.FLAGS)
        emergency, words = self.words_by(3)
        started = time.monotonic()
        server = self.start(*words)
        self.assertTrue(server.says("approaching"), server.text)
        self.assertGreater(time.monotonic() - started, 2.5, "else nothing is shown")
        self.assertTrue(server.says("surface found"), server.text)
        self.assertEqual(set(emergency.names), {"ZCtrl.StatusGet", "ZCtrl.ZPosGet", "Piezo.RangeGet"}, "no withdrawal")
        server.stop()
        self.assertTrue(self.end_of(simulator)[0])

    def test_the_guard_watches_before_the_first_motion(self):
        """A server that is killed, or hangs, between the first command that moves the tip and its execution."""
        for number in (signal.SIGKILL, signal.SIGSTOP):
            with self.subTest(number):
                simulator = self.simulator()
                started = threading.Event()

                def act(name):
                    if name == "ZCtrl.OnOffSet" and not started.is_set():
                        server.kill(number)
                        started.set()
                _, words = self.words_by(0, act)
                server = self.start(*words)
                self.assertTrue(started.wait(LONG_S), server.text)
                self.assertTrue(simulator.says("is up again"), simulator.text)
                server.stop(signal.SIGKILL)
                if number == signal.SIGKILL:
                    self.assertTrue(server.says("afm-guard: the tip is withdrawn"), server.text)
                self.assertTrue(self.end_of(simulator)[0])
                for latch in self.path.glob("*.out"):
                    latch.unlink()


if __name__ == "__main__":
    sys.exit(side_by_side.main(4, at_once=2))  # each case waits for most of its time
