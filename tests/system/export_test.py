#!/usr/bin/env python3
"""`telenano-master export` of a recorded session against what h5py reads from the same file.

export_test.py NVE MASTER
"""
import csv
import io
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

import h5py

NVE, MASTER = sys.argv[1:3]


def run(*words, expect=0):
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, timeout=120)
    assert done.returncode == expect, (words, done.returncode, done.stderr)
    return done


class Export(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="telenano_export_"))
        cls.file = cls.folder / "a.h5"
        server = subprocess.Popen([NVE, "serve", "--scene", "flat_silicon_oxide", "--listen", "127.0.0.1:0"], stderr=subprocess.PIPE, text=True)
        try:
            address = server.stderr.readline().split(" on ")[1].split()[0].rstrip(",")
            run(MASTER, "run", "--server", address, "--task", "indent", "--duration-s", "4", "--rate", "500", "--quiet", "--record", cls.file)
        finally:
            server.terminate()
            server.communicate()
        cls.h5 = h5py.File(cls.file, "r")

    @classmethod
    def tearDownClass(cls):
        cls.h5.close()
        shutil.rmtree(cls.folder)

    def table(self, *words):
        return list(csv.DictReader(io.StringIO(run(MASTER, "export", self.file, *words).stdout)))

    def columns(self):
        """Without the links that lead from former names to columns."""
        samples = self.h5["samples"]
        return {name: data for name, data in samples.items() if isinstance(samples.get(name, getlink=True), h5py.HardLink)}

    def test_every_sample_bit_by_bit(self):
        rows = self.table()
        samples = self.columns()
        self.assertEqual(len(rows), len(samples["tick"]))
        columns = 0
        for name, data in samples.items():
            values = data[:]
            for i in range(values.shape[1] if values.ndim == 2 else 1):
                key = name + ("_" + "xyz"[i] if values.ndim == 2 else "")
                expected = values[:, i] if values.ndim == 2 else values
                got = [type(e.item())(row[key]) for e, row in zip(expected, rows)]
                self.assertTrue(all(g == e or (g != g and e != e) for g, e in zip(got, expected)), key)
                columns += 1
        self.assertEqual(columns, len(rows[0]))

    def test_chosen_columns_times_and_rows(self):
        rows = self.table("--columns", "force_w_nn,time_s", "--from-s", "1", "--to-s", "2", "--every", "10")
        self.assertEqual(list(rows[0]), ["force_w_nn_x", "force_w_nn_y", "force_w_nn_z", "time_s"])
        times = [t for t in self.h5["samples/time_s"][:] if 1 <= t <= 2][::10]
        self.assertEqual([float(r["time_s"]) for r in rows], times)

    def test_curves_are_the_samples_of_a_way_down_and_a_way_up(self):
        rows = self.table("--what", "curves")
        self.assertEqual({r["way"] for r in rows}, {"approach", "retract"})
        surface = float(self.h5["configuration"].attrs["surface_z_w_nm"])
        samples = {t: (f[2], z[2] - surface) for t, f, z in zip(*(self.h5["samples/" + n][:] for n in ("time_s", "force_w_nn", "tip_pos_w_nm")))}
        times = sorted(samples)
        for row in rows:
            nearest = min(times, key=lambda t: abs(t - float(row["time_s"])))
            force, height = samples[nearest]
            self.assertAlmostEqual(float(row["force_nn"]), force, delta=1e-12 * max(1, abs(force)))
            self.assertAlmostEqual(float(row["tip_height_nm"]), height, delta=1e-12 * max(1, abs(height)))
        for segment in {r["segment"] for r in rows}:
            heights = [float(r["target_height_nm"]) for r in rows if r["segment"] == segment]
            down = next(r["way"] for r in rows if r["segment"] == segment) == "approach"
            self.assertEqual(heights[0] > heights[-1], down)
        deepest = max(float(r["force_nn"]) for r in rows)
        self.assertGreater(deepest, 10)  # it has been pressed

    def test_events_columns_configuration(self):
        events = self.table("--what", "events")
        self.assertEqual([int(e["tick"]) for e in events], [int(e["tick"]) for e in self.h5["events"]])
        columns = self.table("--what", "columns")
        self.assertEqual({c["column"]: c["unit"] for c in columns},
                         {n: d.attrs["unit"].decode() if isinstance(d.attrs["unit"], bytes) else d.attrs["unit"] for n, d in self.columns().items()})
        keys = {row["key"] for row in self.table("--what", "configuration")}
        self.assertEqual(keys, set(self.h5["configuration"].attrs))

    def test_what_is_wrong_is_told_in_one_line(self):
        for words, part in ((["--columns", "time"], "has no column 'time'; it has:"), (["--from-s", "2", "--to-s", "1"], "later than"),
                            (["--what", "curves", "--columns", "time_s"], "works only with"), (["--every", "0"], "--every")):
            done = run(MASTER, "export", self.file, *words, expect=2)
            self.assertIn(part, done.stderr)
            self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        run(MASTER, "export", self.folder / "none.h5", expect=2)

    def test_a_full_disk_is_a_failure(self):
        if not os.path.exists("/dev/full"):
            self.skipTest("no /dev/full")
        with open("/dev/full", "w") as full:
            done = subprocess.run([MASTER, "export", self.file], stdout=full, stderr=subprocess.PIPE, text=True)
        self.assertEqual(done.returncode, 1)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
