#!/usr/bin/env python3
"""The plan is kept while the session runs: a link that becomes longer under a hand that presses, and short again.

replan_test.py TELENANO_NVE TELENANO_MASTER
"""
import heapq
import pathlib
import re
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import side_by_side

NVE, MASTER = (str(pathlib.Path(word).resolve()) for word in sys.argv[1:3])
LONG_S = 60


class Way(threading.Thread):
    """Between station and server, with a delay that may change."""

    def __init__(self, server):
        super().__init__(daemon=True)
        self.delay_s = 0.0
        self.front = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.front.bind(("127.0.0.1", 0))
        self.back = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.back.connect(server)
        self.address = "127.0.0.1:%d" % self.front.getsockname()[1]
        self.over = False
        self.start()

    def run(self):
        station, waiting, number = None, [], 0
        while not self.over:
            wait = 0.05 if not waiting else max(0.0, min(0.05, waiting[0][0] - time.monotonic()))
            for ready in select.select([self.front, self.back], [], [], wait)[0]:
                try:
                    data, whence = ready.recvfrom(2048)
                except OSError:
                    continue
                if ready is self.front:
                    station = whence
                number += 1
                heapq.heappush(waiting, (time.monotonic() + self.delay_s, number, ready is self.front, data))
            while waiting and waiting[0][0] <= time.monotonic():
                _, _, up, data = heapq.heappop(waiting)
                try:
                    self.back.send(data) if up else self.front.sendto(data, station)
                except OSError:
                    pass


class Replan(unittest.TestCase):
    def session(self, *words):
        holder = tempfile.TemporaryDirectory(prefix="telenano_replan_")
        self.addCleanup(holder.cleanup)
        self.folder = pathlib.Path(holder.name)
        # Pressed from 1.5 s to 8 s, then free.
        (self.folder / "press.csv").write_text("t_s,x_nm,y_nm,z_nm\n0,0,0,20\n0.5,0,0,20\n1.5,0,0,-5\n8,0,0,-5\n9,0,0,30\n22,0,0,30\n")
        with (self.folder / "server").open("w") as err:
            server = subprocess.Popen([NVE, "serve", "--scene", "flat_silicon_oxide", "--listen", "127.0.0.1:0"], cwd=self.folder, stderr=err)
        self.addCleanup(server.wait)
        self.addCleanup(server.kill)
        address = self.said("server", r"serving .* on 127\.0\.0\.1:(\d+)")
        self.way = Way(("127.0.0.1", int(address[1])))
        self.addCleanup(setattr, self.way, "over", True)
        with (self.folder / "station").open("w") as err:
            station = subprocess.Popen([MASTER, "run", "--server", self.way.address, "--task", "script", "--script", "press.csv",
                                        "--rt-priority", "0", "--send-hz", "1000", "--record", "session.h5", *words], cwd=self.folder,
                                       stdout=subprocess.DEVNULL, stderr=err)
        self.addCleanup(station.wait)
        self.addCleanup(station.kill)
        self.said("station", r"loop: ")
        return station

    def said(self, who, pattern, times=1):
        end = time.monotonic() + LONG_S
        while time.monotonic() < end:
            found = list(re.finditer(pattern, (self.folder / who).read_text()))
            if len(found) >= times:
                return found[times - 1]
            time.sleep(0.02)
        raise AssertionError(f"no {pattern} in: {(self.folder / who).read_text()}")

    def recorded(self, *words):
        return subprocess.run([MASTER, "export", "session.h5", *words], cwd=self.folder, check=True, capture_output=True, text=True).stdout

    def test_ks_is_planned_again_where_the_round_trip_grows_and_when_it_falls(self):
        station = self.session("--method", "ks")
        time.sleep(3)
        self.way.delay_s = 0.04
        low = float(self.said("station", r"force scale (\S+) from now on, planned for")[1])
        self.way.delay_s = 0
        high = float(self.said("station", r"force scale (\S+) from now on, planned for", 2)[1])
        self.assertEqual(station.wait(LONG_S), 0, (self.folder / "station").read_text())
        events = self.recorded("--what", "events")
        self.assertIn("force scale lowered: the round trip is longer", events)
        self.assertIn("force scale raised: the round trip is shorter", events)
        self.assertLess(low, 0.5 * high)
        rows = [[float(word) for word in line.split(",")]
                for line in self.recorded("--columns", "time_s,force_scale,contact_state,hand_force_commanded_h_n").splitlines()
                if line[0] in "-0123456789"]
        contact = 3
        for before, now in zip(rows, rows[1:]):
            if now[1] > before[1]:
                self.assertNotEqual(before[2], contact, "raised under a hand that presses")
        changed = next(i for i in range(1, len(rows)) if rows[i][1] != rows[i - 1][1])
        steps = [abs(b[-1] - a[-1]) for a, b in zip(rows[changed - 2:], rows[changed - 1:changed + 300])]
        print(f"force scale {rows[0][1]:.4g}, {low:.4g} at a round trip of 80 ms, {high:.4g} after; where it was lowered, "
              f"at {rows[changed][-1]:.3f} N, the largest step of the force was {max(steps):.4f} N in a tick")
        self.assertLess(max(steps), 0.25 * max(abs(row[-1]) for row in rows))

    def test_a_scale_that_a_person_gave_is_kept(self):
        station = self.session("--method", "ks", "--force-scale", "1e5")
        time.sleep(1)
        self.way.delay_s = 0.04
        time.sleep(4)
        station.send_signal(signal.SIGTERM)
        station.wait(LONG_S)
        self.assertNotIn("from now on, planned for", (self.folder / "station").read_text())


if __name__ == "__main__":
    sys.exit(side_by_side.main(2, at_once=2))  # each case waits for most of its time
