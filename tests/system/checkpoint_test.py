#!/usr/bin/env python3
"""Sessions that go on with another server, through the real programs: one that was killed and started again, one that
takes over from one that stops; what nobody may take up.

checkpoint_test.py TELENANO_NVE TELENANO_MASTER [--all] [TEST ...]

Without --all: of each kind one.
"""
import collections
import pathlib
import re
import signal
import struct
import subprocess
import sys
import time
import unittest

import side_by_side
from real_programs import LONG_S, RealPrograms

NVE, MASTER = (str(pathlib.Path(word).resolve()) for word in sys.argv[1:3])
ALL = "--all" in sys.argv
FELT_N = 0.3


class Checkpoints(RealPrograms):
    def setUp(self):
        super().setUp()
        self.kept = self.folder / "kept"
        self.kept.mkdir(mode=0o700)
        self.write_script("0,0,0,20\n0.3,0,0,20\n0.8,0,0,-6\n100.8,100,0,-6\n")

    def write_script(self, rows):
        """Longer than any test: a station ends when the test has seen what it looks for."""
        (self.folder / "press.csv").write_text("t_s,x_nm,y_nm,z_nm\n" + rows)

    def server(self, name, *words, scene="flat_silicon_oxide", port=0, kept=True):
        words += ("--checkpoint", str(self.kept)) if kept else ()
        server = self.start(name, NVE, "serve", "--scene", scene, "--listen", f"127.0.0.1:{port}", *words)
        server.address = server.said(r"serving .* on (127\.0\.0\.1:\d+)")
        return server

    def station(self, servers, *words, name="station"):
        return self.start(name, MASTER, "run", "--server", ",".join(servers), "--task", "script", "--script", "press.csv",
                          "--rt-priority", "0", "--record", "session.h5", "--overwrite", "--metrics", "127.0.0.1:0", *words)

    def in_contact(self, station):
        self.wait_for(lambda: (station.metric("telenano_hand_force_newtons") or 0) > FELT_N, "contact")

    def sessions(self):
        return [path for path in self.kept.glob("??/*") if len(path.name) == 33]

    def in_contact_again(self, station):
        """With the next server; then the station ends."""
        self.wait_for(lambda: (station.metric("telenano_sessions_total") or 0) > 1, "another session")
        self.in_contact(station)
        time.sleep(0.3)
        station.signal(signal.SIGTERM)
        self.assertEqual(station.end(), 0, station.text())

    def recorded(self, *columns):
        """A list for each column, of all ticks; of a vector its z."""
        text = subprocess.run([MASTER, "export", "session.h5", "--columns", ",".join(columns)], cwd=self.folder, check=True,
                              capture_output=True, text=True).stdout
        head, *rows = [line.split(",") for line in text.splitlines() if line and not line.startswith("#")]
        place = {re.sub(r"_z$|\[2\]$", "", name): i for i, name in enumerate(head)}
        return [[float(row[place[name]]) for row in rows] for name in columns]

    def events(self):
        return subprocess.run([MASTER, "export", "session.h5", "--what", "events"], cwd=self.folder, check=True, capture_output=True,
                              text=True).stdout

    def went_on(self, station, held_most_ms, lost_most_nm):
        """One account, one tip, and the force comes back by a ramp."""
        self.in_contact_again(station)
        events = self.events()
        resumed = [line for line in events.splitlines() if "session resumed" in line]
        self.assertEqual(len(resumed), 1, events)
        self.assertNotIn("new epoch", resumed[0], "the same slave, and the same account")
        head = next(line for line in events.splitlines() if "time_s" in line).split(",")
        at_s = float(resumed[0].split(",")[head.index("time_s")])
        time_s, force, tip, target, number = self.recorded("time_s", "hand_force_applied_h_n", "tip_pos_w_nm", "tip_target_w_nm",
                                                           "reply_sequence")
        back = next(i for i, t in enumerate(time_s) if t >= at_s)
        replies = [i for i in range(1, len(number)) if number[i] > 0 and number[i] != number[i - 1]]
        gone = max(i for i in replies if i < back)
        answered = min(i for i in replies if i >= back)
        longest = 1e3 * (time_s[answered] - time_s[gone])
        step = max(abs(b - a) for a, b in zip(tip[gone:], tip[gone + 1:answered + 20]))
        self.target_step_nm = max(abs(b - a) for a, b in zip(target[gone:], target[gone + 1:answered + 20]))
        up = max(b - a for a, b in zip(force[gone:], force[gone + 1:answered + 1000]))
        down = max(a - b for a, b in zip(force[gone:], force[gone + 1:answered + 1]))
        print(f"without a reply for {longest:.0f} ms; largest step of the tip {step:.3f} nm, of the force up {up:.4f}, down {down:.4f} N, "
              f"of {max(force):.3f} N")
        self.assertGreater(max(force[answered:answered + 1500]), FELT_N, "it is felt again")
        self.assertLess(longest, held_most_ms)
        self.assertLess(step, lost_most_nm)
        self.assertLess(up, 0.06 * max(force) + 0.02)

    def test_a_server_that_stops_hands_over_to_the_next_of_the_list(self):
        for method in ("ks", "tank", "twin") if ALL else ("twin",):
            with self.subTest(method=method):
                first, second = self.server("first"), self.server("second")
                station = self.station([first.address, second.address], "--method", method)
                self.in_contact(station)
                first.signal(signal.SIGTERM)
                self.assertEqual(first.end(), 0)
                self.assertIn("checkpoints: 0 sessions taken up, 1 handed out", first.text())
                second.said("took up a session of another server")
                self.went_on(station, held_most_ms=200, lost_most_nm=0.5)
                second.signal(signal.SIGTERM)
                second.end()
                self.assertIn("1 sessions taken up, 0 handed out", second.text())
                self.assertEqual(self.sessions(), [], "its station has said Bye")
                self.kill_all()

    def test_a_killed_server_that_starts_again_goes_on(self):
        for method in ("tank", "twin") if ALL else ("twin",):
            with self.subTest(method=method):
                first = self.server("first")
                station = self.station([first.address], "--method", method)
                self.in_contact(station)
                time.sleep(0.5)  # the press is over, the hand goes along
                since = time.time()
                self.wait_for(lambda: any(path.stat().st_mtime > since for path in self.sessions()))
                first.kill()
                again = self.server("again", port=first.address.split(":")[1])
                again.said("took up a session of another server, [0-9]+ ms old")
                # What came after the last checkpoint is lost but with a twin, which sends its steps again.
                self.went_on(station, held_most_ms=20000, lost_most_nm=30)
                if method == "twin":
                    self.assertNotRegex(self.events(), "apart")
                    self.assertLess(self.target_step_nm, 0.05, "the hand goes on where it was, not at the checkpoint")
                self.kill_all()

    def test_marks_go_along(self):
        """The hand ploughs and goes up; what the two servers then save is the same at every node."""
        self.write_script("0,0,0,20\n0.3,0,0,20\n0.8,0,0,-15\n1.8,20,0,-15\n2.3,20,0,40\n100,20,0,40\n")
        saved = self.folder / "saved"
        saved.mkdir()
        words = ("--save-surface", str(saved))
        first, second = (self.server(name, *words, scene="lithography") for name in ("first", "second"))
        station = self.station([first.address, second.address], "--method", "tank")
        self.in_contact(station)
        free = []  # not only on its way through zero

        def is_up():
            free.append(abs(station.metric("telenano_hand_force_newtons")) < 0.001)
            return len(free) > 20 and all(free[-20:])
        self.wait_for(is_up, "the way up")
        first.signal(signal.SIGTERM)
        self.assertEqual(first.end(), 0)
        second.said("took up a session of another server")
        self.wait_for(lambda: (station.metric("telenano_sessions_total") or 0) > 1, "another session")
        station.signal(signal.SIGTERM)
        self.assertEqual(station.end(), 0, station.text())
        second.signal(signal.SIGTERM)
        second.end()
        files = sorted(saved.glob("*.gsf"))
        self.assertEqual(len(files), 2, first.text() + second.text() + station.text())
        before, after = (self.heights(path) for path in files)
        unmarked = collections.Counter(before).most_common(1)[0][0]
        marked = sum(h != unmarked for h in before)
        unequal = sum(a != b for a, b in zip(before, after))
        print(f"{marked} of {len(before)} nodes marked, {unequal} unequal at the two servers")
        self.assertGreater(marked, 100)
        self.assertEqual(unequal, 0)

    @staticmethod
    def heights(path):
        raw = path.read_bytes()
        columns, rows = (int(re.search(rb"%s *= *(\d+)" % key, raw)[1]) for key in (b"XRes", b"YRes"))
        return struct.unpack(f"<{columns * rows}f", raw[-4 * columns * rows:])

    def test_what_is_damaged_old_or_of_another_scene_is_a_new_session(self):
        def cut(path):
            with path.open("r+b") as file:
                file.truncate(path.stat().st_size // 2)

        def spoil(path):
            raw = bytearray(path.read_bytes())
            raw[len(raw) // 2] ^= 1
            path.write_bytes(raw)

        for how, said in ((cut, "is not a complete checkpoint"), (spoil, "is not a complete checkpoint"), (pathlib.Path.unlink, None))[0 if ALL else 2:]:
            with self.subTest(how=how.__name__):
                first = self.server("first")
                station = self.station([first.address], "--method", "tank")
                self.in_contact(station)
                self.wait_for(self.sessions)
                first.kill()
                how(self.sessions()[0])
                again = self.server("again", port=first.address.split(":")[1])
                if said:
                    again.said(said)
                self.wait_for(lambda: (station.metric("telenano_sessions_total") or 0) > 1, "another session")
                station.signal(signal.SIGTERM)
                self.assertEqual(station.end(), 0, station.text())
                again.signal(signal.SIGTERM)
                again.end()
                self.assertNotIn("taken up", again.text())
                self.assertIn("in 1 sessions", again.text())
                self.kill_all()
                for path in self.sessions():
                    path.unlink()

    def test_a_living_server_keeps_its_session(self):
        """Stopped for a while: its station goes on to the next server, which must not have it too."""
        first, second = self.server("first"), self.server("second")
        station = self.station([first.address, second.address], "--method", "tank")
        self.in_contact(station)
        self.wait_for(self.sessions)
        first.signal(signal.SIGSTOP)
        station.said(f"the server at {second.address} has taken the session")
        first.signal(signal.SIGCONT)
        station.signal(signal.SIGTERM)
        self.assertEqual(station.end(), 0, station.text())
        second.signal(signal.SIGTERM)
        second.end()
        self.assertNotIn("taken up", second.text())

    def test_wrong_words(self):
        open_folder = self.folder / "open"
        open_folder.mkdir()
        open_folder.chmod(0o755)
        for words, said in ((("--checkpoint", str(self.folder / "none")), "is not a folder"),
                            (("--checkpoint", str(open_folder)), "chmod 700"),
                            (("--checkpoint", str(self.kept), "--share", "one-tip"), "a shared tip cannot be saved"),
                            (("--checkpoint", str(self.kept), "--slave", "afm", "--afm", "127.0.0.1:6501"), "")):
            words = words if "--slave" in words else words + ("--scene", "flat_silicon_oxide")
            done = subprocess.run([NVE, "serve", "--listen", "127.0.0.1:0", *words], cwd=self.folder, capture_output=True, text=True,
                                  timeout=LONG_S)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
            self.assertIn(said, done.stderr)


if __name__ == "__main__":
    sys.exit(side_by_side.main(3 if ALL else 2, at_once=2))  # each case waits for most of its time
