#!/usr/bin/env python3
"""The same curve of a known material as a table, as HDF5 of afmformats (by h5py) and as NanoScope files: `fit` finds the same.

python3 tests/system/fit_formats_test.py SOURCE_DIR TELENANO_NVE
"""
import csv
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

source, nve = (pathlib.Path(argument) for argument in sys.argv[1:3])
sys.path.insert(0, str(source / "tests/data/curves"))
import make_curves  # noqa: E402


class Formats(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="telenano-formats-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        made = subprocess.run([nve, "curve", "--scene", "flat_polystyrene", "--from-nm", "30", "--to-nm", "-12", "--step-nm", "0.1"],
                              capture_output=True, text=True, check=True)
        noise = random.Random(3)
        cls.ways = {"approach": ([], []), "retract": ([], [])}
        for row in csv.DictReader(made.stdout.splitlines()):
            z, deflection = cls.ways[row["direction"]]
            z.append(1000 + float(row["base_z_nm"]))
            deflection.append(float(row["deflection_nm"]) + noise.gauss(0.4, 0.01))
        shortest = min(len(z) for z, _ in cls.ways.values())
        (z_in, d_in), (z_out, d_out) = cls.ways["approach"], cls.ways["retract"]
        # As many points in as out, as NanoScope's files have them; what is farthest off goes.
        cls.z_in, cls.d_in = z_in[-shortest:], d_in[-shortest:]
        cls.z_out, cls.d_out = z_out[:shortest], d_out[:shortest]
        lines = ["direction,z_nm,deflection_nm"]
        for way, z, d in (("approach", cls.z_in, cls.d_in), ("retract", cls.z_out, cls.d_out)):
            lines += [f"{way},{a:.9g},{b:.9g}" for a, b in zip(z, d)]
        (cls.folder / "curve.csv").write_text("\n".join(lines) + "\n")
        cls.modulus, cls.work = cls.fit("curve.csv")

    @classmethod
    def fit(cls, name, *more):
        out = cls.folder / "fitted.toml"
        run = subprocess.run([nve, "fit", cls.folder / name, "--scene", "flat_polystyrene", "-o", out, "--force", *more],
                             capture_output=True, text=True, timeout=240)
        assert run.returncode == 0, run.stderr
        text = out.read_text()
        return (float(re.search(r"youngs_modulus_gpa = ([^ ]+)   # fitted", text)[1]),
                float(re.search(r"work_of_adhesion_j_m2 = ([^ ]+)   # fitted", text)[1]))

    def same(self, name, *more):
        modulus, work = self.fit(name, *more)
        # What differs is the rounding to a file's numbers: at most 0.004 nm where the noise is 0.01 nm.
        self.assertAlmostEqual(modulus / self.modulus, 1, delta=0.01, msg=name)
        self.assertAlmostEqual(work / self.work, 1, delta=0.01, msg=name)

    def test_table(self):
        self.assertAlmostEqual(self.modulus / 2.0, 1, delta=0.02)

    def test_hdf5(self):
        k = 40.0
        # Another stiffness in the file than the scene's is refused, unless one is given. What was measured is force over the file's.
        for name, stiffness in (("a.h5", k), ("b.h5", 12.5)):
            make_curves.hdf5(self.folder / name, [([1e-9 * z for z in self.z_in], [1e-9 * stiffness * d for d in self.d_in],
                                                   [1e-9 * z for z in self.z_out], [1e-9 * stiffness * d for d in self.d_out],
                                                   {"spring constant": stiffness, "sensitivity": 5e-8})],
                             how={"chunks": (100,), "compression": "gzip", "shuffle": True, "fletcher32": True})
            if stiffness != k:
                run = subprocess.run([nve, "fit", self.folder / name, "--scene", "flat_polystyrene", "-o", self.folder / "no.toml"],
                                     capture_output=True, text=True, timeout=240)
                self.assertEqual((run.returncode, len(run.stderr.splitlines())), (2, 1), run.stderr)
                self.assertIn("12.5 N/m, and the scene has", run.stderr)
            self.same(name, "--stiffness-n-m", str(k))

    def test_hdf5_with_several_curves(self):
        curve = ([1e-9 * z for z in self.z_in], [1e-9 * 40 * d for d in self.d_in], [1e-9 * z for z in self.z_out],
                 [1e-9 * 40 * d for d in self.d_out], {"spring constant": 40.0})
        flat = curve[:1] + ([0.0] * len(self.d_in),) + curve[2:3] + ([0.0] * len(self.d_out),) + curve[4:]
        make_curves.hdf5(self.folder / "both.h5", [curve, flat])
        run = subprocess.run([nve, "fit", self.folder / "both.h5", "--scene", "flat_polystyrene", "-o", self.folder / "f.toml", "--force"],
                             capture_output=True, text=True, timeout=240)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("both.h5#1: does not move", run.stderr)
        self.assertIn('both.h5#0",2.0', run.stdout)
        self.same("both.h5", "--curve", "0")
        run = subprocess.run([nve, "fit", self.folder / "both.h5", "--scene", "flat_polystyrene", "-o", self.folder / "f.toml", "--force",
                              "--curve", "7"], capture_output=True, text=True, timeout=60)
        self.assertEqual((run.returncode, len(run.stderr.splitlines())), (2, 1), run.stderr)
        self.assertIn("has 2 curves", run.stderr)

    def test_nanoscope(self):
        sensitivity = 20.0
        volts_in, volts_out = ([d / sensitivity for d in way] for way in (self.d_in, self.d_out))
        make_curves.nanoscope(self.folder / "sensor.spm", "0x09400202", volts_in, volts_out, volts_lsb=5.7e-9, sensitivity=sensitivity,
                              spring=40.0, width=4, sensor=(self.z_in, self.z_out, 1e-8, 350.0))
        make_curves.nanoscope(self.folder / "words.001", "0x07200000", volts_in, volts_out, volts_lsb=0.000375, sensitivity=sensitivity,
                              spring=40.0, sensor=([z - 1000 for z in self.z_in], [z - 1000 for z in self.z_out], 1e-5, 350.0))
        self.same("sensor.spm")
        self.same("words.001")
        self.same("sensor.spm", "--invols-nm-v", str(sensitivity))

    def test_nanoscope_with_a_ramp_only(self):
        # A ramp has steps of one size, and both ways have the same heights.
        def at(way, z):
            heights, deflections = way
            order = heights if heights[0] < heights[-1] else heights[::-1]
            values = deflections if heights[0] < heights[-1] else deflections[::-1]
            i = min(range(len(order)), key=lambda k: abs(order[k] - z))
            return values[i]

        step, n = 0.1, 400
        bottom = max(self.z_in[-1], self.z_out[0])
        far = [bottom + step * i for i in range(n)]
        volts_in = [at((self.z_in, self.d_in), z) / 20.0 for z in far[::-1]]
        volts_out = [at((self.z_out, self.d_out), z) / 20.0 for z in far]
        make_curves.nanoscope(self.folder / "ramp.000", "0x05120130", volts_in, volts_out, volts_lsb=0.000375, sensitivity=20.0, spring=40.0,
                              ramp=(n * step / 16.0, 16.0), names=("Deflection", "Deflection", "Deflection"), spring_key="Spring constant")
        self.same("ramp.000")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
