#!/usr/bin/env python3
"""Writes force curves in formats of which there is no real file with a known content: NanoScope's by hand, HDF5 by h5py.
Written without a look at the reader. The numbers follow a rule, so that a test can say what must be read.

python3 tests/data/curves/make_curves.py FOLDER
"""
import pathlib
import struct
import sys


def hdf5(path, curves, **options):
    """curves: lists of (approach z, approach force, retract z, retract force) in m and N, with attributes."""
    import h5py
    import numpy

    with h5py.File(path, "w") as file:
        file.attrs["software"] = "afmformats"
        file.attrs["software version"] = "0.18.0"
        for number, (z_in, f_in, z_out, f_out, attributes) in enumerate(curves):
            group = file.create_group(str(number))
            group.attrs["imaging mode"] = "force-distance"
            group.attrs["enum"] = number
            for name, value in attributes.items():
                group.attrs[name] = value
            columns = {"force": ("N", f_in + f_out), "height (measured)": ("m", z_in + z_out),
                       "time": ("s", [0.001 * i for i in range(len(z_in) + len(z_out))])}
            for name, (unit, values) in columns.items():
                column = group.create_dataset(name, data=numpy.array(values, dtype=options.get("dtype", "<f8")), **options.get("how", {}))
                column.attrs["unit"] = numpy.bytes_(unit) if options.get("fixed") else unit
            if options.get("segment", True):
                data = numpy.array([0] * len(z_in) + [1] * len(z_out), dtype="u1")
                group.create_dataset("segment", data=data, **options.get("how", {})).attrs["unit"] = ""


def nanoscope(path, version, approach_v, retract_v, *, volts_lsb, sensitivity, spring, width=2, used=2, ramp=None, sensor=None,
              missing=0, names=("DeflectionError", "Deflection Error", "DeflSens"), spring_key="Spring Constant", size=8192):
    """approach_v, retract_v: volts in order of time. ramp: (volts, nm/V). sensor: (approach nm, retract nm, V/LSB, nm/V).
    missing: points at the far end of the approach that were not measured. size: of the text."""
    points = len(approach_v)
    kind = {2: "h", 4: "i"}[width]
    lowest = -(1 << (8 * width - 1))

    def half(values):
        return struct.pack("<%d%s" % (points, kind), *(lowest if v is None else round(v) for v in values))

    # A channel begins with the approach from contact outwards, then the retract from contact outwards.
    def channel(in_time, out_time, per_lsb):
        inward = [None if i < missing else v / per_lsb for i, v in enumerate(in_time)]
        return half(inward[::-1]) + half([v / per_lsb for v in out_time])

    channels = [(names, channel(approach_v, retract_v, volts_lsb), volts_lsb)]
    if sensor:
        near, far, per_lsb, nm_v = sensor
        channels.append((("ZSensor", "Height Sensor", "ZsensSens"), channel([z / nm_v for z in near], [z / nm_v for z in far], per_lsb), per_lsb))
    lines = ["\\*Force file list", "\\Version: " + version, "\\Date: 04:42:34 PM Tue Sep 11 2007", "\\Start context: FOL2", "\\Data length: 40960",
             "\\*Equipment list", "\\Description: made by hand", "\\*Scanner list"]
    if ramp:
        lines.append("\\@Sens. Zsens: V %g nm/V" % ramp[1])
    lines += ["\\*Ciao scan list", "\\@Sens. %s: V %g nm/V" % (names[2], sensitivity)]
    if sensor:
        lines.append("\\@Sens. ZsensSens: V %g nm/V" % sensor[3])
    lines += ["\\*Ciao force list", "\\Samps/line: %d" % points]
    if ramp:
        lines.append("\\@4:Ramp size Zsweep: V [Sens. Zsens] (0.006713765 V/LSB) %.9g V" % ramp[0])
    offset = size
    for (name, label, soft), data, per_lsb in channels:
        lines += ["\\*Ciao force image list", "\\Data offset: %d" % offset, "\\Data length: %d" % len(data), "\\Bytes/pixel: %d" % used,
                  "\\Samps/line: %d %d" % (points, points if version >= "0x094" else points - missing), "\\%s: %g" % (spring_key, spring),
                  "\\@4:Image Data: S [%s] \"%s\"" % (name, label), "\\@Z magnify: C [4:Z scale] 1.000000",
                  "\\@4:Z scale: V [Sens. %s] (%.12g V/LSB) %g V" % (soft, per_lsb, per_lsb * 65536),
                  "\\@4:Z Display: V [Sens. %s] (%.12g V/LSB) 1 V" % (soft, per_lsb)]
        offset += len(data)
    head = "\r\n".join(lines + ["\\*File list end", ""]).encode("latin-1") + b"\x1a"
    assert len(head) <= size
    pathlib.Path(path).write_bytes(head.ljust(size, b"\0") + b"".join(data for _, data, _ in channels))


def main(folder):
    n = 120
    z_in = [3e-6 - 1e-9 * i for i in range(n)]
    z_out = [z_in[-1] + 2e-9 * (i + 1) for i in range(n // 2)]
    f_in = [1e-12 * i * i for i in range(n)]
    f_out = [-1e-11 * i for i in range(n // 2)]
    lever = {"spring constant": 0.05, "sensitivity": 8e-8}
    both = [(z_in, f_in, z_out, f_out, lever), (z_in, [2 * f for f in f_in], z_out, f_out, {})]
    hdf5(folder / "made_packed.h5", both, how={"chunks": (50,), "compression": "gzip", "shuffle": True, "fletcher32": True})
    hdf5(folder / "made_plain.h5", both[:1], dtype=">f4", segment=False)
    hdf5(folder / "made_many.h5", [(z_in[:24], [(k + 1) * f for f in f_in[:24]], z_out[:24], f_out[:24], {}) for k in range(12)], segment=False, fixed=True)
    # 100 points a way; the approach's first 12 were not measured.
    push = [max(0, i - 60) * 0.01 for i in range(100)]
    pull = push[::-1][:70] + [-0.05] * 10 + [0.0] * 20
    nanoscope(folder / "made_5.000", "0x05120130", push, pull, volts_lsb=0.000375, sensitivity=51.25, spring=0.06, ramp=(12.5, 20.0), missing=12,
              names=("Deflection", "Deflection", "Deflection"), spring_key="Spring constant")
    near = [500.0 - 2 * i for i in range(100)]
    far = [near[-1] + 2.5 * i for i in range(100)]
    nanoscope(folder / "made_9.spm", "0x09400202", push, pull, volts_lsb=5.722e-9, sensitivity=30.5, spring=40.0, width=4,
              sensor=(near, far, 1e-9, 350.0))


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
