#!/usr/bin/env python3
"""A lever's stiffness measured for `fit`: by the thermal motion of a lever that is moved here, and on a reference; what its error
does to the intervals; wrong flags.

python3 tests/system/fit_lever_test.py SOURCE_DIR TELENANO_NVE
"""
import csv
import math
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

source, nve = (pathlib.Path(argument) for argument in sys.argv[1:3])
K = 40.0  # N/m, of the scene flat_polystyrene


def thermal_motion(stiffness, frequency, quality, points, step, seed):
    """m x'' + c x' + k x = noise of 4 k_B T c, leap-frog with exact friction, ten steps a point: nm."""
    bath = 1.380649e-5 * 295.15
    w = 2 * math.pi * frequency
    mass = stiffness / w**2
    noise = random.Random(seed)
    fine = step / 10
    keep = math.exp(-w / quality * fine)
    kick = math.sqrt(bath / mass * (1 - keep * keep))
    x, v = noise.gauss(0, math.sqrt(bath / stiffness)), noise.gauss(0, math.sqrt(bath / mass))
    series = []
    for i in range(10 * points):
        v -= 0.5 * fine * w * w * x
        x += 0.5 * fine * v
        v = keep * v + kick * noise.gauss(0, 1)
        x += 0.5 * fine * v
        v -= 0.5 * fine * w * w * x
        if i % 10 == 0:
            series.append(x)
    return series


