#!/usr/bin/env python3
"""Users of one machine without keys: the kernel says whose a station's socket is. Through the real programs, the other user being
number 65534, who has nothing but his own socket.

local_users_test.py TELENANO_NVE TELENANO_MASTER      needs root, or skips (77)
"""
import json
import os
import pathlib
import shutil
import signal
import socket
import sys
import unittest

from real_programs import RealPrograms

NVE, MASTER = (str(pathlib.Path(word).resolve()) for word in sys.argv[1:3])
NOBODY = 65534


class LocalUsers(RealPrograms):
    def setUp(self):
        super().setUp()
        self.folder.chmod(0o755)
        self.his = self.folder / "his"
        self.his.mkdir()
        os.chown(self.his, NOBODY, NOBODY)
        # Of his own: the project may lie where only root gets to.
        self.his_master = shutil.copy(MASTER, self.folder / "his-master")

    def server(self, *words):
        server = self.start("server", NVE, "serve", "--scene", "flat_silicon_oxide", "--listen", "127.0.0.1:0", "--audit", "audit.jsonl",
                            *words)
        server.address = server.said(r"serving .* on (127\.0\.0\.1:\d+)")
        return server

    def station(self, server, name, *words, user=0):
        more = {"user": NOBODY, "group": NOBODY, "extra_groups": [], "env": {**os.environ, "HOME": str(self.his), "XDG_STATE_HOME": str(self.his)}}
        return self.start(name, self.his_master if user else MASTER, "run", "--server", server.address, "--duration-s", "600", "--rt-priority", "0",
                          *words, **(more if user else {}))

    def opened(self):
        lines = map(json.loads, (self.folder / "audit.jsonl").read_text().splitlines())
        return {(line["key"], line["rights"]) for line in lines if line["event"] == "session opened"}

    def test_each_has_his_own_right(self):
        server = self.server("--local-users", f"root:administer,{NOBODY}:observe")
        stations = [self.station(server, "root"), self.station(server, "nobody", user=NOBODY)]
        for station in stations:
            station.said("loop: ")
        self.wait_for(lambda: len(self.opened()) == 2, "two sessions")
        self.assertEqual(self.opened(), {("user root", "administer"), (f"user {NOBODY}", "observe")})

    def test_who_is_not_named_gets_nothing(self):
        server = self.server("--local-users", "root:operate")
        mine = self.station(server, "root")
        mine.said("loop: ")
        his = self.station(server, "nobody", "--connect-timeout-s", "1", user=NOBODY)
        self.assertEqual(his.end(), 1, his.text())
        self.assertIn("--local-users", his.text().splitlines()[-1])
        # By hand, too: what a socket of his sends is answered by nothing, whatever it is.
        host, port = server.address.split(":")
        pid = os.fork()
        if pid == 0:
            os.setgid(NOBODY)
            os.setuid(NOBODY)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
                sock.settimeout(0.5)
                sock.connect((host, int(port)))
                try:
                    for size in (0, 1, 100, 512):
                        sock.send(bytes(size))
                        sock.recv(600)
                    os._exit(1)
                except TimeoutError:
                    os._exit(0)
        self.assertEqual(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), 0)
        self.assertIsNone(mine.process.poll(), mine.text())
        server.signal(signal.SIGTERM)
        server.end()
        self.assertRegex(server.text(), r"--local-users: [1-9]\d* datagrams of others")

    def test_wrong_words(self):
        for words, said in ((("--local-users", "root"), "expected USER:RIGHT"),
                            (("--local-users", "root:rule"), "expected USER:RIGHT"),
                            (("--local-users", "root:operate,"), "expected USER:RIGHT"),
                            (("--local-users", "nosuchuser:operate"), "there is no user 'nosuchuser'"),
                            (("--local-users", "root:operate,0:observe"), "comes twice"),
                            (("--local-users", "root:operate", "--local-rights", "observe"), "omit"),
                            (("--local-users", "root:operate", "--listen", "0.0.0.0:0"), "off loopback")):
            words += () if "--listen" in words else ("--listen", "127.0.0.1:0")
            done = self.run_program(NVE, "serve", "--scene", "flat_silicon_oxide", *words)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
            self.assertIn(said, done.stderr)


if __name__ == "__main__":
    if os.geteuid() != 0:
        print("skipped: only root can be two users")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1] + sys.argv[3:], verbosity=2)
