#!/usr/bin/env python3
"""The deadman (deploy/afm/deadman.py) with the real programs over TCP: a simulated controller, the server and its guard.

deadman_test.py SOURCE_DIR TELENANO_NVE TELENANO_AFM_SIM TELENANO_MASTER [unittest's arguments]
"""
import hashlib
import hmac
import os
import pathlib
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest

SOURCE, NVE, SIM, MASTER = (pathlib.Path(a).resolve() for a in sys.argv[1:5])
sys.path[:0] = [str(SOURCE / "deploy/afm"), str(SOURCE / "tests/second_implementation")]
sys.dont_write_bytecode = True
import deadman  # noqa: E402
import nanonis  # noqa: E402
import side_by_side  # noqa: E402

LONG_S = 60
PATIENT_MS = 900  # the longest that a deadman may wait, where its time is not what is tested
KEY = bytes(range(32))
QUIET, WATCH, DONE = 0, 1, 2
READY, LATCHED, IN_USE, NO_CONTROLLER = 0, 1, 2, 3


class StandStills:
    """When a processor stood still, as those of a virtual machine do: each silence that a deadman waits for has then been there."""

    def __init__(self):
        self.seen = []
        self.started = False

    def start(self):
        """Once in a process; again is nothing."""
        if self.started:
            return
        self.started = True
        for processor in os.sched_getaffinity(0):
            threading.Thread(target=self.watch, args=(processor,), daemon=True).start()

    def watch(self, processor):
        os.sched_setaffinity(0, {processor})  # of this thread
        last = time.monotonic()
        while True:
            time.sleep(0.005)
            now = time.monotonic()
            if now - last > 0.15:
                self.seen.append(now - last)
            last = now


STAND_STILLS = StandStills()


def in_netns(name):
    """As `ip netns exec`, which mounts /sys anew and so does not work where / is no mount (a chroot)."""
    return ["nsenter", f"--net=/run/netns/{name}", "--"]


class Program:
    """A process whose standard error is kept."""

    def __init__(self, *words, netns=None):
        words = [str(w) for w in words]
        if netns:
            words = [*in_netns(netns), *words]
        self.process = subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        self.text, self.news = "", threading.Condition()
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def read(self):
        for line in self.process.stderr:
            with self.news:
                self.text += line
                self.news.notify_all()
        with self.news:
            self.news.notify_all()

    def says(self, text, timeout=LONG_S):
        end = time.monotonic() + timeout
        with self.news:
            while text not in self.text:
                left = end - time.monotonic()
                if left <= 0 or (not self.reader.is_alive() and text not in self.text):
                    return False
                self.news.wait(min(left, 0.5))
        return True

    def kill(self, number=signal.SIGKILL):
        self.process.send_signal(number)

    def stop(self, number=signal.SIGTERM):
        if self.process.poll() is None:
            self.kill(number)
        self.process.wait(LONG_S)
        self.reader.join(5)
        if not self.reader.is_alive():
            self.process.stderr.close()
        return self.text