class Lever(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="telenano-lever-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        made = subprocess.run([nve, "curve", "--scene", "flat_polystyrene", "--from-nm", "30", "--to-nm", "-12", "--step-nm", "0.1"],
                              capture_output=True, text=True, check=True)
        noise = random.Random(3)
        with open(cls.folder / "curve.csv", "w", newline="") as out:
            out.write("direction,z_nm,deflection_nm\n")
            for row in csv.DictReader(made.stdout.splitlines()):
                out.write("%s,%s,%.6f\n" % (row["direction"], row["base_z_nm"], float(row["deflection_nm"]) + noise.gauss(0, 0.01)))

    def fit(self, *more, code=0, scene="flat_polystyrene"):
        run = subprocess.run([nve, "fit", self.folder / "curve.csv", "--scene", scene, "-o", self.folder / "fitted.toml", "--force",
                              *map(str, more)], capture_output=True, text=True, timeout=120)
        self.assertEqual(run.returncode, code, run.stderr)
        if code:
            self.assertEqual(len(run.stderr.splitlines()), 1, run.stderr)
            return run.stderr
        return run.stdout

    @staticmethod
    def lever(said):
        found = re.search(r"lever +([^ ]+) N/m along z, standard deviation ([^ ]+) %", said)
        return float(found[1]), 0.01 * float(found[2])

    @staticmethod
    def interval(said, name):
        low, high = re.search(rf"^{name} +[^ ]+ \S+ +(\S+) to (\S+)", said, re.M).groups()
        return float(low), float(high)

    def test_thermal_motion(self):
        step = 1 / 2e6
        series = thermal_motion(K, 150e3, 30, 20000, step, 1)
        path = self.folder / "thermal.csv"
        path.write_text("time_us,deflection_pm\n" + "".join("%.3f,%.5g\n" % (1e6 * step * i, 1e3 * x + 5) for i, x in enumerate(series)))
        said = self.fit("--thermal", path, "--thermal-lever", "displacement")
        stiffness, error = self.lever(said)
        # The motion made here is one mode with all of k_B T, of which the program takes 0.971 to be seen.
        self.assertLess(abs(math.log(stiffness / 0.971 / K)), 4 * error)
        self.assertLess(error, 0.1)
        written = float(re.search(r"stiffness_n_m = ([^ ]+)   # fitted", (self.folder / "fitted.toml").read_text())[1])
        self.assertAlmostEqual(written / stiffness, 1, delta=1e-3)
        rectangular, _ = self.lever(self.fit("--thermal", path))
        self.assertAlmostEqual(rectangular / stiffness, 0.817 / 0.971, delta=1e-3)
        # k, E and w scale together, so an error of k is in the intervals of both.
        low, high = self.interval(said, "w")
        self.assertGreater(math.log(high / low), 2 * 1.96 * error * 0.99)
        # In volts, with a sensitivity.
        path.write_text("time_s,deflection_v\n" + "".join("%.8f,%.7g\n" % (step * i, x / 35.0) for i, x in enumerate(series)))
        self.assertIn("--invols-nm-v", self.fit("--thermal", path, code=2))

    def test_swapped_columns(self):
        with open(self.folder / "curve.csv", newline="") as made, open(self.folder / "swapped.csv", "w") as out:
            out.write("direction,z_nm,force_nn\n")
            for row in csv.DictReader(made):
                out.write("%s,%.6f,%.6f\n" % (row["direction"], K * float(row["deflection_nm"]), float(row["z_nm"])))
        run = subprocess.run([nve, "fit", self.folder / "swapped.csv", "--scene", "flat_polystyrene", "-o", self.folder / "no.toml"],
                             capture_output=True, text=True, timeout=120)
        self.assertIn("are the two columns swapped? --z-column", run.stdout if run.returncode == 0 else run.stderr)
        self.assertNotIn("swapped", self.fit())

    def test_reference(self):
        # On a spring of 20 N/m the deflection is 20/(40 + 20) of the base's way.
        noise = random.Random(4)
        rows = ["direction,z_nm,deflection_nm"]
        for i in range(800):
            z = 300 - i if i < 400 else i - 500
            rows.append("%s,%g,%.5f" % ("approach" if i < 400 else "retract", z, max(0, -z) / 3 + noise.gauss(0, 0.05)))
        path = self.folder / "reference.csv"
        path.write_text("\n".join(rows) + "\n")
        stiffness, error = self.lever(self.fit("--reference-curve", path, "--reference-stiffness-n-m", 20))
        self.assertAlmostEqual(stiffness / K, 1, delta=max(4 * error, 2e-4))  # four digits are printed
        self.assertLess(error, 0.01)
        soft, _ = self.lever(self.fit("--reference-curve", path, "--reference-stiffness-n-m", 10))
        self.assertAlmostEqual(soft / stiffness, 0.5, delta=1e-3)

    def test_error_goes_into_the_intervals(self):
        plain, wide = (self.fit("--stiffness-n-m", K, "--stiffness-error-percent", p) for p in (0, 10))
        for name in ("E", "w"):
            narrow_low, narrow_high = self.interval(plain, name)
            low, high = self.interval(wide, name)
            self.assertLess(low, narrow_low)
            self.assertGreater(high, narrow_high)
            # w goes as k: 1.96 times 10 % each way, and a little of its own.
            if name == "w":
                self.assertAlmostEqual(math.log(high / low), 2 * 0.196, delta=0.02)

    def test_one_line_for_what_does_not_go(self):
        flat = self.folder / "flat.csv"
        flat.write_text("frequency_hz,psd_nm2_hz\n" + "".join("%d,1\n" % (10 * i + 10) for i in range(200)))
        rigid = self.folder / "rigid.toml"
        rigid.write_text(re.sub(r"stiffness_n_m = 40.0.*", "rigid = true", (source / "deploy/scenes/flat_polystyrene.toml").read_text(), count=1))
        for flags, words in (
                (["--thermal", flat], "no resonance"),
                (["--thermal", self.folder / "none.csv"], "no such file"),
                (["--thermal", flat, "--thermal-band-hz", "9"], "LOW:HIGH"),
                (["--thermal", flat, "--stiffness-n-m", "1"], "excludes"),
                (["--thermal", flat, "--temperature-c", "-300"], "--temperature-c"),
                (["--thermal-band-hz", "1:2"], "needs --thermal"),
                (["--reference-curve", self.folder / "curve.csv"], "--reference-stiffness-n-m"),
                (["--reference-stiffness-n-m", "3"], "--reference-curve"),
                (["--reference-curve", flat, "--reference-stiffness-n-m", "3"], "no column"),
                (["--stiffness-error-percent", "-1"], "0 to 100"),
                (["--hamaker-aj", "-1"], "--hamaker-aj"),
                (["--also", "H", "--also", "z0"], "choose one"),
                (["--hamaker-aj", "0.1", "--also", "z0"], "choose one")):
            self.assertIn(words, self.fit(*flags, code=2), flags)
        self.assertIn("rigid", self.fit("--reference-curve", self.folder / "curve.csv", "--reference-stiffness-n-m", "3", code=2, scene=rigid))

    def test_real_curves_say_why_they_are_not_fitted(self):
        """What nve_server/fit/README.md and the evidence say of the two real curves."""
        curves = source / "tests/data/curves"
        scene = self.folder / "jpk.toml"
        text = (source / "deploy/scenes/flat_polystyrene.toml").read_text()
        scene.write_text(re.sub(r"^poisson_ratio = 0.4.*", "poisson_ratio = 0.25", text, count=1, flags=re.M))

        def said_of(*more):
            run = subprocess.run([nve, "fit", *map(str, more), "-o", self.folder / "f.toml", "--force"],
                                 capture_output=True, text=True, timeout=120, check=True)
            return run.stdout, float(re.search(r"ratio ([^)]+)\)", run.stdout)[1])

        # Maugis-Dugdale, R = 50 nm, Poisson's ratio 0.25, the whole range.
        said, ratio = said_of(curves / "soft_sample.jpk-force", "--scene", scene, "--radius-nm", 50, "--stiffness-n-m", 0.043493666)
        self.assertAlmostEqual(float(re.search(r"^E +([^ ]+) GPa", said, re.M)[1]), 261e-6, delta=1e-6)
        self.assertAlmostEqual(ratio, 2.4, delta=0.1)
        self.assertIn("the model or the calibration misses something", said)
        sin = (curves / "silicon_nitride.ibw", "--scene", "flat_polystyrene", "--radius-nm", 10, "--stiffness-n-m", 1.1841)
        said, ratio = said_of(*sin)
        self.assertAlmostEqual(ratio, 14.5, delta=0.5)
        self.assertIn("14.5 times the free part's noise", said)
        # No smooth law does better: polynomials of the same degree by other hands (Gram and Schmidt, in this file) say the same.
        floor = float(re.search(r"degree 8 through each direction leaves ([^ ]+) times", said)[1])
        self.assertAlmostEqual(floor, 5.44, delta=0.1)
        self.assertAlmostEqual(self.polynomial_floor(*sin), floor, delta=0.15 * floor)
        said, ratio = said_of(*sin, "--invols-nm-v", "stiff")
        self.assertTrue(4.5 < ratio < 7.5, said)
        self.assertRegex(said, r"1 % of InvOLS changes E by 6[0-9]")

    def polynomial_floor(self, *flags):
        """What polynomials of degree 8 through the contact of both ways leave, over the noise that `fit` says."""
        run = subprocess.run([nve, "fit", *map(str, flags), "-o", self.folder / "f.toml", "--force", "--residuals", self.folder / "r.csv"],
                             capture_output=True, text=True, timeout=120, check=True)
        noise = float(re.search(r"free part's noise ([^ ]+) nm", run.stdout)[1])
        squares, freedom = 0.0, 0
        with open(self.folder / "r.csv") as file:
            rows = list(csv.DictReader(file))
        for way in ("approach", "retract"):
            z, d = zip(*((float(row["z_nm"]), float(row["deflection_nm"])) for row in rows if row["direction"] == way))
            # In contact: after the lowest point of the approach, before that of the retract.
            lowest = min(range(len(d)), key=lambda i: d[i])
            part = slice(lowest + 2, None) if way == "approach" else slice(0, lowest)
            z, d = z[part], d[part]
            middle, half = (max(z) + min(z)) / 2, (max(z) - min(z)) / 2
            basis = []
            for power in range(9):
                column = [((at - middle) / half) ** power for at in z]
                for _ in range(2):
                    for other in basis:
                        share = sum(a * b for a, b in zip(column, other))
                        column = [a - share * b for a, b in zip(column, other)]
                length = math.sqrt(sum(a * a for a in column))
                basis.append([a / length for a in column])
            left = list(d)
            for other in basis:
                share = sum(a * b for a, b in zip(left, other))
                left = [a - share * b for a, b in zip(left, other)]
            squares += sum(a * a for a in left)
            freedom += len(d) - 9
        return math.sqrt(squares / freedom) / noise

    def test_hamaker_constant_of_its_own(self):
        text = (source / "deploy/scenes/flat_polystyrene.toml").read_text()
        scene = self.folder / "h.toml"
        held = text + "\n[contact]\n"
        scene.write_text(held + "hamaker_aj = 0.2\n")
        self.assertIn("Hamaker constant 12 pi z0^2 w = 0.2 aJ", self.fit(scene=scene))
        self.assertIn("hamaker_aj = 0.2\n", (self.folder / "fitted.toml").read_text())
        said = self.fit("--also", "H")
        low, high = self.interval(said, "H")
        # The scene's own: z0 = 0.165 nm, w = 2 sqrt(0.066 0.2).
        true = 12 * math.pi * 0.165**2 * 2 * math.sqrt(0.066 * 0.2)
        self.assertTrue(low < true * 1.05 and high > true * 0.95, said)
        self.assertRegex((self.folder / "fitted.toml").read_text(), r"hamaker_aj = \S+   # fitted")
        subprocess.run([nve, "check", "--scene", self.folder / "fitted.toml"], check=True, capture_output=True)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
