"""What the tests of the real programs share: their starter, and a folder whose programs end with the test."""
import pathlib
import re
import subprocess
import tempfile
import time
import unittest
import urllib.request

LONG_S = 60  # only what hangs takes so long


class Program:
    """Its stderr is a file: it never waits for who reads it."""

    def __init__(self, folder, name, *words, out=subprocess.DEVNULL, **more):
        self.path = pathlib.Path(folder) / name
        with self.path.open("w") as err:
            self.process = subprocess.Popen([str(word) for word in words], cwd=folder, stdout=out, stderr=err, **more)

    def text(self):
        return self.path.read_text()

    def said(self, pattern):
        end = time.monotonic() + LONG_S
        while not (found := re.search(pattern, self.text())):
            if time.monotonic() > end or self.process.poll() is not None:
                found = re.search(pattern, self.text())
                break
            time.sleep(0.02)
        if not found:
            raise AssertionError(f"no {pattern} in: {self.text()}")
        return found[1] if found.groups() else found[0]

    def signal(self, number):
        self.process.send_signal(number)

    def kill(self):
        self.process.kill()
        self.process.wait()

    def end(self):
        return self.process.wait(LONG_S)

    def metric(self, name):
        """Of one that was started with --metrics; None: it has no such line yet."""
        at = self.said(r"metrics at (http://\S+/metrics)\n")
        with urllib.request.urlopen(at, timeout=LONG_S) as answer:
            found = re.search(rf"^{name} (\S+)", answer.read().decode(), re.MULTILINE)
        return float(found[1]) if found else None


class RealPrograms(unittest.TestCase):
    """A folder of its own, in which programs run until the test is over."""

    def setUp(self):
        holder = tempfile.TemporaryDirectory(prefix="telenano_programs_")
        self.addCleanup(holder.cleanup)
        self.folder = pathlib.Path(holder.name)
        self.programs = []
        self.addCleanup(self.kill_all)

    def kill_all(self):
        for program in self.programs:
            if program.process.poll() is None:
                program.kill()

    def start(self, name, *words, **more):
        self.programs.append(Program(self.folder, name, *words, **more))
        return self.programs[-1]

    def run_program(self, *words, wait_s=LONG_S, **more):
        return subprocess.run([str(word) for word in words], cwd=self.folder, capture_output=True, text=True, timeout=wait_s, check=False,
                              **more)

    def wait_for(self, what, why="it"):
        end = time.monotonic() + LONG_S
        while not what():
            self.assertLess(time.monotonic(), end, f"{why} did not come")
            time.sleep(0.02)
