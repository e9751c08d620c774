#!/usr/bin/env python3
"""Connect tokens through the real programs: a scheduler that holds the issuer's file lets a station in at two servers.

token_test.py TELENANO_NVE TELENANO_MASTER
"""
import json
import pathlib
import re
import sys
import time
import unittest

import side_by_side
from real_programs import LONG_S, RealPrograms

NVE, MASTER = (str(pathlib.Path(word).resolve()) for word in sys.argv[1:3])


class Token(RealPrograms):
    def setUp(self):
        super().setUp()
        self.nve("keys", "issuer", "lab", "--keys", "a.toml", "--rights", "operate")
        self.nve("keys", "issuer", "--from", "lab.issuer", "--keys", "b.toml")

    def nve(self, *words):
        done = self.run_program(NVE, *words)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done

    def refused(self, *words):
        """One line, status 2."""
        done = self.run_program(*words)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
        return done.stderr

    def server(self, name):
        server = self.start(name, NVE, "serve", "--scene", "flat_silicon_oxide", "--listen", "127.0.0.1:0", "--keys", f"{name}.toml",
                            "--audit", f"{name}.jsonl")
        server.address = server.said(r"serving .* on (127\.0\.0\.1:\d+)")
        return server

    def station(self, *words):
        return self.start("station", MASTER, "run", "--token", "omega-9.token", "--duration-s", "60",
                          "--rt-priority", "0", *words)

    def events(self, name, event):
        path = self.folder / f"{name}.jsonl"
        end = time.monotonic() + LONG_S
        while time.monotonic() < end:
            found = [line for line in map(json.loads, path.read_text().splitlines()) if line["event"] == event]
            if found:
                return found
            time.sleep(0.05)
        raise AssertionError(path.read_text())

    def test_it_lets_in_at_each_of_its_servers_and_is_known_by_name(self):
        a, b = self.server("a"), self.server("b")
        made = self.nve("token", "omega-9", "--issuer", "lab.issuer", "--server", f"{a.address},{b.address}", "--minutes", "5")
        self.assertRegex(made.stderr, r"omega-9\.token lets 'omega-9' begin sessions that operate with .* until 20\d\d-")
        self.assertEqual((self.folder / "omega-9.token").stat().st_mode & 0o777, 0o600)
        station = self.station()
        self.assertEqual(self.events("a", "session opened")[0]["key"], "lab:omega-9")
        a.process.kill()
        self.assertEqual(self.events("b", "session opened")[0]["rights"], "operate")
        # What its issuer no longer may, it may not either.
        self.nve("keys", "revoke", "lab", "--keys", "b.toml")
        self.nve("keys", "new", "other", "--keys", "b.toml")
        self.assertEqual(station.process.wait(LONG_S), 1, station.text())
        secret = re.search(r'secret = "(\w+)"', (self.folder / "lab.issuer").read_text())[1]
        psk = re.search(r'psk = "(\w+)"', (self.folder / "omega-9.token").read_text())[1]
        for path in self.folder.iterdir():
            if path.suffix not in (".issuer", ".token", ".toml"):
                text = path.read_bytes().decode(errors="replace")
                self.assertNotIn(secret, text, path)
                self.assertNotIn(psk, text, path)

    def test_one_that_has_expired_is_told_at_the_station_and_begins_nothing(self):
        a = self.server("a")
        self.nve("token", "omega-9", "--issuer", "lab.issuer", "--server", a.address, "--minutes", "0.02")
        time.sleep(3)  # its time is what is tested
        self.assertRegex(self.refused(MASTER, "run", "--token", "omega-9.token"), r"has expired at 20\d\d-.*; ask for another")
        # A station that says otherwise is refused by the server, by its own clock.
        path = self.folder / "omega-9.token"
        path.write_text(re.sub(r'expires = "20\d\d', 'expires = "2099', path.read_text()))
        done = self.run_program(MASTER, "run", "--token", "omega-9.token", "--duration-s", "1", "--rt-priority", "0")
        self.assertEqual(done.returncode, 1)
        self.assertIn("the server does not know the key 't.", done.stderr)

    def test_one_that_runs_goes_on_when_its_token_expires(self):
        a = self.server("a")
        self.nve("token", "omega-9", "--issuer", "lab.issuer", "--server", a.address, "--minutes", "0.05")
        done = self.run_program(MASTER, "run", "--token", "omega-9.token", "--duration-s", "6", "--rt-priority", "0")
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_plan_takes_it_and_standard_output_gives_it(self):
        a = self.server("a")
        token = self.nve("token", "omega-9", "--issuer", "lab.issuer", "--server", a.address, "--rights", "observe", "--out", "-")
        (self.folder / "t").write_text(token.stdout)
        self.assertRegex(self.refused(MASTER, "plan", "--token", "t"), "others")
        (self.folder / "t").chmod(0o600)
        done = self.run_program(MASTER, "plan", "--token", "t", "--device", "sim")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("recommended_force_scale", done.stdout)

    def test_wrong_use(self):
        self.assertIn("operate at most", self.refused(NVE, "token", "x", "--issuer", "lab.issuer", "--server", "a:1", "--rights", "administer"))
        self.assertIn("issuer", self.refused(NVE, "token", "x", "--server", "a:1"))
        self.assertIn("1 to 39 letters", self.refused(NVE, "token", "x y", "--issuer", "lab.issuer", "--server", "a:1"))
        self.assertIn("already", self.refused(NVE, "keys", "issuer", "lab", "--keys", "a.toml", "--out", "again.issuer"))
        self.assertIn("give a name for a new issuer, or --from FILE", self.refused(NVE, "keys", "issuer", "--keys", "a.toml"))
        self.nve("token", "x", "--issuer", "lab.issuer", "--server", "127.0.0.1:1")
        self.assertIn("exist", self.refused(NVE, "token", "x", "--issuer", "lab.issuer", "--server", "127.0.0.1:1"))
        self.assertIn("--server", self.refused(MASTER, "run", "--token", "x.token", "--server", "127.0.0.1:1"))
        self.assertIn("omit --key", self.refused(MASTER, "run", "--token", "x.token", "--key", "lab.issuer"))
        self.assertIn("none.token", self.refused(MASTER, "run", "--token", "none.token"))


if __name__ == "__main__":
    sys.exit(side_by_side.main(2, at_once=2))  # each case waits for most of its time
