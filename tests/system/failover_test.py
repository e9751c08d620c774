#!/usr/bin/env python3
"""A station with a list of servers, through the real programs: which one it takes, and what the hand feels when that one is lost.

failover_test.py TELENANO_NVE TELENANO_MASTER
"""
import pathlib
import re
import signal
import subprocess
import sys
import unittest

import side_by_side
from real_programs import RealPrograms

NVE, MASTER = (str(pathlib.Path(word).resolve()) for word in sys.argv[1:3])
FELT_N = 0.3  # more than this sample attracts with


class Failover(RealPrograms):
    def setUp(self):
        super().setUp()
        # A hand that presses from 1.5 s on, and from 8 s on again: another server's tip begins above its sample.
        (self.folder / "press.csv").write_text("t_s,x_nm,y_nm,z_nm\n0,0,0,20\n0.5,0,0,20\n1.5,0,0,-5\n7,0,0,-5\n9,0,0,-32\n10,0,0,-32\n")

    def server(self, name, *words, scene="flat_silicon_oxide", port=0):
        server = self.start(name, NVE, "serve", "--scene", scene, "--listen", f"127.0.0.1:{port}", *words)
        server.address = server.said(r"serving .* on (127\.0\.0\.1:\d+)")
        return server

    def station(self, servers, *words):
        return self.start("station", MASTER, "run", "--server", ",".join(servers), "--task", "script", "--script", "press.csv",
                          "--rt-priority", "0", "--record", "session.h5", "--metrics", "127.0.0.1:0", *words)

    def in_contact(self, station):
        self.wait_for(lambda: (station.metric("telenano_hand_force_newtons") or 0) > FELT_N, "contact")

    def recorded(self, *words):
        return subprocess.run([MASTER, "export", "session.h5", *words], cwd=self.folder, check=True, capture_output=True, text=True).stdout

    def force_is_without_a_step_and_comes_back(self):
        """After the loss: down by the fade, nothing while no server answers and above the next one's sample."""
        rows = [[float(word) for word in line.split(",")]
                for line in self.recorded("--columns", "hand_force_applied_h_n").splitlines() if line[0] in "-0123456789"]
        force_n = [max(0, row[-1]) for row in rows]  # away from the sample
        pressed = next(i for i, f in enumerate(force_n) if f > FELT_N)
        # On a busy machine a contact by ks may leave the sample for some ticks before: no server is found as fast as that.
        gone = next(i for i in range(pressed, len(force_n)) if max(force_n[i:i + 50]) < 0.01)
        back = next(i for i in range(gone, len(force_n)) if force_n[i] > 0.01)
        felt = max(force_n[back:])
        self.assertGreater(felt, FELT_N, "it is felt again")
        down = max(a - b for a, b in zip(force_n[gone - 60:], force_n[gone - 59:gone + 1]))
        up = max(b - a for a, b in zip(force_n[back - 1:], force_n[back:back + 300]))
        print(f"{back - gone} ticks without force; largest step down {down:.3f} N, of {max(force_n[gone - 60:gone]):.3f} N; "
              f"up {up:.3f} N, of {felt:.3f} N")
        # It fades over 20 ticks, 5 % each; a busy machine may leave out some of them. The next contact begins with a snap-in.
        self.assertLess(down, 0.3 * max(force_n[gone - 60:gone]))
        self.assertLess(up, 0.4 * felt)

    def test_the_first_that_takes_the_session_is_used(self):
        full, free = self.server("full", "--max-sessions", "1"), self.server("free")
        holder = self.start("holder", MASTER, "run", "--server", full.address, "--duration-s", "600", "--rt-priority", "0")
        holder.said("loop: ")
        nobody = self.server("nobody")
        nobody.kill()
        station = self.station([nobody.address, full.address, free.address], "--connect-timeout-s", "0.5")
        self.in_contact(station)
        self.assertRegex(station.text(), rf"note: no answer from {nobody.address} .*; going on to {full.address}\n")
        self.assertRegex(station.text(), rf"note: the server at {full.address} has no room .*; going on to {free.address}\n")
        station.signal(signal.SIGTERM)
        self.assertEqual(station.end(), 0, station.text())
        free.signal(signal.SIGTERM)
        self.assertEqual(free.end(), 0)
        self.assertIn("in 1 sessions", free.text())

    def test_none_takes_it(self):
        gone = [self.server(name) for name in "ab"]
        for server in gone:
            server.kill()
        station = self.station([server.address for server in gone], "--connect-timeout-s", "0.3")
        self.assertEqual(station.end(), 1)
        self.assertRegex(station.text().splitlines()[-1], f"no answer from {gone[1].address} within 0.3 s; nothing listens")

    def test_wrong_lists(self):
        for servers in ("127.0.0.1:5100,", ",127.0.0.1:5100", "127.0.0.1:5100,,127.0.0.1:5101"):
            station = self.station([servers])
            self.assertEqual(station.end(), 2)
            self.assertIn("an entry is empty; give HOST:PORT,HOST:PORT", station.text())
            self.assertEqual(len(station.text().splitlines()), 1)

    def test_a_server_killed_in_contact(self):
        for method in ("ks", "tank", "twin"):
            with self.subTest(method=method):
                self.lose(lambda server: server.process.kill(), "nothing listens there any more", "--method", method, "--overwrite")

    def test_a_server_killed_in_contact_with_keys(self):
        subprocess.run([NVE, "keys", "new", "omega-1", "--rights", "operate"], cwd=self.folder, check=True, capture_output=True)
        self.lose(lambda server: server.process.kill(), "nothing listens there any more", "--key", "omega-1.key", serve=("--keys", "keys.toml"))

    def test_a_server_that_shuts_down_or_has_drained(self):
        self.lose(lambda server: server.signal(signal.SIGTERM), "it shuts down")
        self.lose(lambda server: server.signal(signal.SIGTERM), "it shuts down", "--overwrite", serve=("--drain-seconds", "1"))

    def test_a_server_that_falls_silent(self):
        self.lose(lambda server: server.signal(signal.SIGSTOP), "it is silent")

    def lose(self, how, why, *words, serve=()):
        first, second = self.server("first", *serve), self.server("second", *serve)
        station = self.station([first.address, second.address], *words)
        self.in_contact(station)
        how(first)
        station.said(f"the session with the server at {first.address} is lost: {why}; going on to {second.address}, the force is zero\n")
        station.said(f"the server at {second.address} has taken the session\n")
        self.assertEqual(station.end(), 0, station.text())
        self.assertIn("goes on to the next server of the list", self.recorded("--what", "events"))
        self.force_is_without_a_step_and_comes_back()
        self.kill_all()

    def test_without_a_list_a_killed_server_is_waited_for(self):
        server = self.server("first")
        station = self.station([server.address], "--give-up-s", "1")
        self.in_contact(station)
        server.process.kill()
        self.assertEqual(station.end(), 1)
        self.assertRegex(station.text(), f"the server at {server.address} has been silent for 1 s; the force is zero")
        self.assertNotIn("going on", station.text())

    def test_another_scene_stops_the_station(self):
        first, other = self.server("first"), self.server("other", scene="flat_pdms")
        station = self.station([first.address, other.address])
        self.in_contact(station)
        first.process.kill()
        self.assertEqual(station.end(), 1)
        self.assertRegex(station.text(), "the station stopped itself: .*scene")


if __name__ == "__main__":
    sys.exit(side_by_side.main(2, at_once=3))  # each case waits for most of its time
