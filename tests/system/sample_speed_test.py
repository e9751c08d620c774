#!/usr/bin/env python3
"""How long import and fit take: a .gwy of 1024 x 1024 heights, a curve of 4000 points, and 50 such curves by one and two threads
(same result), from which the time for 1000 is extrapolated. The times are wall times; the least of three counts for single runs.

python3 tests/system/sample_speed_test.py TELENANO_NVE
"""
import csv
import math
import pathlib
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import unittest

nve = pathlib.Path(sys.argv[1])


def gwy(path, side):
    """Gwyddion's native format: a container of named items, here one data field in m over m."""
    def text(value):
        return value.encode() + b"\0"

    def item(name, kind, body):
        return text(name) + kind + body

    def thing(name, items):
        body = b"".join(items)
        return text(name) + struct.pack("<I", len(body)) + body

    unit = thing("GwySIUnit", [item("unitstr", b"s", text("m"))])
    noise = random.Random(1)
    row = [1e-9 * math.sin(0.02 * i) for i in range(side)]
    heights = [h + 1e-10 * noise.gauss(0, 1) + 2e-9 * math.sin(0.03 * j) for j in range(side) for h in row]
    field = thing("GwyDataField", [item("xres", b"i", struct.pack("<i", side)), item("yres", b"i", struct.pack("<i", side)),
                                   item("xreal", b"d", struct.pack("<d", 1e-6)), item("yreal", b"d", struct.pack("<d", 1e-6)),
                                   item("si_unit_xy", b"o", unit), item("si_unit_z", b"o", unit),
                                   item("data", b"D", struct.pack("<I", side * side) + struct.pack("<%dd" % (side * side), *heights))])
    path.write_bytes(b"GWYP" + thing("GwyContainer", [item("/0/data/title", b"s", text("Height")), item("/0/data", b"o", field)]))


class Speed(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="telenano-speed-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder)

    def seconds(self, *command):
        began = time.monotonic()
        run = subprocess.run([nve, *map(str, command)], capture_output=True, text=True)
        took = time.monotonic() - began
        self.assertEqual(run.returncode, 0, run.stderr)
        return took, run.stdout

    def test_import(self):
        gwy(self.folder / "scan.gwy", 1024)
        took = min(self.seconds("import", self.folder / "scan.gwy", "-o", self.folder / f"scene{i}", "--tip-radius-nm", 10)[0] for i in range(3))
        print(f"import of a 1024 x 1024 .gwy: {took:.2f} s (asked: 2)")
        self.assertLessEqual(took, 2)

    def test_fit(self):
        made = subprocess.run([nve, "curve", "--scene", "flat_polystyrene", "--from-nm", "85", "--to-nm", "-15", "--step-nm", "0.05"],
                              capture_output=True, text=True, check=True)
        rows = list(csv.DictReader(made.stdout.splitlines()))
        curves = []
        for k in range(50):
            noise, slow = random.Random(k), 0.0
            lines = ["direction,z_nm,deflection_nm"]
            for row in rows:
                slow = 0.99 * slow + 0.004 * noise.gauss(0, 1)
                lines.append("%s,%s,%.6f" % (row["direction"], row["base_z_nm"], float(row["deflection_nm"]) + noise.gauss(0, 0.02) + slow))
            curves.append(self.folder / f"{k:02}.csv")
            curves[-1].write_text("\n".join(lines) + "\n")

        def fit(*more):
            return self.seconds("fit", *more, "--scene", "flat_polystyrene", "-o", self.folder / "fitted.toml", "--force")

        one = min(fit(curves[0], "--threads", 1)[0] for _ in range(3))
        print(f"fit of a curve of {len(rows)} points: {one:.2f} s (asked: 3)")
        self.assertLessEqual(one, 3)
        said = {}
        for threads in (1, 2):
            took, said[threads] = fit(*curves, "--threads", threads)
            print(f"50 such curves, {threads} thread(s): {took:.1f} s, so 1000 in {took / 3:.1f} min (asked: 20)")
            self.assertLessEqual(took / 3, 20)
        self.assertEqual(said[1], said[2])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
