#!/usr/bin/env python3
"""Thousands of sessions over four servers that share their checkpoints, through a kill and a rolling upgrade of all: none is lost, and
each is back within seconds. The stations are emulated (telenano-lab fleet), the servers are the real ones.

fleet_test.py TELENANO_NVE TELENANO_LAB [SESSIONS [RATE_HZ]]
"""
import csv
import pathlib
import re
import resource
import signal
import sys
import tempfile
import time
import unittest

from real_programs import Program, RealPrograms

NVE, LAB = (str(pathlib.Path(word).resolve()) for word in sys.argv[1:3])
SESSIONS = int(sys.argv[3]) if len(sys.argv) > 3 else 10_000
RATE_HZ = sys.argv[4] if len(sys.argv) > 4 else "1"
SERVERS = 4
PLACES = 4096  # of one server, the most
BACK_S = 3
LONG_S = 120


class Fleet(RealPrograms):
    def setUp(self):
        # In memory where there is such a folder: ten thousand files a second are no disk's work.
        memory = pathlib.Path("/dev/shm")
        holder = tempfile.TemporaryDirectory(prefix="telenano_fleet_", dir=memory if memory.is_dir() else None)
        self.addCleanup(holder.cleanup)  # before the base's, so after its programs are gone
        super().setUp()
        self.kept = pathlib.Path(holder.name)
        self.kept.chmod(0o700)
        _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        if hard < SESSIONS + 100:
            self.skipTest(f"no more than {hard} open files allowed")

    def server(self, name, port=0):
        server = self.start(name, NVE, "serve", "--scene", "flat_silicon_oxide", "--listen", f"127.0.0.1:{port}", "--max-sessions", PLACES,
                            "--sessions-per-peer", PLACES, "--checkpoint", self.kept, "--timeout-ms", 10_000, "--resume-s", 60)
        server.address = server.said(r"serving .* on (127\.0\.0\.1:\d+)")
        return server

    def status(self):
        """The newest whole line."""
        lines = (self.folder / "fleet.csv").read_text().splitlines(keepends=True)
        lines = [line for line in lines if line.endswith("\n")]
        if len(lines) < 2:
            return None
        row = next(csv.DictReader([lines[0], lines[-1]]))
        return {key: value if key == "by_server" else float(value) for key, value in row.items()}

    def all_here(self, since=0):
        """Waits until they are; returns the line. Not one of before `since` replies."""
        end = time.monotonic() + LONG_S
        while True:
            now = self.status()
            if now and now["here"] == SESSIONS and now["replies"] > since:
                return now
            self.assertLess(time.monotonic(), end, f"{now}")
            time.sleep(0.05)

    def after(self, what):
        """All are away or have been: some replies later all are here again. Seconds that it took."""
        before = self.status()["replies"]
        begin = time.monotonic()
        what()
        now = self.all_here(before + 2 * SESSIONS)
        return now, time.monotonic() - begin

    def test_a_kill_and_a_rolling_upgrade(self):
        servers = [self.server(f"server-{i}") for i in range(SERVERS)]
        with (self.folder / "fleet.csv").open("w") as out:
            fleet = Program(self.folder, "fleet", LAB, "fleet", "--server", ",".join(s.address for s in servers), "--sessions", SESSIONS,
                            "--rate", RATE_HZ, "--seconds", 600, out=out)
        self.programs.append(fleet)
        first = self.all_here()
        print(f"{SESSIONS} sessions at {RATE_HZ} Hz: {first['by_server']}")
        self.assertEqual(first["new_epochs"], 0)
        self.wait_for(lambda: sum(len(path.name) == 33 for path in self.kept.glob("??/*")) >= SESSIONS, "a checkpoint of each")

        held = int(self.status()["by_server"].split("|")[0])
        servers[0].kill()
        now, _ = self.after(lambda: None)
        print(f"killed one with {held}: {now['resumed']:.0f} resumed, {now['new_epochs']:.0f} lost, longest without a reply {now['away_most_s']:.2f} s")
        self.assertLessEqual(now["new_epochs"], held, "none beyond the killed process's")
        self.assertLess(now["away_most_s"], BACK_S + 1 / float(RATE_HZ))
        lost, fell = now["new_epochs"], now["energies_fell"]

        servers[0] = self.server("server-0-again", servers[0].address.split(":")[1])
        handed = taken = 0
        for i in range(1, SERVERS):
            def upgrade(i=i):
                servers[i].signal(signal.SIGTERM)
                self.assertEqual(servers[i].end(), 0, servers[i].text())
                servers[i] = self.server(f"server-{i}-again", servers[i].address.split(":")[1])
            old = servers[i]
            now, took_s = self.after(upgrade)
            gave = int(re.search(r"(\d+) handed out", old.text())[1])
            handed += gave
            fell_now = now["energies_fell"]
            print(f"upgraded {i}, which gave {gave} away ({fell_now - fell:.0f} with less than was told), in {took_s:.1f} s: {now['by_server']}, longest without a reply {now['away_most_s']:.2f} s")
        self.assertEqual(now["new_epochs"], lost, "an upgrade loses none")
        self.assertEqual(now["energies_fell"], fell, "each account goes on where it was")
        self.assertLess(now["away_most_s"], BACK_S + 1 / float(RATE_HZ))
        fleet.kill()
        for server in servers:
            server.signal(signal.SIGTERM)
            server.end()
        for server in self.programs:
            found = re.search(r"(\d+) sessions taken up", server.text())
            taken += int(found[1]) if found else 0
        print(f"{handed} handed out, {taken} taken up, of them {taken - handed} of the killed one")
        self.assertGreaterEqual(taken, handed)
        self.assertLessEqual(taken - handed, held)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
