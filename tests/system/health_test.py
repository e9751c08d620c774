#!/usr/bin/env python3
"""/healthz and /readyz of a real server: while it starts, serves, is full, hangs and ends.

health_test.py TELENANO_NVE TELENANO_MASTER
"""
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.error
import urllib.request

NVE, MASTER = (str(pathlib.Path(word).resolve()) for word in sys.argv[1:3])
LONG_S = 60


def wait_for(condition, what="it"):
    end = time.monotonic() + LONG_S
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"{what} did not come")
        time.sleep(0.02)


class Program:
    """A program whose stderr is a file: it never waits for who reads it."""

    def __init__(self, folder, name, *words, env=None):
        self.path = pathlib.Path(folder) / name
        with self.path.open("w") as err:
            self.process = subprocess.Popen(words, cwd=folder, stdout=subprocess.DEVNULL, stderr=err, env=env)

    def text(self):
        return self.path.read_text()

    def said(self, pattern):
        wait_for(lambda: re.search(pattern, self.text()) or self.process.poll() is not None, pattern)
        found = re.search(pattern, self.text())
        if not found:
            raise AssertionError(f"no {pattern} in: {self.text()}")
        return found[1] if found.groups() else found[0]

    def signal(self, number):
        self.process.send_signal(number)

    def end(self):
        return self.process.wait(LONG_S)


class Server(Program):
    def __init__(self, folder, *words, name="server", scene="flat_silicon_oxide", env=None):
        super().__init__(folder, name, NVE, "serve", *(["--scene", scene] if scene else []), "--listen", "127.0.0.1:0",
                         "--metrics", "127.0.0.1:0", *words, env=env)
        self.http = self.said(r"metrics at (http://127\.0\.0\.1:\d+)/metrics\n")

    def address(self):
        return self.said(r"serving .* on (127\.0\.0\.1:\d+)")

    def get(self, page):
        """Status and text; None where nobody answers any more."""
        try:
            with urllib.request.urlopen(self.http + page, timeout=LONG_S) as answer:
                return answer.status, answer.read().decode()
        except urllib.error.HTTPError as answer:
            return answer.code, answer.read().decode()
        except OSError:
            return None


class HealthTest(unittest.TestCase):
    def setUp(self):
        holder = tempfile.TemporaryDirectory(prefix="telenano_health_")
        self.addCleanup(holder.cleanup)
        self.folder = pathlib.Path(holder.name)
        self.programs = []
        self.addCleanup(self.kill_all)

    def kill_all(self):
        for program in self.programs:
            if program.process.poll() is None:
                program.process.kill()
                program.process.wait()

    def server(self, *words, **how):
        self.programs.append(Server(self.folder, *words, **how))
        return self.programs[-1]

    def station(self, server, *words, name="station"):
        words = words if "--duration-s" in words else ("--duration-s", "600", *words)
        self.programs.append(Program(self.folder, name, MASTER, "run", "--server", server.address(), "--task", "contact",
                                     "--rt-priority", "0", "--metrics", "127.0.0.1:0", *words))
        return self.programs[-1]

    def in_contact(self, station):
        at = station.said(r"metrics at (http://\S+/metrics)\n")

        def presses():
            with urllib.request.urlopen(at, timeout=LONG_S) as answer:
                found = re.search(r"^telenano_force_newtons (\S+)", answer.read().decode(), re.MULTILINE)
            return found and float(found[1]) > 1e-9
        wait_for(presses, "contact")


class Health(HealthTest):
    def test_a_server_that_serves_is_alive_and_ready_and_metrics_are_there_too(self):
        for words in ((), ("--workers", "3"), ("--busy-poll",), ("--share", "one-tip")):
            with self.subTest(words=words):
                server = self.server(*words)
                server.address()
                wait_for(lambda server=server: server.get("/readyz") == (200, "ready\n"), "ready")
                self.assertEqual(server.get("/healthz"), (200, "ok\n"))
                self.assertIn("telenano_build_info", server.get("/metrics")[1])
                self.assertEqual(server.get("/other")[0], 404)
                server.signal(signal.SIGTERM)
                self.assertEqual(server.end(), 0)

    def test_while_the_scene_is_made_it_starts(self):
        # The fields of this scan are made anew, which takes a second or more.
        server = self.server(scene="flakes", env={**os.environ, "XDG_CACHE_HOME": str(self.folder / "cache")})
        self.assertEqual([server.get(page) for page in ("/healthz", "/readyz")], [(503, "starting\n")] * 2)
        self.assertNotIn("serving", server.text())
        self.assertIn("telenano_build_info", server.get("/metrics")[1])
        server.address()
        wait_for(lambda: server.get("/readyz") == (200, "ready\n"), "ready")

    def test_a_server_without_a_free_place_says_so_and_is_ready_again(self):
        server = self.server("--max-sessions", "1")
        station = self.station(server)
        station.said("loop: ")
        wait_for(lambda: server.get("/readyz") == (503, "full\n"), "full")
        self.assertEqual(server.get("/healthz"), (200, "ok\n"))
        station.signal(signal.SIGTERM)
        station.end()
        wait_for(lambda: server.get("/readyz") == (200, "ready\n"), "ready")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[3:], verbosity=2)
