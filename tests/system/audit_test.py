#!/usr/bin/env python3
"""The audit log of real programs: who came, with which key, how it ended; nothing secret; a file that is moved away; a full disk.

audit_test.py TELENANO_NVE TELENANO_MASTER
"""
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time
import unittest

NVE, MASTER = sys.argv[1], sys.argv[2]
LONG_S = 60


class Server:
    def __init__(self, folder, *words):
        self.folder = folder
        self.process = subprocess.Popen([NVE, "serve", "--scene", "flat_silicon_oxide", "--listen", "127.0.0.1:0", *words],
                                        cwd=folder, stderr=subprocess.PIPE, text=True)
        self.text = ""
        for line in self.process.stderr:
            self.text += line
            found = re.search(r"serving .* on (127\.0\.0\.1:\d+)", line)
            if found:
                self.address = found[1]
                return
        raise AssertionError(self.text)

    def stop(self):
        self.process.send_signal(signal.SIGTERM)
        self.text += self.process.stderr.read()
        return self.process.wait(LONG_S)


def lines_of(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def wait_for(condition):
    end = time.monotonic() + LONG_S
    while not condition():
        if time.monotonic() > end:
            raise AssertionError("it did not come")
        time.sleep(0.02)


class AuditLog(unittest.TestCase):
    def setUp(self):
        holder = tempfile.TemporaryDirectory(prefix="telenano_audit_")
        self.addCleanup(holder.cleanup)
        self.folder = pathlib.Path(holder.name)
        self.log = self.folder / "audit.jsonl"

    def station(self, server, *words):
        return subprocess.run([MASTER, "run", "--server", server.address, "--task", "contact", "--duration-s", "1", "--quiet",
                               "--rt-priority", "0", *words], cwd=self.folder, capture_output=True, text=True, timeout=LONG_S, check=False)

    def test_a_session_with_its_key_and_no_secret(self):
        subprocess.run([NVE, "keys", "new", "omega-1", "--rights", "operate"], cwd=self.folder, check=True, capture_output=True)
        server = Server(self.folder, "--keys", "keys.toml", "--audit", str(self.log))
        run = self.station(server, "--key", "omega-1.key")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertEqual(server.stop(), 0)
        lines = lines_of(self.log)
        events = [line["event"] for line in lines]
        self.assertEqual([events[0], events[-1]], ["server started", "server stopped"])
        self.assertEqual([e for e in events if e.startswith("session")], ["session opened", "session ended"])
        self.assertEqual(lines[0]["listen"], server.address)
        self.assertTrue(lines[0]["encrypted"])
        for line in lines[1:-1]:
            self.assertEqual((line["key"], line["rights"], line["session"]), ("omega-1", "operate", 1), line)
            self.assertRegex(line["address"], r"^127\.0\.0\.1:\d+$")
        times = [line["time"] for line in lines]
        self.assertEqual(times, sorted(times))
        for at in times:
            self.assertRegex(at, r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$")
        secrets = re.findall(r"[0-9a-f]{32,}", (self.folder / "keys.toml").read_text())
        self.assertTrue(secrets)
        for secret in secrets:
            self.assertNotIn(secret, self.log.read_text())
        self.assertEqual(self.log.stat().st_mode & 0o007, 0, "not for everybody")

    def test_it_goes_on_where_the_last_run_ended_and_is_opened_anew_at_a_hangup(self):
        for _ in range(2):
            self.assertEqual(Server(self.folder, "--audit", str(self.log)).stop(), 0)
        self.assertEqual([line["event"] for line in lines_of(self.log)], ["server started", "server stopped"] * 2)
        server = Server(self.folder, "--audit", str(self.log))
        wait_for(lambda: len(lines_of(self.log)) == 5)
        moved = self.folder / "audit.jsonl.1"
        self.log.rename(moved)
        server.process.send_signal(signal.SIGHUP)
        wait_for(self.log.exists)
        self.assertEqual(self.station(server).returncode, 0)
        self.assertEqual(server.stop(), 0)
        self.assertEqual(len(lines_of(moved)), 5)
        self.assertIn("session opened", [line["event"] for line in lines_of(self.log)])

    def test_a_killed_server_has_left_what_it_knew(self):
        server = Server(self.folder, "--audit", str(self.log))
        self.assertEqual(self.station(server).returncode, 0)
        wait_for(lambda: lines_of(self.log)[-1]["event"] == "session ended")
        server.process.kill()
        server.process.wait(LONG_S)
        server.process.stderr.close()
        self.assertEqual(lines_of(self.log)[-1]["event"], "session ended")

    def test_a_file_that_cannot_be_written(self):
        done = subprocess.run([NVE, "serve", "--scene", "flat_silicon_oxide", "--listen", "127.0.0.1:0", "--audit", "nowhere/audit.jsonl"],
                              cwd=self.folder, capture_output=True, text=True, timeout=LONG_S, check=False)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertRegex(done.stderr, "--audit nowhere/audit.jsonl: No such file or directory; give a file that can be appended to")
        self.assertEqual(len(done.stderr.splitlines()), 1)

    @unittest.skipUnless(os.path.exists("/dev/full"), "no /dev/full")
    def test_a_full_disk_stops_no_session(self):
        server = Server(self.folder, "--audit", "/dev/full")
        self.assertEqual(self.station(server).returncode, 0)
        self.assertEqual(server.stop(), 0)
        self.assertEqual(server.text.count("--audit /dev/full: No space left on device"), 1, server.text)


if __name__ == "__main__":
    sys.argv = sys.argv[:1]
    unittest.main(verbosity=2)
