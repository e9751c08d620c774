#!/usr/bin/env python3
"""`fit` prints no wrong number: one Hertzian curve of known modulus in closed form, written in all the ways that could be read as
something else. Each is refused in one line, or the modulus is right.

python3 tests/system/fit_cases_test.py SOURCE_DIR TELENANO_NVE
"""
import concurrent.futures
import math
import pathlib
import random
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

source, nve = (pathlib.Path(argument) for argument in sys.argv[1:3])
E, RADIUS, K = 0.5, 20.0, 1.0  # GPa, nm, N/m
POINTS = 600
SENSITIVITY = 50.0  # nm/V
READ, REFUSED, EITHER, HONEST = "read", "refused", "either", "honest"


def hertz_nn(overlap_nm):
    modulus = 1 / ((1 - 0.3**2) / E + (1 - 0.27**2) / 1000.0)
    return 4 / 3 * modulus * math.sqrt(RADIUS) * max(overlap_nm, 0.0) ** 1.5


def deflection_nm(z_nm, stiffness=K):
    """Base at z over touch: z + overlap + F/k = 0."""
    if z_nm >= 0:
        return 0.0
    low, high = 0.0, -z_nm
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if middle + hertz_nn(middle) / stiffness < -z_nm else (low, middle)
    return hertz_nn(low) / stiffness


def line(first, last, points):
    return [first + (last - first) * i / (points - 1) for i in range(points)]


def bent(z, seed=1, noise=0.05):
    normal = random.Random(seed)
    return [deflection_nm(at) + normal.gauss(0, noise) for at in z]


Z_IN, Z_OUT = line(300, -60, POINTS), line(-60, 300, POINTS)
D_IN, D_OUT = bent(Z_IN, 1), bent(Z_OUT, 2)
Z, D = Z_IN + Z_OUT, D_IN + D_OUT


def table(z=Z, d=D, names=("z_nm", "deflection_nm"), by=",", per=(1, 1), before="", more=(), point=".", end="\n", form="%.9g"):
    rows = [by.join(names)]
    for row in zip([a / per[0] for a in z], [b / per[1] for b in d], *more):
        rows.append(by.join(v if isinstance(v, str) else (form % v).replace(".", point) for v in row))
    return before + end.join(rows) + end


def pairs(names, per_v=1.0, out_per=(1, 1), before="", rows_back=False):
    rows = [",".join(names)]
    for a, b, c, e in zip(Z_IN, D_IN, Z_OUT[::-1] if rows_back else Z_OUT, D_OUT[::-1] if rows_back else D_OUT):
        rows.append("%.9g,%.9g,%.9g,%.9g" % (a, b / per_v, c / out_per[0], e / per_v / out_per[1]))
    return before + "\n".join(rows) + "\n"


def moved(*legs):
    """Through these heights: (first, last, points)."""
    return [at for leg in legs for at in line(*leg)]


def motion(*legs, name="z_nm"):
    z = moved(*legs)
    return table(z, bent(z), (name, "deflection_nm"))


def dwell(points, relaxed=0.1, before=Z_IN, after=Z_OUT, at=-60.0, creep=0.0):
    """Stands between two parts, while the deflection relaxes."""
    z = [at - creep * i / max(points, 1) for i in range(points)]
    d = [deflection_nm(at) * (1 - relaxed * (1 - math.exp(-i / max(points / 4, 1)))) + random.Random(i).gauss(0, 0.05) for i in range(points)]
    return table(before + z + after, bent(before, 1) + d + bent(after, 2))


def clipped(part, noise=0.0, sign=1, d=D):
    """A detector that stops at where this part of the contact begins."""
    limit = deflection_nm(-60 * (1 - part))
    normal = random.Random(9)
    return table(Z, [sign * (min(v, limit) + (normal.gauss(0, noise) if v > limit else 0)) for v in d])


def igor(z, d, note, labels=("Raw", "Defl", "ZSnsr"), names_at=None):
    columns = names_at or (z, d, z)
    data = b"".join(struct.pack("<%df" % len(z), *(1e-9 * v for v in column)) for column in columns)
    note = note.encode("latin-1")
    label = b"".join(name.encode().ljust(32, b"\0") for name in ("", *labels))
    head = bytearray(384)
    struct.pack_into("<h", head, 0, 5)
    struct.pack_into("<i", head, 12, len(note))
    struct.pack_into("<i", head, 40, len(label))
    struct.pack_into("<h", head, 80, 2)
    struct.pack_into("<iii", head, 132, len(z), len(columns), 0)
    return bytes(head) + data + note + label