def children(pid):
    try:
        return [int(p) for p in pathlib.Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


class Rig(unittest.TestCase):
    """A simulator, a deadman, a server, in a folder of their own. Times are what is tested: a failure counts only where no processor
    stood still meanwhile; else the test is run again."""

    def run(self, result=None):
        if result is None:
            result = self.defaultTestResult()
        STAND_STILLS.start()
        for left in reversed(range(5)):
            STAND_STILLS.seen.clear()
            own = unittest.TestResult()
            super().run(own)
            if own.wasSuccessful() or not STAND_STILLS.seen or left == 0:
                break
            print(f"{self.id()}: again: a processor stood still for {1e3 * max(STAND_STILLS.seen):.0f} ms", file=sys.stderr)
        result.testsRun += own.testsRun
        for what in ("failures", "errors", "skipped"):
            getattr(result, what).extend(getattr(own, what))
        return result

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory(prefix="telenano_deadman_")
        self.path = pathlib.Path(self.folder.name)
        self.programs, self.ports, self.port = [], [], 0
        self.addCleanup(self.end)

    def end(self):
        # Without a controller a guard would go on for ever, with its server's standard error in its hands.
        mine = {f"127.0.0.1:{port}" for port in [*self.ports, self.port]}
        for file in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
            try:
                words = file.read_text().split("\0")
            except OSError:
                continue
            if "afm-guard" in words and (mine & set(words) or str(self.path) in words[-2]):
                os.kill(int(file.parent.name), signal.SIGKILL)
        for program in self.programs:
            if program.process.poll() is None:
                program.kill(signal.SIGKILL)
            program.stop()
        self.folder.cleanup()

    def start(self, *words, **options):
        self.programs.append(Program(*words, **options))
        return self.programs[-1]

    def simulator(self, *flags, host="127.0.0.1", netns=None):
        program = self.start(SIM, "--listen", host, "--ports", "0,0,0,0", *flags, netns=netns)
        self.assertTrue(program.says("\n"), program.text)
        self.ports = [int(p) for p in re.findall(re.escape(host) + r":(\d+)", program.text)]
        self.assertEqual(len(self.ports), 4, program.text)
        return program

    def deadman(self, host="127.0.0.1", netns=None, silence_ms=500, key=KEY, port=0):
        (self.path / "deadman.key").write_text(key.hex() + "\n")
        (self.path / "deadman.key").chmod(0o600)
        (self.path / "deadman.toml").write_text(
            f'listen = "{host}:{port}"\ncontroller = "{host}:{self.ports[3]}"\nkey = "deadman.key"\n'
            f'silence_ms = {silence_ms}\nlog = "deadman.log"\n')
        program = self.start(sys.executable, "-B", SOURCE / "deploy/afm/deadman.py", "run", "--config", self.path / "deadman.toml",
                             netns=netns)
        self.assertTrue(program.says("connected to the controller"), program.text)
        self.port = int(re.search(r"listening on \S+:(\d+),", program.text)[1])
        return program

    def clear(self):
        return subprocess.run([sys.executable, "-B", SOURCE / "deploy/afm/deadman.py", "clear", "--config", self.path / "deadman.toml"],
                              capture_output=True, text=True, timeout=LONG_S, check=False)

    def serve_words(self, host="127.0.0.1", with_deadman=True, along_slope=None, flags=()):
        text = (SOURCE / "deploy/afm.toml").read_text()
        # The patience that a machine with many programs needs: no real-time promise here.
        text = text.replace("link_loss_ms = 100.0", "link_loss_ms = 3000.0")
        text = text.replace("reply_timeout_ms = 100.0", "stale_force_ms = 1000.0\nreply_timeout_ms = 1000.0")
        if along_slope is not None:
            text = text.replace("\nslope_max =", f"\nalong_slope = {along_slope}\nslope_max =")
        if with_deadman:
            text += '\n[deadman]\nkey = "server.key"\n'
            if not (self.path / "server.key").exists():
                (self.path / "server.key").write_text(KEY.hex() + "\n")
                (self.path / "server.key").chmod(0o600)
        (self.path / "afm.toml").write_text(text)
        ports = self.ports[:3] + [self.port if with_deadman else self.ports[3]]
        return [NVE, "serve", "--listen", "127.0.0.1:0", "--slave", "nanonis", "--controller", host, "--ports",
                ",".join(map(str, ports)), "--afm", self.path / "afm.toml", "--afm-state", self.path, *flags]

    def server(self, **options):
        program = self.start(*self.serve_words(**options))
        if not program.says("serving an AFM on"):
            self.fail("\n".join(p.text for p in self.programs))
        return program

    def station(self, server, duration_s=10):
        port = re.search(r"serving an AFM on 127\.0\.0\.1:(\d+)", server.text)[1]
        return self.start(MASTER, "run", "--server", f"127.0.0.1:{port}", "--task", "indent", "--depth-nm", "16",
                          "--duration-s", duration_s)

    def pressed(self, server):
        """A station that presses; until the rig feels it."""
        station = self.station(server)
        self.assertTrue(station.says("engaged"), station.text)
        time.sleep(4)
        return station

    def kill_both(self, server):
        """As a machine that loses its power; when."""
        guards = children(server.process.pid)
        self.assertEqual(len(guards), 1)
        server.kill(signal.SIGSTOP)  # neither sees the other die
        for guard in guards:
            os.kill(guard, signal.SIGKILL)
        server.kill(signal.SIGKILL)
        return time.monotonic()

    def refused(self, words, expected):
        done = subprocess.run([str(w) for w in words], capture_output=True, text=True, timeout=LONG_S, check=False)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn(expected, done.stderr)
        self.assertEqual(len(done.stderr.strip().splitlines()), 1, done.stderr)


class Together(Rig):
    def test_server_and_guard_killed_together(self):
        """Withdrawn, with its Z floor up, by nobody but the deadman; latched until somebody has looked."""
        simulator = self.simulator()
        watcher = self.deadman()
        server = self.server()
        self.assertTrue(watcher.says("watching over the server"))
        self.pressed(server)
        killed = self.kill_both(server)
        client, height_nm = None, 0
        while height_nm < 499 and time.monotonic() < killed + LONG_S:
            try:
                client = client or nanonis.Client("127.0.0.1", self.ports[2])  # the dead server's, once it is let go
                height_nm = 1e9 * client.call("ZCtrl.ZPosGet")
            except (OSError, nanonis.NanonisError):
                client = None
            time.sleep(0.005)
        took_s = time.monotonic() - killed
        print(f"withdrawn {1e3 * took_s:.0f} ms after the death of server and guard", file=sys.stderr)
        self.assertLess(took_s, 1 + 0.5 + 0.5, "half a second of silence, the way up, and a busy machine")
        self.assertTrue(watcher.says("the tip is withdrawn"), watcher.text)
        self.assertRegex(watcher.text, r"no heartbeat for \d+ ms: withdrawing")
        # A command that was on its way moves nothing.
        with self.assertRaises(nanonis.NanonisError):
            client.call("ZCtrl.ZPosSet", 0.0)
        client.close()
        # The next server is told why not, and what to do.
        self.refused(self.serve_words(), "has withdrawn the tip: look at it, then run deadman.py clear")
        self.assertIn("withdrawing", (self.path / "deadman.log").read_text())
        # The latch outlives the deadman.
        watcher.stop(signal.SIGKILL)
        again = self.deadman(port=self.port)
        self.assertIn("latched by an earlier withdrawal", again.text)
        self.refused(self.serve_words(), "has withdrawn the tip")
        done = self.clear()
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue(again.says("deadman: cleared"))
        next_server = self.server()  # held up by its own latch
        self.assertIn("did not end with the tip withdrawn", next_server.text)
        next_server.stop()
        end = simulator.stop()
        self.assertIn("tip withdrawn", end)
        self.assertGreater(float(re.search(r"greatest ([\d.]+) nN", end)[1]), 70, "it did press; the touches make 40 nN")

    def test_a_withdrawal_that_is_not_done_is_no_withdrawn_tip(self):
        """Answered as if it were; nor does a deadman that is started again take it for one."""
        control = self.path / "faults.txt"
        simulator = self.simulator("--control", control)
        watcher = self.deadman()
        server = self.server()
        self.pressed(server)
        control.write_text("withdraw undone ever\n")
        self.assertTrue(simulator.says("withdraw undone ever"), simulator.text)
        self.kill_both(server)
        not_up = r"the tip is NOT up: Z = -?\d\.\d nm, up is 500\.0 nm; withdrawing it again; press Withdraw at the controller"
        for _ in range(2):
            self.assertTrue(watcher.says("NOT up"), watcher.text)
            time.sleep(2)
            self.assertEqual(len(re.findall(not_up, watcher.text)), 1, watcher.text)
            self.assertNotIn("is withdrawn", watcher.text)
            watcher.stop(signal.SIGKILL)
            watcher = self.deadman(port=self.port)
            self.assertIn("latched by an earlier withdrawal", watcher.text)
        control.write_text("withdraw undone 3\n")
        self.assertTrue(watcher.says("the tip is withdrawn, at Z = 500.0 nm"), watcher.text)
        self.assertNotIn("NOT up", watcher.text.partition("the tip is withdrawn")[2])
        # Where nobody knows any more where it stood, no height is up.
        watcher.stop(signal.SIGKILL)
        (self.path / "deadman.latch.place").unlink()
        watcher = self.deadman(port=self.port)
        self.assertTrue(watcher.says("NOT up: Z = 500.0 nm, and where up is was not heard"), watcher.text)
        time.sleep(1)
        self.assertNotIn("is withdrawn", watcher.text)
        self.assertIn("tip withdrawn", simulator.stop())

    def test_a_guard_goes_on_through_the_deadman_until_the_tip_is_up(self):
        control = self.path / "faults.txt"
        simulator = self.simulator("--control", control)
        watcher = self.deadman(silence_ms=PATIENT_MS)
        server = self.server()
        self.pressed(server)
        control.write_text("withdraw half ever\n")
        self.assertTrue(simulator.says("withdraw half ever"), simulator.text)
        server.kill(signal.SIGKILL)
        self.assertTrue(server.says("afm-guard: the tip is NOT up: Z = 2"), server.text)
        self.assertTrue(server.says("afm-guard: the tip is withdrawn, at Z = 49"), server.text)
        simulator.stop()

    def assert_up(self, end):
        """Up, to a server, is within 1 % of where the tip stood when it began: the piezo may still be on its way to its end."""
        out = re.search(r"tip out at ([\d.]+) nm, force (-?[\d.]+) nN", end)
        self.assertTrue("tip withdrawn" in end or (out and float(out[1]) > 489 and abs(float(out[2])) < 0.01), end)

    def test_a_clean_end_latches_nothing(self):
        simulator = self.simulator()
        watcher = self.deadman()
        for _ in range(2):
            server = self.server()
            server.stop()
            self.assertEqual(server.process.returncode, 0, server.text)
            self.assertTrue(watcher.says("watching no longer"), watcher.text)
        time.sleep(1)  # twice the silence
        self.assertNotIn("withdrawing", watcher.text)
        self.assertFalse((self.path / "deadman.latch").exists())
        self.assertIn("tip withdrawn", simulator.stop())

    def test_a_killed_server_is_its_guards(self):
        """The guard withdraws, and then says that all is well: the deadman need not act."""
        simulator = self.simulator()
        watcher = self.deadman(silence_ms=PATIENT_MS)
        server = self.server()
        self.pressed(server)
        server.kill(signal.SIGKILL)
        self.assertTrue(watcher.says("watching no longer"), watcher.text)
        self.assertNotIn("withdrawing the tip", watcher.text)
        self.assertIn("tip withdrawn", simulator.stop())

    def test_a_killed_guard_is_noticed_by_both(self):
        simulator = self.simulator()
        watcher = self.deadman(silence_ms=PATIENT_MS)
        server = self.server()
        self.pressed(server)
        os.kill(children(server.process.pid)[0], signal.SIGKILL)
        self.assertTrue(server.says("withdrawn: connection lost"), server.text)
        self.assertTrue(watcher.says("the tip is withdrawn"), watcher.text)
        server.stop()
        self.assertIn("tip withdrawn", simulator.stop())

    def test_a_deadman_that_dies_or_hangs_is_noticed_by_the_server(self):
        for number in (signal.SIGKILL, signal.SIGSTOP):
            with self.subTest(number):
                simulator = self.simulator()
                watcher = self.deadman(silence_ms=PATIENT_MS)
                server = self.server(flags=["--local-rights", "operate"])
                self.pressed(server)
                watcher.kill(number)
                self.assertTrue(server.says("withdrawn: controller silent"), server.text)
                self.assert_up(simulator.stop())
                # Its guard too: it would look for a controller that has withdrawn the tip, and find the next one's.
                guards = children(server.process.pid)
                for program in (server, watcher):
                    program.stop(signal.SIGKILL)
                for guard in guards:
                    os.kill(guard, signal.SIGKILL)
                for latch in self.path.glob("*.out"):
                    latch.unlink()

    def test_a_deadman_restarted_in_a_session_watches_again(self):
        """Killed while the tip presses, and there again at once, as a service manager does it: the tip goes up, and comes back only
        for the next operator, watched again."""
        simulator = self.simulator()
        watcher = self.deadman(silence_ms=PATIENT_MS)
        server = self.server(flags=["--local-rights", "operate"])
        self.pressed(server)
        watcher.stop(signal.SIGKILL)
        again = self.deadman(silence_ms=PATIENT_MS, port=self.port)
        self.assertTrue(server.says("afm: withdrawn"), server.text)
        self.assertTrue(again.says("watching over the server"), again.text)
        approaches = server.text.count("afm: approaching")
        time.sleep(1)
        self.assertEqual(server.text.count("afm: approaching"), approaches, "nobody has asked for the tip")
        self.kill_both(server)
        self.assertTrue(again.says("the tip is withdrawn"), again.text)
        again.stop()
        self.assertIn("tip withdrawn", simulator.stop())

    def test_a_cut_cable(self):
        """Controller and deadman beyond a pair of virtual cables: cut, the tip goes up; joined again, it stays up."""
        name = f"tn{os.getpid() % 100000}"
        far, near = name + "a", name + "b"
        net = f"10.{os.getpid() % 200 + 20}.77"

        def ip(*words):
            return subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
        folder = "/run/netns"
        was_there = os.path.ismount(folder)
        if os.geteuid() != 0 or ip("netns", "add", name).returncode != 0:
            self.skipTest("needs root and network namespaces")
        if not was_there:
            self.addCleanup(subprocess.run, ["umount", folder], capture_output=True, check=False)
        self.addCleanup(ip, "netns", "del", name)
        if ip("link", "add", near, "type", "veth", "peer", "name", far, "netns", name).returncode != 0:
            self.skipTest("needs virtual cables (veth)")
        self.addCleanup(ip, "link", "del", near)
        ip("addr", "add", f"{net}.1/24", "dev", near)
        ip("link", "set", near, "up")
        for words in (("addr", "add", f"{net}.2/24", "dev", far), ("link", "set", far, "up"), ("link", "set", "lo", "up")):
            subprocess.run([*in_netns(name), "ip", *words], capture_output=True, check=False)
        host = f"{net}.2"
        simulator = self.simulator(host=host, netns=name)
        watcher = self.deadman(host=host, netns=name)
        server = self.server(host=host)
        self.pressed(server)
        ip("link", "set", near, "down")
        self.assertTrue(watcher.says("the tip is withdrawn"), watcher.text)
        after_ms = int(re.search(r"(\d+) ms after the last heartbeat", watcher.text)[1])
        print(f"cut: withdrawn {after_ms} ms after the last heartbeat", file=sys.stderr)
        self.assertLess(after_ms, 2000, "1 s is the promise; a busy machine")
        self.assertTrue(server.says("withdrawing"), server.text)
        ip("link", "set", near, "up")
        # Whatever TCP kept for later has come by now; and the tip is still up.
        self.assertTrue(server.says("no approach: the deadman has withdrawn the tip", 30), server.text)
        self.assertNotIn("was moved", watcher.text)
        self.assertEqual(self.clear().returncode, 0)
        self.assertTrue(watcher.says("deadman: cleared"))
        self.assertTrue(watcher.text.count("watching over the server") == 2 or watcher.says("watching", 5))
        server.stop()
        self.assertIn("tip withdrawn", simulator.stop())


class Start(Rig):
    def test_what_does_not_fit_is_one_line(self):
        self.simulator()
        watcher = self.deadman()
        words = self.serve_words()
        deadman_port, self.port = self.port, self.ports[3]
        watcher.stop(signal.SIGKILL)
        self.refused(words, "cannot connect")
        time.sleep(0.1)
        self.refused(self.serve_words(), "is that the controller itself?")
        self.port = deadman_port
        self.deadman()
        (self.path / "server.key").write_text("00" * 32 + "\n")
        self.refused(self.serve_words(), "refuses the key")
        (self.path / "server.key").write_text("nonsense\n")
        self.refused(self.serve_words(), "expected 64 hexadecimal digits")
        (self.path / "server.key").write_text(KEY.hex() + "\n")
        self.refused(self.serve_words() + ["--without-deadman"], "omit one of the two")
        self.refused(self.serve_words(with_deadman=False), "without a deadman beside the controller the tip stays on the sample")

    def test_without_one_the_risk_is_said(self):
        self.simulator()
        server = self.server(with_deadman=False, flags=["--without-deadman"])
        self.assertRegex(server.text, r"without a deadman: if this machine or the network.*SafeTip acts only at some 460 nN")
        self.assertIn("without limits.along_slope: no signal shows the force", server.text)
        server.stop()

    def test_a_known_slope_is_no_risk_that_is_said(self):
        self.simulator()
        server = self.server(with_deadman=False, along_slope=0.5, flags=["--without-deadman"])
        self.assertIn("without a deadman", server.text)
        self.assertNotIn("along_slope", server.text)
        server.stop()

    def test_a_second_server_is_refused(self):
        self.simulator()
        self.deadman()
        server = self.server()
        self.refused(self.serve_words(), "guards another server")
        server.stop()

    def test_the_deadmans_own_lines(self):
        script = SOURCE / "deploy/afm/deadman.py"

        def run(*words):
            return subprocess.run([sys.executable, "-B", str(script), *map(str, words)], capture_output=True, text=True,
                                  timeout=LONG_S, check=False)
        self.assertIn("silence_ms", run("--help").stdout)
        key = self.path / "new.key"
        self.assertEqual(run("new-key", key).returncode, 0)
        self.assertEqual(key.stat().st_mode & 0o777, 0o600)
        self.assertEqual(len(bytes.fromhex(key.read_text())), 32)
        config = self.path / "c.toml"
        good = 'listen = "127.0.0.1:0"\ncontroller = "127.0.0.1:6504"\nkey = "new.key"\n'
        for text, expected in [(None, "No such file"), ("listen = ", "c.toml"), ('listen = "x"\n', "listen: expected"),
                               (good + "silence_ms = 5000\n", "200 to 900"), (good + "silence = 5\n", "silence: no such key"),
                               (good.replace("new.key", "none.key"), "deadman.py new-key"),
                               (good.replace("new.key", "c.toml"), "chmod 600"),
                               (good.replace("127.0.0.1:0", "192.0.2.1:6514"), 'listen = "192.0.2.1:6514"')]:
            with self.subTest(expected):
                if text is not None:
                    config.write_text(text)
                done = run("run", "--config", config)
                self.assertEqual(done.returncode, 2, done.stderr)
                self.assertIn(expected, done.stderr)
                self.assertEqual(len(done.stderr.strip().splitlines()), 1, done.stderr)
        config.write_text(good)
        self.assertIn("nothing to clear", run("clear", "--config", config).stderr)
        self.assertEqual(run("new-key", key).returncode, 2, "never over another")


class Peer:
    """A guard by hand, with its own reckoning of the proofs, straight from the document."""

    def __init__(self, port, key=KEY, guard=b"g" * 16, connection=None):
        self.socket = connection or socket.create_connection(("127.0.0.1", port), timeout=LONG_S)
        self.key, self.guard = key, guard
        name, body = self.read()
        assert name == "Telenano.Deadman" and body[:2] == b"\0\1", (name, body)
        self.nonce = body[4:]
        assert len(self.nonce) == 16

    def read(self):
        """A frame, or None, None where the other end has closed."""
        def take(n):
            data = b""
            while len(data) < n:
                try:
                    more = self.socket.recv(n - len(data))
                except ConnectionResetError:
                    more = b""
                if not more:
                    return None
                data += more
            return data
        head = take(40)
        if head is None:
            return None, None
        return head[:32].rstrip(b"\0").decode(), take(struct.unpack(">i", head[32:36])[0])

    def proof(self, what, number, state, nonce=None):
        text = what + (nonce or self.nonce) + self.guard + struct.pack(">QH", number, state)
        return hmac.new(self.key, text, hashlib.sha256).digest()

    def beat_frame(self, number, state, proof=None):
        body = self.guard + struct.pack(">QH", number, state) + (proof or self.proof(b"Telenano beat 1", number, state))
        return b"Telenano.Beat".ljust(32, b"\0") + struct.pack(">iHH", len(body), 0, 0) + body

    def send(self, data):
        self.socket.sendall(data)

    def beat(self, number, state):
        """What the deadman says; None where it closes the connection."""
        self.send(self.beat_frame(number, state))
        return self.answer(number)

    def answer(self, number):
        name, body = self.read()
        if name is None:
            return None
        assert name == "Telenano.Beat", name
        said, state = struct.unpack(">QH", body[:10])
        assert said == number and body[10:] == self.proof(b"Telenano answer 1", number, state), body
        return state

    def call(self, name, body=b""):
        self.send(nanonis.frame(name, body, 1))
        return self.read()


class Heartbeats(Rig):
    """Forged, replayed, late; with a guard by hand."""

    def setUp(self):
        super().setUp()
        self.sim = self.simulator()
        self.watcher = self.deadman(silence_ms=900)

    def test_forged_and_replayed_ones_are_refused(self):
        good = Peer(self.port)
        self.assertEqual(good.beat(1, QUIET), READY)
        for question in ("ZCtrl.ZPosGet", "Piezo.RangeGet"):         # by which the deadman learns where up is
            self.assertEqual(good.call(question)[1][-8:], bytes(8))
        self.assertEqual(good.beat(7, WATCH), READY)
        recorded = good.beat_frame(8, WATCH)

        def refused(peer, data):
            peer.send(data)
            self.assertEqual(peer.read(), (None, None))
        stranger = Peer(self.port, key=bytes(32))
        refused(stranger, stranger.beat_frame(1, WATCH))
        refused(Peer(self.port), recorded)                           # made for another connection
        flipped = bytearray(Peer(self.port).beat_frame(1, WATCH))
        refused(Peer(self.port), bytes(flipped))                     # another nonce
        changed = Peer(self.port)
        frame = bytearray(changed.beat_frame(1, WATCH))
        frame[40 + 16 + 8 + 1] = DONE                                # says that all is well
        refused(changed, bytes(frame))
        refused(Peer(self.port), nanonis.frame("ZCtrl.StatusGet", b"", 1))  # without any proof
        refused(Peer(self.port), b"GET / HTTP/1.1\r\n".ljust(60))
        short = Peer(self.port)
        refused(short, short.beat_frame(1, WATCH)[:-1].replace(struct.pack(">i", 58), struct.pack(">i", 57)))
        # None of that has disturbed the good one, nor is any a sign of life.
        good.send(recorded)
        self.assertEqual(good.answer(8), READY)
        good.send(recorded)                                          # once more, on the same connection
        self.assertEqual(good.read(), (None, None))
        self.assertTrue(self.watcher.says("the tip is withdrawn"), self.watcher.text)
        self.assertIn("replayed", self.watcher.text)

    def test_only_watch_is_a_sign_of_life(self):
        guard = Peer(self.port)
        self.assertEqual(guard.beat(1, WATCH), READY)
        number = 1
        while "withdrawing the tip" not in self.watcher.text and number < 600:
            number += 1
            self.assertIn(guard.beat(number, QUIET), (READY, LATCHED))
            time.sleep(0.02)
        self.assertIn("withdrawing the tip", self.watcher.text)
        self.assertEqual(guard.beat(number + 1, WATCH), LATCHED)
        # Latched: the way up is passed on, the question whether all is well is answered with no.
        name, body = guard.call("ZCtrl.Withdraw", struct.pack(">Ii", 0, -1))
        self.assertEqual((name, body), ("ZCtrl.Withdraw", struct.pack(">Ii", 0, 0)))
        name, body = guard.call("ZCtrl.StatusGet")
        self.assertIn(b"deadman.py clear", body)
        self.assertEqual(self.clear().returncode, 0)
        self.assertTrue(self.watcher.says("deadman: cleared"))
        self.assertEqual(guard.beat(number + 2, DONE), READY)
        self.assertEqual(len(guard.call("ZCtrl.StatusGet")[1]), 2 + 8)

    def test_only_what_the_emergency_port_is_for_is_passed_on(self):
        guard = Peer(self.port)
        self.assertEqual(guard.beat(1, QUIET), READY)
        self.assertEqual(guard.call("ZCtrl.ZPosGet")[1][4:], bytes(8))
        name, body = guard.call("ZCtrl.OnOffSet", struct.pack(">I", 1))
        self.assertEqual(name, "ZCtrl.OnOffSet")
        self.assertIn(b"does not pass that on", body)
        self.assertIn("; 0 calls that move", self.sim.stop())

    def test_a_deadman_that_stood_still_does_not_blame_the_server(self):
        """Between looking into its sockets and looking at the clock a busy machine may keep it waiting for a second."""
        self.watcher.stop()
        config = deadman.Config(self.path / "deadman.toml")
        config.log = None
        for stalled_call in range(1, 9):
            with self.subTest(stalled_call):
                (self.path / "deadman.latch").unlink(missing_ok=True)
                state = {"now": 1000.0, "calls": 0, "stall": None}

                def clock():
                    state["calls"] += 1
                    if state["calls"] == state["stall"]:
                        guard.send(guard.beat_frame(2, WATCH))
                        time.sleep(0.02)
                        state["now"] += 1
                    return state["now"]
                watcher = deadman.Deadman(config, clock)
                watcher.say = lambda text: None
                self.addCleanup(watcher.close)
                connection = socket.create_connection(watcher.listener.getsockname()[:2], timeout=LONG_S)
                while not watcher.strangers:
                    watcher.turn(0.01)
                guard = Peer(None, connection=connection)
                guard.send(guard.beat_frame(1, WATCH))
                while not watcher.armed:
                    watcher.turn(0.01)
                state["stall"] = state["calls"] + stalled_call
                while state["calls"] < state["stall"] + 3:
                    watcher.turn(0.01)
                self.assertFalse(watcher.latched)
                state["now"] += 0.85
                for _ in range(3):
                    watcher.turn(0.01)
                self.assertFalse(watcher.latched, "900 ms of silence")
                state["now"] += 0.06
                for _ in range(3):
                    watcher.turn(0.01)
                self.assertTrue(watcher.latched, "and no longer")

    def test_a_lost_controller_is_told(self):
        guard = Peer(self.port)
        self.assertEqual(guard.beat(1, WATCH), READY)
        self.sim.stop()
        self.assertTrue(self.watcher.says("no connection to the controller"), self.watcher.text)
        self.assertEqual(guard.beat(2, WATCH), NO_CONTROLLER)

    def test_many_strangers_do_not_keep_the_guard_out(self):
        strangers = [Peer(self.port) for _ in range(40)]
        guard = Peer(self.port)
        self.assertEqual(guard.beat(1, WATCH), READY)
        for number in range(2, 20):
            self.assertEqual(guard.beat(number, WATCH), READY)
        for stranger in strangers:
            stranger.socket.close()


if __name__ == "__main__":
    sys.exit(side_by_side.main(4, at_once=4))  # each case waits for most of its time: for an approach, a touch, a silence
