#!/usr/bin/env python3
"""The tutorial "feel your own sample": its commands word for word, with a scan of the project and a noisy curve of a
known material as the person's files.

python3 tests/system/tutorial_test.py SOURCE_DIR TELENANO_NVE TELENANO_MASTER [PICTURES]

With a folder PICTURES, its two pictures are put there.
"""
import csv
import os
import pathlib
import random
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

source, nve, master = (pathlib.Path(argument).resolve() for argument in sys.argv[1:4])
pictures = pathlib.Path(sys.argv[4]) if len(sys.argv) > 4 else None


def picture_size(path):
    """Width and height of a PNG whose pixels are there: unpacked, and not of one colour."""
    data, at, packed = path.read_bytes(), 8, b""
    assert data[:8] == b"\x89PNG\r\n\x1a\n", path
    size = struct.unpack(">II", data[16:24])
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at:at + 8])
        packed += data[at + 8:at + 8 + length] if kind == b"IDAT" else b""
        at += 12 + length
    assert len(set(zlib.decompress(packed))) > 16, f"{path}: nothing is drawn"
    return size


def commands():
    text = (source / "deploy/docs/feel-your-own-sample.md").read_text()
    blocks = re.findall(r"```sh\n(.*?)```", text, re.S)
    return [line for block in blocks for line in block.splitlines() if line]


class Tutorial(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="telenano-tutorial-"))
        self.addCleanup(shutil.rmtree, self.folder)
        self.environment = dict(os.environ, PATH=f"{nve.parent}:{os.environ['PATH']}")

    def files(self):
        shutil.copy(source / "deploy/data/wsxm_600nm.gsf", self.folder / "my_scan.gsf")
        made = subprocess.run([nve, "curve", "--scene", "flat_polystyrene", "--from-nm", "40", "--to-nm", "-15",
                               "--step-nm", "0.05"], capture_output=True, text=True, check=True)
        noise = random.Random(1)
        with open(self.folder / "my_curve.csv", "w", newline="") as out:
            out.write("z_nm,deflection_nm\n")
            for row in csv.DictReader(made.stdout.splitlines()):
                out.write("%.6f,%.6f\n" % (5000 - float(row["base_z_nm"]), float(row["deflection_nm"]) + noise.gauss(3, 0.01)))

    def test_word_for_word(self):
        self.files()
        server = None
        try:
            said = []
            for command in commands():
                if " serve " in command:
                    # No shell in between, so that what ends is the server.
                    server = subprocess.Popen(command.split(), cwd=self.folder, env=self.environment,
                                              stderr=subprocess.PIPE, text=True)
                    line = server.stderr.readline()
                    while line and "serving" not in line:
                        line = server.stderr.readline()
                    self.assertIn("serving", line, command)
                    continue
                run = subprocess.run(["/bin/sh", "-c", command], cwd=self.folder, env=self.environment,
                                     capture_output=True, text=True, timeout=240)
                self.assertEqual(run.returncode, 0, f"{command}: {run.stdout}{run.stderr}")
                said.append(run.stdout)
            self.assertEqual(len(said), 5)
            # The scene's Poisson's ratio stays 0.27, the curve is of E = 2 GPa with 0.4: what a curve shows is
            # E/(1 - nu^2). Work of adhesion 2 sqrt(0.066 * 0.2). A percent: noise of 0.01 nm over 40 N/m moves them
            # by less.
            fitted = (self.folder / "my_sample/fitted.toml").read_text()
            modulus = float(re.search(r"youngs_modulus_gpa = ([^ ]+)   # fitted", fitted)[1])
            work = float(re.search(r"work_of_adhesion_j_m2 = ([^ ]+)   # fitted", fitted)[1])
            self.assertAlmostEqual(modulus / (1 - 0.27**2) / (2.0 / (1 - 0.4**2)), 1, delta=0.01)
            self.assertAlmostEqual(work / (2 * (0.066 * 0.2) ** 0.5), 1, delta=0.01)
            for row in ("residuals", "95 % interval", "1 % of k, InvOLS, R moves it by"):
                self.assertIn(row, said[1])
            self.assertGreater(len(said[4].splitlines()), 100, "no curve in what was recorded")
            self.assertEqual(picture_size(self.folder / "fit.png"), (900, 800))
            self.assertEqual(picture_size(self.folder / "touch.png"), (1280, 800))
            for name in ("fit", "touch"):
                self.assertTrue((source / f"deploy/pictures/own_sample_{name}.png").exists() or pictures)
                if pictures:
                    shutil.copy(self.folder / f"{name}.png", pictures / f"own_sample_{name}.png")
        finally:
            if server is not None:
                server.terminate()
                server.communicate(timeout=30)

    def refused(self, content, *more, scene="flat_polystyrene"):
        name = self.folder / "curve.csv"
        name.write_bytes(content)
        run = subprocess.run([nve, "fit", name, "--scene", scene, "-o", self.folder / "fitted.toml", *more],
                             capture_output=True, text=True, timeout=60)
        self.assertEqual(run.returncode, 2, run.stderr)
        self.assertEqual(run.stdout, "")
        self.assertEqual(len(run.stderr.splitlines()), 1, run.stderr)
        self.assertFalse((self.folder / "fitted.toml").exists())
        return run.stderr

    def test_one_line_for_what_is_no_curve(self):
        self.assertIn("empty", self.refused(b""))
        self.assertIn("not in a supported format", self.refused(bytes(range(256)) * 4))
        self.assertIn("zip", self.refused(b"PK\x03\x04" + bytes(100)))
        self.assertIn("Igor", self.refused(b"\x05\x00" + bytes(100)))
        table = "z_nm,deflection_v\n" + "".join(f"{abs(50 - i)},{max(0, 5 - abs(50 - i)):g}\n" for i in range(100))
        self.assertIn("--invols-nm-v", self.refused(table.encode()))
        self.assertIn("--invols-nm-v is 'x'", self.refused(table.encode(), "--invols-nm-v", "x"))
        self.assertIn("--radius-nm", self.refused(table.encode(), "--radius-nm", "0"))
        self.assertIn("rigid", self.refused(table.encode(), scene=self.rigid()))

    def rigid(self):
        text = (source / "deploy/scenes/flat_polystyrene.toml").read_text()
        path = self.folder / "rigid.toml"
        path.write_text(re.sub(r"stiffness_n_m = 40.0.*", "rigid = true", text, count=1))
        return path

    def test_any_number_of_threads_gives_the_same(self):
        self.files()
        curve = self.folder / "my_curve.csv"
        curves = [curve]
        for i in range(3):
            other = self.folder / f"curve_{i}.csv"
            lines = curve.read_text().splitlines()
            other.write_text("\n".join(lines[:1] + [f"{line}{i + 1}" for line in lines[1:]]) + "\n")
            curves.append(other)
        results = set()
        for threads in ("1", "2", "7"):
            run = subprocess.run([nve, "fit", *curves, "--scene", "flat_polystyrene", "-o", self.folder / "f.toml", "--force",
                                  "--threads", threads, "--table", self.folder / "table.csv"],
                                 capture_output=True, text=True, timeout=240, check=True)
            results.add(run.stdout + (self.folder / "table.csv").read_text() + (self.folder / "f.toml").read_text())
        self.assertEqual(len(results), 1)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