def all_cases():
    """name, content, flags, what must be."""
    yield "plain.csv", table(), [], READ
    # Units. The names of z; deflection and force in the same spelling.
    for micro in ("µ", "μ", "u"):
        for form in ("z (%sm)", "Z [%sm]", "z_%sm", "height %sm"):
            name = form % micro
            yield f"micro {name}.csv", table(names=(name, name.replace("z", "Deflection ").replace("Z", "Deflection").replace("height", "deflection")),
                                             per=(1e3, 1e3)), [], READ
    yield "micro latin-1.csv", table(names=("Z (µm)", "Deflection (µm)"), per=(1e3, 1e3)).encode("latin-1"), [], READ
    yield "micro force.csv", table(names=("Z (µm)", "Force (µN)"), per=(1e3, 1e3)), [], READ
    yield "micro force latin-1.csv", table(names=("Z (µm)", "Force (µN)"), per=(1e3, 1e3)).encode("latin-1"), [], READ
    for unit, factor in (("m", 1e9), ("nm", 1), ("pm", 1e-3), ("um", 1e3)):
        for form in ("z (%s)", "z[%s]", "z_%s", "height / %s", "Height (measured) [%s]"):
            name = form % unit
            yield f"unit {name}.csv".replace("/", " per "), table(names=(name, "deflection_nm"), per=(factor, 1)), [], READ
    for unit, factor in (("N", 1e9), ("nN", 1), ("pN", 1e-3), ("uN", 1e3)):
        yield f"force {unit}.csv", table(names=("z_nm", f"Force ({unit})"), per=(1, factor)), [], READ
    for unit, factor in (("V", SENSITIVITY), ("mV", SENSITIVITY / 1e3)):
        for form in ("Deflection (%s)", "deflection_%s", "Deflection [%s]"):
            text = table(names=("z_nm", form % unit), per=(1, factor))
            yield f"volts {form % unit}.csv", text, [], REFUSED
            yield f"volts {form % unit} given.csv", text, ["--invols-nm-v", str(SENSITIVITY)], READ
    for unit, factor in (("Å", 0.1), ("mm", 1e6), ("cm", 1e7), ("1e-9 m", 1), ("10^-9 m", 1), ("x10 nm", 10), ("fm", 1e-6), ("V", 10), ("æm", 1e3), ("Âµm", 1e3),
                         ("nm/V", 1), ("km", 1e12), ("a.u.", 1), ("nm*10", 10), ("inch", 1), ("", 1)):
        for form in ("z (%s)", "z_%s", "z %s"):
            name = form % unit
            yield f"unknown z {name}.csv".replace("/", " per "), table(names=(name, "deflection_nm"), per=(factor, 1)), [], REFUSED
            yield (f"unknown z {name} named.csv".replace("/", " per "), table(names=(name, "deflection_nm"), per=(factor, 1)), ["--z-column", name], REFUSED)
    for unit in ("nm/V", "m/V", "N/m", "mN", "kV", "nA", "%", "Å", "nm per V", "nm·10"):
        text = table(names=("z_nm", f"Deflection ({unit})"))
        yield f"unknown deflection {unit}.csv".replace("/", " per "), text, [], REFUSED
        yield f"unknown deflection {unit} given.csv".replace("/", " per "), text, ["--invols-nm-v", "50"], REFUSED
    for name in ("deflection nm/V", "deflection_nm_per_V", "deflection 10^-1 nm"):
        yield f"no unit {name}.csv".replace("/", " by "), table(names=("z_nm", name), per=(1, 0.1)), ["--invols-nm-v", "50"], REFUSED
    yield "unit line.csv", table(names=("Z", "Defl"), before="").replace("\n", "\nnm,nm\n", 1), [], READ
    yield "unit line micro.csv", table(names=("Z", "Defl"), per=(1e3, 1)).replace("\n", "\n(µm),(nm)\n", 1), [], READ
    yield "unit line unknown.csv", table(names=("Z", "Defl"), per=(0.1, 1)).replace("\n", "\nÅ,nm\n", 1), [], REFUSED
    yield "unit line named.csv", table(names=("Z", "Defl")).replace("\n", "\nnm,nm\n", 1), ["--z-column", "nm", "--deflection-column", "nm"], REFUSED
    yield "title above.csv", table(before="Sample,A1\n"), [], READ
    # Layouts.
    for by, point, end in ((";", ",", "\n"), ("\t", ",", "\r\n"), ("\t", ".", "\r"), (";", ".", "\n")):
        yield f"layout {ord(by)} {ord(point)} {len(end)}.csv", table(by=by, point=point, end=end), [], READ
    yield "layout bom.csv", b"\xef\xbb\xbf" + table(end="\r\n").encode(), [], READ
    yield "layout decimal and column comma.csv", table(point=","), [], REFUSED
    yield "layout comment.csv", table(before="# a, curve\n# ", names=("z_nm", "deflection_nm")), [], READ
    yield "utf-16.csv", table().encode("utf-16"), [], REFUSED
    # Columns.
    yield "exchanged.csv", table(D, Z), [], REFUSED
    yield "exchanged named.csv", table(), ["--z-column", "deflection_nm", "--deflection-column", "z_nm"], REFUSED
    yield "one column.csv", table(), ["--deflection-column", "z_nm"], REFUSED
    yield "no such column.csv", table(), ["--deflection-column", "deflection"], REFUSED
    yield "lateral.csv", table(names=("z_nm", "Lateral Deflection (nm)", "Vertical Deflection (nm)"), d=bent([9.0] * len(Z), 5), more=(D,)), [], READ
    twice = table(names=("z_nm", "deflection_nm", "deflection_nm"), d=[0.3 * v for v in D], more=(D,))
    yield "twice named.csv", twice, ["--deflection-column", "deflection_nm"], REFUSED
    upside_down = {"z": ([-v for v in Z], D), "deflection": (Z, [-v for v in D]), "both": ([-v for v in Z], [-v for v in D])}
    for name, (z, d) in upside_down.items():
        yield f"upside down {name}.csv", table(z, d), [], READ
    yield "tilted.csv", table(d=[v + 0.02 * z - 3 for z, v in zip(Z, D)]), [], READ
    # A pair for each way.
    tb = ("Extend Z-Sense(nm)", "Extend T-B(V)", "Retract Z-Sense(nm)", "Retract T-B(V)")
    for flags, what in (([], REFUSED), (["--deflection-column", tb[1]], REFUSED), (["--deflection-column", tb[1], "--invols-nm-v", "50"], READ),
                        (["--deflection-column", tb[3], "--invols-nm-v", "50"], READ), (["--deflection-column", "T-B(V)", "--invols-nm-v", "50"], REFUSED),
                        (["--deflection-column", tb[1], "--z-column", tb[0], "--invols-nm-v", "50"], READ),
                        (["--deflection-column", tb[1], "--z-column", tb[2], "--invols-nm-v", "50"], READ),
                        (["--deflection-column", tb[1], "--invols-nm-v", "100"], REFUSED),
                        (["--deflection-column", tb[0], "--invols-nm-v", "50"], REFUSED)):
        yield f"pairs {len(flags)} {flags[1:]}.csv".replace("/", ""), pairs(tb, SENSITIVITY), flags, what
    approach = ("Approach height (nm)", "Approach signal (nm)", "Retract height (nm)", "Retract signal (nm)")
    yield "pairs approach.csv", pairs(approach), ["--deflection-column", approach[1]], READ
    yield "pairs units.csv", pairs(("Extend z_nm", "Extend deflection_nm", "Retract z_um", "Retract deflection_pm"), out_per=(1e3, 1e-3)), [], REFUSED
    yield "pairs units fit.csv", pairs(("Extend height_nm", "Extend deflection_nm", "Retract height_um", "Retract deflection_pm"), out_per=(1e3, 1e-3)), [], READ
    yield "pairs volts and nm.csv", pairs(("Extend height_nm", "Extend deflection_nm", "Retract height_nm", "Retract deflection_v")), ["--invols-nm-v", "50"], REFUSED
    yield "pairs one z.csv", table(Z_IN, D_IN, ("height_nm", "Approach deflection (nm)", "Retract deflection (nm)"), more=(D_OUT[::-1],)), ["--z-column", "height_nm"], REFUSED
    yield "pairs one deflection.csv", pairs(("Extend height_nm", "deflection_nm", "Retract height_nm", "other")), ["--deflection-column", "deflection_nm"], REFUSED
    yield "pairs back.csv", pairs(("Extend height_nm", "Extend deflection_nm", "Retract height_nm", "Retract deflection_nm"), rows_back=True), [], REFUSED
    yield "pairs exchanged.csv", pairs(("Retract height_nm", "Retract deflection_nm", "Extend height_nm", "Extend deflection_nm")), [], REFUSED
    yield "pairs bwd.csv", pairs(("Z (nm)", "Deflection (nm)", "Z [bwd] (nm)", "Deflection [bwd] (nm)"), rows_back=True), [], REFUSED
    jpk = "".join("# segment: %s\n# springConstant: 1.0\n#\n# columns: height vDeflection\n# units: m N\n%s\n" % (
        way, "\n".join("%.9e %.9e" % (1e-9 * a, 1e-9 * b) for a, b in zip(z, d))) for way, z, d in (("extend", Z_IN, D_IN), ("retract", Z_OUT, D_OUT)))
    for flags in ([], ["--z-column", "height", "--deflection-column", "vDeflection"]):
        yield f"jpk {len(flags)}.txt", jpk, flags, REFUSED
        yield f"jpk tabs {len(flags)}.txt", jpk.replace("# columns: ", "# ").replace(" ", "\t"), flags, REFUSED
    # Segments.
    for first, second, what in (("0", "1", READ), ("1", "2", READ), ("2", "3", READ), ("approach", "retract", READ), ("Extend", "Retract", READ), ("1", "-1", READ),
                                ("1", "0", REFUSED), ("retract", "approach", REFUSED), ("trace", "retrace", REFUSED), ("a", "b", REFUSED), ("2", "1", READ)):
        for column in ("segment", "direction", "way"):
            yield f"{column} {first} {second}.csv", table(names=("z_nm", "deflection_nm", column), more=([first] * POINTS + [second] * POINTS,)), [], what
    yield "segments 0 1 written back.csv", table(Z_OUT + Z_IN, D_OUT + D_IN, ("z_nm", "deflection_nm", "segment"), more=(["1"] * POINTS + ["0"] * POINTS,)), [], READ
    three = ["0"] * POINTS + ["1"] * 200 + ["2"] * POINTS
    z = Z_IN + [-60.0] * 200 + Z_OUT
    yield "segments with pause.csv", table(z, D_IN + [48.0 + 0.01 * (i % 7) for i in range(200)] + D_OUT, ("z_nm", "deflection_nm", "segment"), more=(three,)), [], REFUSED
    words = ["approach"] * POINTS + ["pause"] * 200 + ["retract"] * POINTS
    yield "ways with pause.csv", table(z, D_IN + [48.0] * 200 + D_OUT, ("z_nm", "deflection_nm", "way"), more=(words,)), [], REFUSED
    yield "ways twice.csv", table(Z + Z, D + D, ("z_nm", "deflection_nm", "way"), more=((["approach"] * POINTS + ["retract"] * POINTS) * 2,)), [], REFUSED
    # Motions.
    yield "approach only.csv", table(Z_IN, D_IN), [], REFUSED
    yield "retract only.csv", table(Z_OUT, D_OUT), [], REFUSED
    yield "approach and a dwell.csv", table(Z_IN + [-60.0] * 200, D_IN + [50.0 + 0.01 * (i % 5) for i in range(200)]), [], REFUSED
    yield "approach and some.csv", motion((300, -60, POINTS), (-60, -40, 40)), [], REFUSED
    yield "approach and half.csv", motion((300, -60, POINTS), (-60, 20, 130)), [], EITHER
    yield "retract first.csv", table(Z_OUT + Z_IN, D_OUT + D_IN), [], REFUSED
    yield "retract first upside down.csv", table([-v for v in Z_OUT + Z_IN], D_OUT + D_IN), [], REFUSED
    yield "retract first negative.csv", table(Z_OUT + Z_IN, [-v for v in D_OUT + D_IN]), [], REFUSED
    yield "begins in contact.csv", motion((-5, -60, 200), (-60, 300, POINTS)), [], REFUSED
    yield "all in contact.csv", motion((-2, -60, POINTS), (-60, -2, POINTS)), [], REFUSED
    yield "ends in contact.csv", motion((300, -60, POINTS), (-60, -5, 200)), [], REFUSED
    for far in (1, 3, 8, 15, 25, 40, 60, 120):
        yield f"far {far}.csv", motion((far, -60, POINTS), (-60, far, POINTS)), [], EITHER if far < 60 else READ
    yield "three segments.csv", motion((300, -60, POINTS), (-60, 300, POINTS), (300, -60, POINTS)), [], REFUSED
    yield "three segments short.csv", motion((300, -60, POINTS), (-60, 300, POINTS), (300, 200, 170)), [], REFUSED
    yield "two curves.csv", motion((300, -60, POINTS), (-60, 300, POINTS), (300, -60, POINTS), (-60, 300, POINTS)), [], REFUSED
    yield "deeper the second time.csv", motion((300, -40, POINTS), (-40, 300, POINTS), (300, -60, POINTS), (-60, 300, POINTS)), [], REFUSED
    yield "half, back, whole.csv", motion((300, -30, 500), (-30, 30, 100), (30, -60, 150), (-60, 300, POINTS)), [], REFUSED
    yield "begins on the way out.csv", motion((100, 300, 300), (300, -60, POINTS), (-60, 100, 250)), [], REFUSED
    yield "begins in the contact on the way out.csv", motion((-30, 300, 500), (300, -60, POINTS)), [], REFUSED
    for points in (40, 100, 300, 2000):
        yield f"dwell {points}.csv", dwell(points), [], REFUSED
        yield f"dwell {points} half way.csv", dwell(points, before=moved((300, -30, 550)), after=moved((-30, -60, 50), (-60, 300, POINTS)), at=-30.0), [], REFUSED
        yield f"dwell {points} half way back.csv", dwell(points, before=moved((300, -60, POINTS), (-60, -30, 50)), after=moved((-30, 300, 550)), at=-30.0), [], REFUSED
        yield f"dwell {points} free.csv", dwell(points, before=moved((300, 100, 330)), after=moved((100, -60, 270), (-60, 300, POINTS)), at=100.0), [], EITHER
    for points in (10, 20, 30):
        yield f"dwell {points}.csv", dwell(points), [], EITHER
    yield "dwell creeping.csv", dwell(300, creep=4.0, after=moved((-64, 300, POINTS))), [], REFUSED
    noisy = [at + random.Random(i).gauss(0, 0.5) for i, at in enumerate(Z_IN + [-60.0] * 400 + Z_OUT)]
    yield "dwell with noise of z.csv", table(noisy, D_IN + [53.6 * (0.9 + 0.1 * math.exp(-i / 100)) for i in range(400)] + D_OUT), [], REFUSED
    yield "dwell.ibw", igor(Z_IN + [-60.0] * 400 + Z_OUT, D_IN + [53.6 * (0.9 + 0.1 * math.exp(-i / 100)) for i in range(400)] + D_OUT, "SpringConstant: 1\r"), [], REFUSED
    # A detector that clips.
    for part in (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.8):
        for sign in (1, -1):
            yield f"clipped {part} {sign}.csv", clipped(part, sign=sign), [], REFUSED if part > 0.04 else EITHER
            yield f"clipped {part} {sign} noisy.csv", clipped(part, 0.05, sign), [], REFUSED if part > 0.04 else EITHER
        yield f"clipped {part} noisier.csv", clipped(part, 0.2, d=bent(Z_IN, 1, 0.2) + bent(Z_OUT, 2, 0.2)), [], REFUSED if part > 0.08 else EITHER
    yield "clipped volts.csv", table(d=[min(v, 30) for v in D], names=("z_nm", "deflection_v"), per=(1, SENSITIVITY)), ["--invols-nm-v", "50"], REFUSED
    yield "clipped below.csv", table(d=[max(v, 10.0) for v in D]), [], REFUSED
    # What the file says of the lever.
    for key in ("springConstant: %s", "# springConstant: %s", "# Spring Constant: %s N/m", "SpringConstant: %s", "# k: %s", "k = %s N/m", "K: %s", "# K = %s nN/nm",
                "Spring Constant [N/m]: %s", "Spring constant (N/m),%s", "spring_constant_n_m: %s", "k (N/m)\t%s", "Cantilever spring constant: %s N/m", "kc;%s",
                "# force-settings.cantilever.spring-constant: %s", "Stiffness: %s N/m", "# Spring Constant %s N/m"):
        name = re.sub("[^a-zA-Z]", "_", key)
        for value in ("3", "0.333", "1.05"):
            text = table(before=key % value + "\n")
            yield f"lever {name} {value}.csv", text, [], READ if value == "1.05" else REFUSED
        yield f"lever {name} given.csv", table(before=key % 3 + "\n"), ["--stiffness-n-m", "1"], READ
    for key in ("k: %s pN/nm", "Spring Constant (pN/nm): %s", "# spring constant = %s mN/m"):
        name = re.sub("[^a-zA-Z]", "_", key)
        yield f"lever {name} 3000.csv", table(before=key % 3000 + "\n"), [], REFUSED
        yield f"lever {name} 1000.csv", table(before=key % 1000 + "\n"), [], READ
    yield "lever unknown.csv", table(before="Spring Constant: 3000 dyn/cm\n"), [], REFUSED
    yield "lever twice.csv", table(before="k: 1 N/m\nSpring Constant: 3 N/m\n"), [], REFUSED
    yield "lever decimal comma.csv", table(before="k: 3,5 N/m\n", by=";"), [], REFUSED
    yield "no lever.csv", table(before="K: 295 K\nAdjustSpringConstant: 0\nSpringconstant2: 7\nDisplaySpringConstant: 1e-9\n"), [], READ
    yield "lever after.csv", table() + "# Spring Constant: 3 N/m\n", [], REFUSED
    yield "force of another lever.csv", table(names=("z_nm", "force_nn"), per=(1, 1 / 3), before="k: 3 N/m\n"), [], REFUSED
    yield "force of another lever given.csv", table(names=("z_nm", "force_nn"), per=(1, 1 / 3), before="k: 3 N/m\n"), ["--stiffness-n-m", "1"], READ
    for note, what in (("SpringConstant: 1\rInvOLS: 5e-08\r", READ), ("SpringConstant: 3\r", REFUSED), ("SpringConstant: 3 N/m\r", REFUSED), ("InvOLS: 50\r", READ)):
        yield f"{note.split(chr(13))[0].replace('/', ' per ')}.ibw", igor(Z, D, note), [], what
    for invols in ("InvOLS: 1e-07", "InvOLS: 100", "InvOLS: 100 nm/V"):
        yield f"{invols} changed.ibw".replace("/", ""), igor(Z, [2 * v for v in D], invols + "\r"), ["--invols-nm-v", "50"], READ if "1e" in invols else REFUSED
    yield "volts.ibw", igor(Z, D, "", ("Raw", "DeflV", "ZSnsr")), ["--deflection-column", "DeflV"], REFUSED
    yield "amplitude.ibw", igor(Z, D, "", ("Raw", "Amp", "ZSnsr")), ["--deflection-column", "Amp"], REFUSED
    for text in ("InvOLS: 5e-8 m/V", "InvOLS: 50 nm/V", "sensitivity: 5.0E-8", "Deflection sensitivity (nm/V): 50"):
        volts = table(names=("z_nm", "deflection_v"), per=(1, SENSITIVITY), before=text + "\n")
        yield f"{text}.csv".replace("/", ""), volts, [], REFUSED
        yield f"{text} given.csv".replace("/", ""), volts, ["--invols-nm-v", "50"], READ
    # Honest curves.
    yield "noise.csv", table(d=bent(Z_IN, 3, 0.3) + bent(Z_OUT, 4, 0.3)), [], READ
    yield "much noise.csv", table(d=bent(Z_IN, 3, 2.0) + bent(Z_OUT, 4, 2.0)), [], HONEST
    yield "no noise.csv", table(d=[deflection_nm(at) for at in Z]), [], READ
    for bits, span in ((16, 1000), (12, 200), (12, 1000)):
        step = span / 2**bits
        for noise in (0.05, 0.0):
            yield f"adc {bits} {span} {noise}.csv", table(d=[step * round(v / step) for v in bent(Z_IN, 1, noise) + bent(Z_OUT, 2, noise)]), [], READ if noise else HONEST
    slow = moved((300, -60, 6000), (-60, 300, 6000))
    yield "adc slow.csv", table(slow, [0.1 * round(v / 0.1) for v in bent(slow, 1, 0.02)]), [], READ
    yield "quick back.csv", motion((300, -60, 2000), (-60, 300, 150)), [], READ
    yield "slow back.csv", motion((300, -60, 150), (-60, 300, 2000)), [], READ
    yield "short turn.csv", dwell(6, relaxed=0.0), [], READ
    yield "waits far out.csv", motion((300, 300, 300), (300, -60, POINTS), (-60, 300, POINTS), (300, 300, 200)), [], READ
    yield "few points.csv", motion((300, -60, 60), (-60, 300, 60)), [], READ
    sine = [120 + 180 * math.cos(math.pi * i / POINTS) for i in range(2 * POINTS)]
    yield "sine.csv", table(sine, bent(sine)), [], READ
    yield "noise of z.csv", table([at + random.Random(i).gauss(0, 0.3) for i, at in enumerate(Z)], D), [], HONEST
    steps = [0.5 * round(at / 0.5) for at in Z]
    yield "z in steps.csv", table(steps, bent(steps)), [], READ
    hysteresis = Z_IN + [at + 0.03 * 360 * math.sin(math.pi * (at + 60) / 360) for at in Z_OUT]
    yield "hysteresis.csv", table(hysteresis, D), [], HONEST
    wave = [v + 0.5 * math.sin(2 * math.pi * z / 330) for z, v in zip(Z, D)]
    yield "interference.csv", table(d=wave), [], HONEST
    yield "drift.csv", table(d=[v + 3.0 * i / len(D) for i, v in enumerate(D)]), [], HONEST
    pull = [v + (-15 - 0.85 * (z - 0) if 0 < z < 5 else 0) for z, v in zip(Z_OUT, D_OUT)]
    yield "pull-off.csv", table(d=D_IN + pull), [], HONEST
    soft = [0.15 * max(0.0, -z) ** 1.2 for z in Z]
    yield "soft.csv", table(d=[v + random.Random(i).gauss(0, 0.1) for i, v in enumerate(soft)]), [], HONEST


