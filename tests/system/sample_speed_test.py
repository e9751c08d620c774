#!/usr/bin/env python3
"""How long import and fit take: a .gwy of 1024 x 1024 heights, a curve of 4000 points, and 1000 such curves as a map, by two threads
and by one (same bytes). Single runs: the least wall time of three. The map: processor time, which other programs change little.

python3 tests/system/sample_speed_test.py TELENANO_NVE
"""
import csv
import math
import pathlib
import random
import resource
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
        """Of processor time, which other load does not stretch; of the clock; and what it said."""
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        run = subprocess.run([nve, *map(str, command)], capture_output=True, text=True)
        after, took = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic() - began
        self.assertEqual(run.returncode, 0, run.stderr)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, took, run.stdout

    def test_import(self):
        gwy(self.folder / "scan.gwy", 1024)
        cpu, took, _ = min(self.seconds("import", self.folder / "scan.gwy", "-o", self.folder / f"scene{i}", "--tip-radius-nm", 10) for i in range(3))
        print(f"import of a 1024 x 1024 .gwy: {cpu:.2f} s of processor time, {took:.2f} s (asked: 2)")
        self.assertLessEqual(cpu, 2)

    def test_fit(self):
        made = subprocess.run([nve, "curve", "--scene", "flat_polystyrene", "--from-nm", "85", "--to-nm", "-15", "--step-nm", "0.05"],
                              capture_output=True, text=True, check=True)
        rows = list(csv.DictReader(made.stdout.splitlines()))
        curves = []
        for k in range(1000):
            noise, slow = random.Random(k), 0.0
            # Every curve of a stiffness of its own: a deflection that is larger in contact.
            scale = 1 + 0.0001 * (k % 50)
            lines = ["direction,z_nm,deflection_nm"]
            for row in rows:
                slow = 0.99 * slow + 0.004 * noise.gauss(0, 1)
                lines.append("%s,%s,%.6f" % (row["direction"], row["base_z_nm"], scale * float(row["deflection_nm"]) + noise.gauss(0, 0.02) + slow))
            curves.append(self.folder / f"{k:03}.csv")
            curves[-1].write_text("\n".join(lines) + "\n")

        def fit(*more):
            return self.seconds("fit", *more, "--scene", "flat_polystyrene", "-o", self.folder / "fitted.toml", "--force")

        cpu, took, _ = min(fit(curves[0], "--threads", 1) for _ in range(3))
        print(f"fit of a curve of {len(rows)} points: {cpu:.2f} s of processor time, {took:.2f} s (asked: 3)")
        self.assertLessEqual(cpu, 3)
        results = []
        for threads in (2, 1):
            folder = self.folder / f"map{threads}"
            cpu, took, said = fit(*curves, "--threads", threads, "--map", folder, "--map-grid", "50x20", "--map-size-nm", "500x200")
            print(f"1000 such curves, {threads} thread(s): {cpu / 60:.1f} min of processor time, {took / 60:.1f} min (asked: 20)")
            self.assertLessEqual(cpu / 60, 20)
            results.append([(folder / name).read_bytes() for name in ("E.gsf", "w.gsf")])
            results[-1].append([line for line in said.splitlines() if "map of" not in line])
        self.assertEqual(results[0], results[1])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
