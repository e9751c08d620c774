#!/usr/bin/env python3
"""Stations with key pairs of their own, through the real programs: enrolment, what the server holds, who is refused, expiry,
revoking within a session, and a change of keys that goes on with the session.

public_key_test.py TELENANO_NVE TELENANO_MASTER
"""
import datetime
import json
import pathlib
import re
import shlex
import shutil
import signal
import sys
import unittest

import side_by_side
from real_programs import RealPrograms

NVE, MASTER = (str(pathlib.Path(word).resolve()) for word in sys.argv[1:3])


class PublicKeys(RealPrograms):
    def done_well(self, *words):
        done = self.run_program(*words)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done

    def enroll(self, name, *more, out=None):
        """Both commands, as a person runs them: the station's prints the server's. Returns what the station shows."""
        out = out or f"{name}.id"
        line = self.done_well(MASTER, "enroll", name, "--out", out).stdout
        self.assertRegex(line, rf"\Atelenano-nve keys add {re.escape(name)} --public sha256:[0-9a-f]{{64}}\n\Z")
        said = self.done_well(NVE, *shlex.split(line)[1:], *more).stderr
        found = re.search(r"telenano-master run --identity \S+ (--server-key sha256:[0-9a-f]{64})\n", said)
        self.assertTrue(found, said)
        return ("--identity", out, *found[1].split())

    def server(self, name="server"):
        server = self.start(name, NVE, "serve", "--scene", "flat_silicon_oxide", "--listen", "127.0.0.1:0", "--keys", "keys.toml",
                            "--audit", "audit.jsonl")
        server.address = server.said(r"serving .* on (127\.0\.0\.1:\d+), encrypted")
        return server

    def station(self, server, *words, name="station"):
        return self.start(name, MASTER, "run", "--server", server.address, "--duration-s", "600", "--rt-priority", "0", *words)

    def in_session(self, station):
        station.said("loop: ")
        return station

    def refused(self, server, words, pattern):
        """One line, status 1."""
        done = self.run_program(MASTER, "run", "--quiet", "--server", server.address, "--duration-s", "1", *words)
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
        self.assertRegex(done.stderr, pattern)

    def events(self, event):
        return [line for line in map(json.loads, (self.folder / "audit.jsonl").read_text().splitlines()) if line["event"] == event]

    def expires_soon(self, days):
        """The only end in the server's list lies so many days ahead, and is moved near. The session runs by then, so that no
        machine is too slow for it."""
        keys = self.folder / "keys.toml"
        text = keys.read_text()
        (end,) = re.findall(r'expires = "(\S+)"', text)
        now = datetime.datetime.now(datetime.timezone.utc)
        left_s = (datetime.datetime.fromisoformat(end.replace("Z", "+00:00")) - now).total_seconds()
        self.assertTrue(86400 * days - 600 < left_s <= 86400 * days, end)
        new = self.folder / "keys.new"
        new.touch(0o600)
        new.write_text(text.replace(end, (now + datetime.timedelta(seconds=3)).strftime("%Y-%m-%dT%H:%M:%SZ")))
        new.rename(keys)

    def test_two_commands_let_a_station_in_and_the_server_holds_no_secret_of_it(self):
        shown = self.enroll("omega-1", "--rights", "observe")
        self.assertEqual((self.folder / "omega-1.id").stat().st_mode & 0o777, 0o600)
        secret = (self.folder / "omega-1.id").read_text().split("-----")[2].split()[1]
        self.done_well(NVE, "keys", "new", "pencil")
        server = self.server()
        station = self.in_session(self.station(server, *shown))
        other = self.in_session(self.station(server, "--key", "pencil.key", name="other"))
        self.wait_for(lambda: len(self.events("session opened")) == 2, "two sessions")
        self.assertEqual({(e["key"], e["rights"]) for e in self.events("session opened")}, {("omega-1", "observe"), ("pencil", "operate")})
        for program in (station, other, server):
            program.signal(signal.SIGTERM)
            self.assertEqual(program.end(), 0, program.text())
        for path in self.folder.iterdir():
            if path.name != "omega-1.id":
                self.assertNotIn(secret, path.read_text(errors="replace"), path)
        self.assertRegex(self.done_well(NVE, "keys", "list").stdout, r"(?m)^public,omega-1 sha256:[0-9a-f]{64},observe,$")
        again = self.done_well(MASTER, "enroll", "omega-1")
        self.assertIn("already holds this station's key pair", again.stderr)

    def test_who_is_not_known_is_refused_at_either_end(self):
        shown = self.enroll("omega-1")
        self.done_well(MASTER, "enroll", "omega-1", "--out", "false.id")  # the same name, another pair
        server = self.server()
        self.refused(server, ("--identity", "false.id", *shown[2:]), "does not know the public key of false.id: .*telenano-master enroll")
        self.refused(server, (*shown[:2], "--server-key", "sha256:" + 64 * "0"), "not the one of --server-key, it shows sha256:[0-9a-f]{64}")
        self.done_well(NVE, "keys", "identity", "--keys", str(self.folder / "sub.toml"))  # the same folder, the same identity
        self.in_session(self.station(server, *shown))

    def test_what_has_expired_ends_and_opens_nothing(self):
        stays = self.enroll("omega-2")
        short = self.enroll("omega-1", "--days", "1")
        server = self.server()
        station = self.in_session(self.station(server, *short, "--give-up-s", "1"))
        self.expires_soon(1)
        server.said("'omega-1' has expired")
        self.assertEqual(station.end(), 1)
        self.refused(server, short, "does not know the public key of omega-1.id")
        self.in_session(self.station(server, *stays))

    def test_revoking_ends_the_session_that_runs(self):
        shown, other = self.enroll("omega-1"), self.enroll("omega-2")
        server = self.server()
        station = self.in_session(self.station(server, *shown, "--give-up-s", "1"))
        stays = self.in_session(self.station(server, *other, name="stays"))
        self.done_well(NVE, "keys", "revoke", "omega-1")
        self.assertEqual(station.end(), 1)
        self.refused(server, shown, "does not know the public key of omega-1.id")
        self.assertIsNone(stays.process.poll(), stays.text())

    def test_two_pairs_of_one_station_overlap(self):
        first = self.enroll("omega-1", "--rights", "administer")
        server = self.server()
        station = self.in_session(self.station(server, *first))
        second = self.enroll("omega-1", "--overlap-days", "2", out="next.id")
        self.assertEqual(len(self.done_well(NVE, "keys", "list").stdout.splitlines()), 3)
        server.said("keys read again: 2 entries")
        station.kill()
        next_one = self.in_session(self.station(server, *second, name="next"))
        self.wait_for(lambda: len(self.events("session opened")) == 2, "its line in the audit log")
        self.assertEqual({e["rights"] for e in self.events("session opened")}, {"administer"})
        self.expires_soon(2)
        server.said("'omega-1' has expired")
        self.refused(server, first, "does not know the public key of omega-1.id")
        self.assertIsNone(next_one.process.poll(), next_one.text())
        # One of several can be revoked alone.
        key = re.search("sha256:[0-9a-f]{64}", self.done_well(MASTER, "enroll", "omega-1").stdout)[0]
        self.done_well(NVE, "keys", "revoke", key)
        self.assertEqual(len(self.done_well(NVE, "keys", "list").stdout.splitlines()), 2)

    def test_the_start_screen_opens_a_session_with_the_pair_and_remembers_it(self):
        """The window of `start`, and its second one without any word of keys."""
        if not all(map(shutil.which, ("xvfb-run", "xdotool"))):
            self.skipTest("no xvfb-run or xdotool: apt-get install xvfb xauth xdotool")
        shown = self.enroll("omega-1")
        server = self.server()
        (self.folder / "user.sh").write_text(f"""
export XDG_STATE_HOME={self.folder}/state
see() {{ xdotool search --sync --name "$1" >/dev/null; }}
session() {{
  {MASTER} start "$@" 2>>err.txt & start=$!
  see 'Telenano: start, sim at .*, answered'; xdotool key Return; see 'Telenano: flat_silicon_oxide at'
  for i in $(seq 600); do [ $(grep -c 'session opened' audit.jsonl) -ge $want ] && break; sleep 0.1; done
  kill $start; wait $start
}}
want=2; session --server {server.address} {shlex.join(shown)}
want=4; session
""")
        done = self.run_program("xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "timeout", "100", "bash", "user.sh", wait_s=120)
        said = done.stdout + done.stderr + (self.folder / "err.txt").read_text()
        # Each time the plan, which asks the server what will be felt, and the session itself.
        self.assertEqual([e["key"] for e in self.events("session opened")], 4 * ["omega-1"], said)
        self.assertEqual((self.folder / "state/telenano/servers").read_text(),
                         "\t".join((server.address, "", "flat_silicon_oxide", shown[1], shown[3])) + "\n")

    def test_wrong_words(self):
        shown = self.enroll("omega-1")
        (self.folder / "open.id").write_bytes((self.folder / "omega-1.id").read_bytes())
        (self.folder / "open.id").chmod(0o644)
        (self.folder / "empty.id").touch(0o600)
        run = (MASTER, "run", "--server", "127.0.0.1:5100")
        start = (MASTER, "start", "--server", "127.0.0.1:5100")
        for words, said in (((*start, *shown[:2]), "used together"),
                            ((*start, *shown[2:]), "used together"),
                            ((*start, *shown[:3], "sha256:12"), "expected \"sha256:\" and 64"),
                            ((*start, *shown, "--key", "x.key"), "omit --key"),
                            ((*start, "--identity", "open.id", *shown[2:]), "chmod 600"),
                            ((*start, "--identity", "none.id", *shown[2:]), "none.id"),
                            ((MASTER, "start", *shown), "--server"),
                            ((*run, *shown[:2]), "used together"),
                            ((*run, *shown[2:]), "used together"),
                            ((*run, *shown[:3], "sha256:12"), "expected \"sha256:\" and 64"),
                            ((*run, *shown, "--key", "x.key"), "omit --key"),
                            ((*run, "--identity", "open.id", *shown[2:]), "chmod 600"),
                            ((*run, "--identity", "empty.id", *shown[2:]), "holds no identity"),
                            ((*run, "--identity", "none.id", *shown[2:]), "none.id"),
                            ((MASTER, "enroll", "no name"), "letters, digits"),
                            ((MASTER, "enroll", "x", "--out", "open.id"), "chmod 600"),
                            ((NVE, "keys", "add", "omega-2", "--public", "12"), "expected \"sha256:\" and 64"),
                            ((NVE, "keys", "add", "omega-1", "--public", "sha256:" + 64 * "1"), "--overlap-days"),
                            ((NVE, "keys", "revoke", "sha256:" + 64 * "1"), "has no key")):
            done = self.run_program(*words)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
            self.assertIn(said, done.stderr)
        (self.folder / "server.id").unlink()
        done = self.run_program(NVE, "serve", "--scene", "flat_silicon_oxide", "--listen", "127.0.0.1:0", "--keys", "keys.toml")
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn("telenano-nve keys identity makes", done.stderr)


if __name__ == "__main__":
    sys.exit(side_by_side.main(2, at_once=2))  # each case waits for most of its time