class Cases(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="telenano-cases-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder)

    def wrong(self, number, path, flags, what):
        """What is wrong, or None."""
        out = self.folder / f"{number}.toml"
        run = subprocess.run([nve, "fit", path, "--scene", source / "tests/data/curves/hertz.toml", "-o", out, "--threads", "1", *flags], capture_output=True, timeout=300)
        said, refused = (text.decode("utf-8", "replace") for text in (run.stdout, run.stderr))
        if run.returncode == 0:
            value, low, high = re.search(r"^E +(\S+) GPa +(\S+) to (\S+)", said, re.M).groups()
            low, high = (0 if low == "open" else float(low)), (math.inf if high == "open" else float(high))
            right = low <= E <= high or abs(float(value) / E - 1) < 0.02
            if what == REFUSED or (what != HONEST and not right):
                return f"E = {value} ({low} to {high})"
            return None
        if run.returncode != 2 or said or len(refused.splitlines()) != 1 or out.exists():
            return f"exit {run.returncode}: {said}{refused}"
        if what in (READ, HONEST):
            return refused.strip()
        return None

    def check(self, rows):
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            results = list(pool.map(lambda row: self.wrong(*row[1:]), rows))
        bad = [f"{row[0]} {row[3]}, expected {row[4]}: {result}" for row, result in zip(rows, results) if result]
        self.assertEqual(bad, [], "\n%d of %d:\n" % (len(bad), len(rows)) + "\n".join(bad))

    def test_one_curve_in_all_ways(self):
        rows = []
        for number, (name, content, flags, what) in enumerate(all_cases()):
            path = self.folder / f"{number}{pathlib.Path(name).suffix}"
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
            rows.append((name, number, path, flags, what))
        self.assertGreater(len(rows), 300)
        self.check(rows)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
