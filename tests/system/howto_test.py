#!/usr/bin/env python3
"""The how-tos "fit your curve", "a bad link", "a class of twenty students" and "your own slave": their commands word for word. What is
put in their place: the machine's name nve.lab is this machine, and the slave's example is the one that is built already.

python3 tests/system/howto_test.py SOURCE_DIR BIN_DIR [TEST]
"""
import csv
import json
import math
import os
import pathlib
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import unittest

source, programs = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])


def commands(document):
    """The lines of its sh blocks."""
    text = (source / "deploy/docs" / document).read_text()
    blocks = re.findall(r"```sh\n(.*?)```", text, re.S)
    return [line.replace("nve.lab", "127.0.0.1") for block in blocks for line in block.splitlines() if line]


class HowTo(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="telenano-howto-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        self.environment = dict(os.environ, PATH=f"{programs}:{os.environ['PATH']}")

    def run_line(self, line, timeout=240):
        run = subprocess.run(["/bin/sh", "-c", line], cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=timeout)
        self.assertEqual(run.returncode, 0, f"{line}: {run.stdout}{run.stderr}")
        return run.stdout + run.stderr

    def leave_running(self, line, until):
        """A command that is to go on; `until` stands in what it says when it is ready. Returns what it has said, which grows."""
        words = line.split("#")[0].split()
        process = subprocess.Popen(words, cwd=self.folder, env=self.environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        said, ready = [], threading.Event()

        def read():
            for text in process.stderr:
                said.append(text)
                if until in text:
                    ready.set()
            ready.set()

        reader = threading.Thread(target=read)
        reader.start()

        def end():
            process.send_signal(signal.SIGTERM)
            process.wait(timeout=60)
            reader.join()
            process.stderr.close()

        self.addCleanup(end)
        ready.wait()
        self.assertTrue(any(until in text for text in said), f"{line}: {''.join(said)}")
        return said

    def test_fit_your_curve(self):
        shutil.copy(source / "deploy/scenes/flat_polystyrene.toml", self.folder / "start.toml")
        noise = random.Random(1)

        def curve(name, modulus):
            text = (source / "deploy/scenes/flat_polystyrene.toml").read_text().replace("youngs_modulus_gpa = 2.0", f"youngs_modulus_gpa = {modulus}")
            (self.folder / "of.toml").write_text(text)
            made = self.run_line("telenano-nve curve --scene of.toml --from-nm 25 --to-nm -8 --step-nm 0.15")
            with open(self.folder / name, "w", newline="") as out:
                out.write("direction,z_nm,deflection_nm\n")
                for row in csv.DictReader(made.splitlines()):
                    out.write("%s,%s,%.6f\n" % (row["direction"], row["base_z_nm"], float(row["deflection_nm"]) + noise.gauss(0, 0.01)))

        curve("my_curve.csv", 2.0)
        (self.folder / "map").mkdir()
        for i in range(16):
            curve(f"map/{i:02}.csv", 1.5 + 0.1 * i)
        # A spectrum of the scene's lever, 40 N/m: an oscillator of 150 kHz, Q = 100, each value the mean of 50.
        bath, f0, quality = 0.817 * 1.380649e-5 * 295.15 / 40, 150e3, 100
        rows = ["frequency_hz,psd_nm2_hz"]
        for f in range(20_000, 400_000, 100):
            s = bath / (0.5 * math.pi * f0 * quality) / ((1 - (f / f0) ** 2) ** 2 + (f / f0 / quality) ** 2) + 1e-12
            rows.append("%d,%.6g" % (f, s * noise.gammavariate(50, 1 / 50)))
        (self.folder / "free_lever.csv").write_text("\n".join(rows) + "\n")
        rows = ["direction,z_nm,deflection_nm"]
        for i in range(400):
            z = 100 - i if i < 200 else i - 300
            rows.append("%s,%d,%.5f" % ("approach" if i < 200 else "retract", z, max(0, -z) / 3 + noise.gauss(0, 0.02)))
        (self.folder / "on_reference.csv").write_text("\n".join(rows) + "\n")
        lines = commands("fit-your-curve.md")
        self.assertEqual(len(lines), 4)
        said = [self.run_line(line) for line in lines]
        for i in (1, 2):
            self.assertAlmostEqual(float(re.search(r"^lever +([^ ]+) N/m", said[i], re.M)[1]) / 40, 1, delta=0.06)
        self.assertRegex(said[0], r"(?m)^E +[12]\.[09]")
        self.assertEqual((self.folder / "pictures/E.gsf").read_bytes().count(b"XRes = 4\n"), 1)
        self.assertIn("median of 16 curves", said[3])

    def test_a_bad_link(self):
        self.leave_running("telenano-nve serve --scene flakes", "serving")
        relay, station = commands("bad-link.md")
        self.leave_running(relay, "127.0.0.1:5200")
        said = self.run_line(station)
        # What the relay does is what the station sees: 20 ms each way at least, and datagrams that are lost.
        seen = re.findall(r"RTT (\d+) us, least (\d+), .*lost (\d+) up (\d+) down", said)
        self.assertTrue(seen, said)
        _, least, up, down = map(int, seen[-1])
        self.assertGreaterEqual(least, 40_000)
        self.assertGreater(up + down, 0)

    def test_a_class_of_twenty(self):
        lines = commands("class-of-twenty.md")
        serve = next(i for i, line in enumerate(lines) if "telenano-nve serve" in line)
        for line in lines[:serve]:
            self.run_line(line)
        self.assertEqual(len(list(self.folder.glob("student-*.key"))), 20)
        self.leave_running(lines[serve], "serving")
        said = [self.run_line(line) for line in lines[serve + 1:]]
        self.assertEqual(len(list(self.folder.glob("student-*.h5"))), 20)
        for table in self.folder.glob("student-*.csv"):
            self.assertGreater(len(table.read_text().splitlines()), 20, f"{table.name}: {table.read_text()}")
        came = {json.loads(line).get("key") for line in (self.folder / "class.log").read_text().splitlines()}
        for i in range(1, 21):
            self.assertIn(f"student-{i:02}", came)
        self.assertIn("student-07", said[-2])
        self.assertNotIn("student-13", self.run_line("telenano-nve keys list"))

    def test_your_own_slave(self):
        build, run, touch, export = commands("your-own-slave.md")
        self.assertIn("deploy/examples", build)  # what is built that way is tested by `library_installed`
        binary = run.split()[0]
        (self.folder / binary).parent.mkdir(parents=True)
        (self.folder / binary).symlink_to(next(programs.parent.rglob("04_slave")))
        self.leave_running(f"{self.folder / binary} {run.split()[1]}", "a wall of 5 N/m")
        self.run_line(touch)
        rows = list(csv.DictReader(self.run_line(export).splitlines()))
        self.assertGreater(len(rows), 20)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + [f"HowTo.test_{name}" for name in sys.argv[3:]])
