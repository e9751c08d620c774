#!/usr/bin/env python3
"""A real server among others: /healthz and /readyz while it starts, serves and is full; how it ends.

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

import side_by_side

NVE, MASTER = (str(pathlib.Path(word).resolve()) for word in sys.argv[1:3])
LONG_S = 60
ENGAGED = 2  # of a recording's station_mode


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
        # A hand that goes down to the sample and stays there.
        (self.folder / "press.csv").write_text("t_s,x_nm,y_nm,z_nm\n0,0,0,20\n0.5,0,0,20\n1.5,0,0,-5\n600,0,0,-5\n")
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
        self.programs.append(Program(self.folder, name, MASTER, "run", "--server", server.address(), "--task", "script",
                                     "--script", "press.csv", "--duration-s", "600", "--rt-priority", "0", "--metrics", "127.0.0.1:0", *words))
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
        for words in ((), ("--busy-poll",), ("--share", "one-tip")):
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


class End(HealthTest):
    def test_before_it_serves_it_ends_at_once(self):
        server = self.server(scene="flakes", env={**os.environ, "XDG_CACHE_HOME": str(self.folder / "cache")})
        server.signal(signal.SIGTERM)
        self.assertEqual(server.end(), 0)
        self.assertIn("stopped while the scene was loaded", server.text())

    def test_it_ends_soon_and_who_presses_feels_no_step(self):
        server = self.server()
        station = self.station(server, "--record", "session.h5", "--give-up-s", "1")
        self.in_contact(station)
        time.sleep(1)  # down to where it stays
        server.signal(signal.SIGTERM)
        told = time.monotonic()
        self.assertEqual(server.end(), 0, server.text())
        self.assertLess(time.monotonic() - told, 3)
        station.said("the server is shutting down: the force is zero")
        self.assertNotEqual(station.end(), 0)
        rows = self.recorded("station_mode,hand_force_applied_h_n")
        force_n = [sum(v * v for v in row[1:]) ** 0.5 for row in rows]
        engaged = [int(row[0]) == ENGAGED for row in rows]
        end = len(engaged) - engaged[::-1].index(True)  # the tick at which the Bye has come
        self.assertGreater(force_n[end - 1], 0.1, "it was felt to the end")
        self.assertEqual(force_n[-1], 0)
        most = max(abs(b - a) for a, b in zip(force_n[end - 1:], force_n[end:]))
        # It fades over 20 ticks, 5 % each; a busy machine may leave out some of them.
        self.assertLess(most, 0.3 * force_n[end - 1])

    def recorded(self, columns):
        text = subprocess.run([MASTER, "export", "session.h5", "--columns", columns], cwd=self.folder, check=True, capture_output=True,
                              text=True).stdout
        return [[float(word) for word in line.split(",")] for line in text.splitlines() if line[0] in "-0123456789"]


if __name__ == "__main__":
    sys.exit(side_by_side.main(2, at_once=4))  # each case waits for most of its time
