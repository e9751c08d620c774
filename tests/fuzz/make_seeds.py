#!/usr/bin/env python3
"""Writes the seeds that are no files of the project already: scripts for the session and DTLS targets, small scans.

python3 tests/fuzz/make_seeds.py tests/fuzz/seeds
"""
import pathlib
import struct
import sys

out = pathlib.Path(sys.argv[1])


def put(folder, name, data):
    (out / folder).mkdir(parents=True, exist_ok=True)
    (out / folder / name).write_bytes(data)


# fuzz_session.cpp: low nibble of an operation, station by bit 4, address by bits 5 to 7.
TIME, LONG, START, POLL, COMMAND, DELIVER, HEAR, SPOIL, SPOIL_BACK, RAW, EXPIRE, BYE, STOP, TICK = range(14)


def tick(kind=3, z=0xFB, energy=1, station=0, address=0):
    return bytes([TICK | station << 4 | address << 5, kind, z, energy])


opening = tick() * 8
put("session", "ticks", opening * 4)
put("session", "wave", opening + tick(kind=0x4B) * 20)
put("session", "model", opening + tick(kind=0x6B) * 20)
put("session", "replies_left_out", opening + tick(kind=0x83) * 12 + tick(kind=0x83, z=0xE0) * 4 + tick(kind=0xC3, z=5) * 8 + tick() * 2)
put("session", "two_stations", b"".join(tick(station=i % 2, address=i % 2) for i in range(40)))
put("session", "third_finds_it_full", opening + tick(station=1, address=1) * 8 + bytes([START]) + tick(address=3) * 6)
put("session", "silence_and_resume", opening + bytes([LONG, 25, EXPIRE]) + tick() * 12)
put("session", "moves", opening + tick(address=2) * 3 + bytes([LONG, 3]) + tick(address=2) * 8)
put("session", "bye", opening + bytes([BYE, 0, DELIVER, 0]) + tick() * 4)
put("session", "replayed", opening + bytes([DELIVER, 3, DELIVER, 0, DELIVER | 1 << 5, 0, HEAR, 2]) + tick() * 2)
put("session", "changed", opening + bytes([SPOIL, 0, 64, 20, 0, 255, HEAR, 0, SPOIL_BACK, 0, 64, 30, 0, 7]) + tick())
put("session", "shutting_down", opening + bytes([STOP, 255, HEAR, 0]) + tick() * 3)
put("session", "by_hand", bytes([START, POLL, DELIVER, 0, HEAR, 0, POLL, DELIVER, 0, HEAR, 0, COMMAND, 3, 250, 1, DELIVER, 0, HEAR, 0]))

# fuzz_dtls.cpp: low nibble of an operation, the stranger by the high one.
TURN, SAY, FORGE, FORGE_AS, REPLAY, REPLAY_AS, CHANGE, CHANGE_AS, CHANGE_BACK, JOIN, LOSE, AGAIN = 2, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15
shake = bytes([TURN] * 6)
put("dtls", "handshake", shake)
put("dtls", "talk", shake + bytes([SAY, TURN] * 5))
put("dtls", "replayed", shake + bytes([SAY, TURN, SAY, TURN, REPLAY, 1, REPLAY_AS, 1, REPLAY_AS, 3, TURN]))
put("dtls", "changed", shake + bytes([SAY, CHANGE_AS, 0, 64, 20, 0, 9, TURN, CHANGE, 0, 64, 12, 0, 1, SAY, TURN]))
put("dtls", "changed_hello", bytes([CHANGE_AS, 0, 64, 30, 0, 9, TURN, CHANGE, 0, 65, 13, 0, 1, 14, 0, 2]) + shake)
put("dtls", "again", shake + bytes([SAY, TURN, AGAIN]) + shake + bytes([SAY, TURN]))
put("dtls", "silence", shake + bytes([1, 130, TURN, SAY, TURN]) + shake)
put("dtls", "lost", bytes([LOSE, TURN, 0, 255, TURN]) + shake + bytes([SAY, TURN]))
put("dtls", "joined", shake + bytes([SAY, JOIN, 0, 1, JOIN, 1, 0, TURN]))
record = bytes([23, 0xFE, 0xFD, 0, 1]) + bytes(6)
for name, body in (("record", record + struct.pack(">H", 32) + bytes(32)), ("client_hello", bytes([22, 0xFE, 0xFF]) + bytes(8) + struct.pack(">H", 60) + bytes([1, 0, 0, 48]) + bytes(8) + bytes([0xFE, 0xFD]) + bytes(46))):
    put("dtls", name, bytes([FORGE]) + struct.pack("<H", len(body)) + body + bytes([FORGE_AS]) + struct.pack("<H", len(body)) + body + shake)


# fuzz_steps.cpp: a datagram's field of steps (PROTOCOL.md, section 14), and the same bytes as a script.
def steps(first, records, count=None):
    return struct.pack("<QB", first, len(records) if count is None else count) + b"".join(records)


def varint(x):
    out = b""
    while x >= 0x80:
        out, x = out + bytes([x & 0x7F | 0x80]), x >> 7
    return out + bytes([x])


def zigzag(x):
    return varint(x << 1 if x >= 0 else -x * 2 - 1)


def record(flags, target, length, more=0):
    return bytes([flags | more << 5]) + b"".join(zigzag(x) for x in target) + zigzag(length)


first_step = record(3, (16384, -8, 327680), 1_000_000)
put("steps", "one", steps(1, [first_step]))
put("steps", "moving", steps(7, [first_step] + [bytes([3 | 1 << 4]) + zigzag(160) + zigzag(0) + zigzag(-1600)] * 20))
put("steps", "rest", steps(9, [first_step, bytes([3 | 1 << 3 | 1 << 4 | 6 << 5])], 8))
put("steps", "stop", steps(9, [first_step, bytes([4 | 1 << 3 | 1 << 4])]))
put("steps", "count_wrong", steps(9, [first_step], 2))
put("steps", "no_number", steps(0, [first_step]))
put("steps", "far_away", steps(1, [record(3, (2**47, 0, 0), 1_000_000)]))
put("steps", "long", steps(1, [record(3, (0, 0, 0), 200_000_000)]))
put("steps", "cut", steps(1, [first_step])[:-2])
put("steps", "in_order", bytes([0]) + bytes([0x1C, 0, 0x1E, 1, 40]) * 12)
put("steps", "gap_and_skip", bytes([3]) + bytes([0x1C, 9, 0x1E, 1, 200, 3, 0x1E, 0x1C, 0, 0x1E]) * 4)
put("steps", "too_fast", bytes([0]) + bytes([0xFC, 0, 0xFE]) * 20)

# fuzz_snapshot.cpp: which scene, how, and changes of (place, value).
for scene in range(3):
    put("snapshot", "whole_%d" % scene, bytes([scene, 0]))
    put("snapshot", "changed_%d" % scene, bytes([scene, 3 << 2]) + b"".join(struct.pack("<HB", at, 0xFF) for at in (3, 40, 90)))
    put("snapshot", "not_finite_%d" % scene, bytes([scene, 8 << 2]) + b"".join(struct.pack("<HB", 24 + i, b) for i, b in enumerate(b"\0\0\0\0\0\0\xF8\x7F")))
    put("snapshot", "cut_%d" % scene, bytes([scene, 3, 50, 0]))
    put("snapshot", "pieces_%d" % scene, bytes([scene, 2]))
    put("snapshot", "pieces_of_two_%d" % scene, bytes([scene, 2, 0, 160, 0, 210, 255, 255, 255, 255, 1, 0, 0, 0, 9]))
put("snapshot", "anything", bytes([0, 1]) + bytes(range(120)))
put("snapshot", "nothing", bytes([0, 1]))

# .gsf
def gsf(columns, rows, heights, more=""):
    head = ("Gwyddion Simple Field 1.0\nXRes = %d\nYRes = %d\nXReal = 6e-8\nYReal = 6e-8\nXYUnits = m\nZUnits = m\n%s"
            % (columns, rows, more)).encode()
    return head + bytes(4 - len(head) % 4) + struct.pack("<%df" % (columns * rows), *heights)


put("gsf", "two_by_two", gsf(2, 2, [0, 1e-9, 2e-9, 3e-9]))
put("gsf", "titled", gsf(4, 3, [1e-9 * i for i in range(12)], "Title = flakes\nXOffset = 1e-6\n"))
put("gsf", "not_finite", gsf(2, 2, [float("nan"), 0, float("inf"), 0]))
put("gsf", "short", gsf(4, 4, [0.0] * 16)[:-3])
put("gsf", "no_padding", gsf(2, 2, [0, 1, 2, 3]).replace(b"\0", b"x"))


# Force curves: a table, and an Igor wave by WaveMetrics' technical note 3.
def ramp(i, n=60):
    return abs(i - n // 2)


rows = "".join("%d,%g\n" % (ramp(i), max(0, 5 - ramp(i)) + 0.01 * (i * i % 7)) for i in range(60))
put("curve", "table", ("z_nm,deflection_nm\n" + rows).encode())
put("curve", "volts", ("by hand\n# z\nz [um];Deflection [mV]\n" + rows.replace(",", ";")).encode())
put("curve", "ways", ("direction,base_z_nm,force_nn\n" + "".join(
    "%s,%s\n" % ("approach" if i < 30 else "retract", row) for i, row in enumerate(rows.splitlines()))).encode())
put("curve", "not_a_number", ("z_nm,deflection_nm\n" + rows + "nan,inf\n").encode())


def ibw(points, columns, numbers, note=b"", labels=b""):
    head = struct.pack("<hhiiiiiiiiiiiiiiii", 5, 0, 320 + 4 * len(numbers), 0, len(note), 0, 0, 0, 0, 0, 0, len(labels), 0, 0, 0, 0, 0, 0)[:64]
    wave = bytearray(320)
    struct.pack_into("<ih", wave, 12, len(numbers), 2)
    struct.pack_into("<ii", wave, 68, points, columns)
    return head.ljust(64, b"\0") + bytes(wave) + struct.pack("<%df" % len(numbers), *numbers) + note + labels


names = b"".join(name.ljust(32, b"\0") for name in (b"", b"Defl", b"ZSnsr"))
numbers = [1e-9 * max(0, 5 - ramp(i)) for i in range(60)] + [1e-9 * ramp(i) for i in range(60)]
put("curve", "igor", ibw(60, 2, numbers, b"SpringConstant: 0.2\rInvOLS: 4e-08\r", names))
put("curve", "igor_large", ibw(2**31 - 1, 2, numbers, b"", names))
put("curve", "igor_cut", ibw(60, 2, numbers, b"", names)[:-50])
put("curve", "zip_end", b"PK\5\6" + bytes(4) + b"\xff\xff\xff\xff" + bytes(4) + b"\xff\xff\xff\xff" + bytes(2))

# A lever's thermal motion: its spectrum about the peak, and a short series.
peak = "".join("%g,%.4g\n" % (f, 1e-3 / ((f * f / 1e6 - 1) ** 2 + f * f / 1e6 / 900) + 1e-4) for f in range(400, 1700, 13))
put("thermal", "spectrum", ("frequency_hz,psd_pm2_hz\n" + peak).encode())
put("thermal", "spectrum_volts", ("made by hand\nFrequency (kHz);PSD (V^2/Hz)\n" + peak.replace(",", ";")).encode())
put("thermal", "series", ("time_us,deflection_nm\n" + "".join("%d,%d\n" % (i, (i * i * 7919) % 13 - 6) for i in range(1030))).encode())
put("thermal", "steps", ("time_s,deflection_v\n" + "".join("%d,%d\n" % (i * i, i % 5) for i in range(1030))).encode())
put("thermal", "negative", b"frequency_hz,psd_nm2_hz\n1,-1\n2,nan\n")

# HDF5 and NanoScope curves, as tests/data/curves/make_curves.py writes them, of few points.
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "data" / "curves"))
import make_curves  # noqa: E402

z = [1e-9 * (22 - i) for i in range(22)]
force = [1e-10 * max(0, i - 9) for i in range(22)]
small = [(z, force, z[::-1], force[::-1], {"spring constant": 0.05})]
make_curves.hdf5(out / "curve" / "hdf5_plain", small, dtype="<f4", fixed=True)
make_curves.hdf5(out / "curve" / "hdf5_packed", small, dtype="<f4", fixed=True, segment=False,
                 how={"chunks": (20,), "compression": "gzip", "shuffle": True, "fletcher32": True})
volts = [max(0, i - 20) * 0.01 for i in range(40)]
sensor = ([40.0 - i for i in range(40)], [1.0 + i for i in range(40)], 1e-3, 50.0)
make_curves.nanoscope(out / "curve" / "nanoscope_ramp", "0x05120130", volts, volts[::-1], volts_lsb=0.000375, sensitivity=50, spring=0.06,
                      ramp=(5.0, 20.0), missing=3, size=2048)
make_curves.nanoscope(out / "curve" / "nanoscope_sensor", "0x09400202", volts, volts[::-1], volts_lsb=1e-8, sensitivity=30, spring=40, width=4,
                      sensor=sensor, size=2048)


# .gwy, by the format's documentation
def part(name, kind, value):
    return name.encode() + b"\0" + kind.encode() + value


def thing(name, data):
    return name.encode() + b"\0" + struct.pack("<I", len(data)) + data


def field(columns, rows, heights, unit="m", count=None):
    units = thing("GwySIUnit", part("unitstr", "s", unit.encode() + b"\0"))
    return thing("GwyDataField", part("xres", "i", struct.pack("<i", columns)) + part("yres", "i", struct.pack("<i", rows))
                 + part("xreal", "d", struct.pack("<d", 1e-8)) + part("yreal", "d", struct.pack("<d", 2e-8)) + part("si_unit_xy", "o", units)
                 + part("si_unit_z", "o", units) + part("data", "D", struct.pack("<I", len(heights) if count is None else count) + struct.pack("<%dd" % len(heights), *heights)))


def gwy(*parts):
    return b"GWYP" + thing("GwyContainer", b"".join(parts))


waves = [3.0 * ((7 * i) % 5) + (40.0 if i == 17 else 0.0) for i in range(36)]
image = part("/0/data", "o", field(6, 6, waves))
title = part("/0/data/title", "s", b"Height\0")
put("gwy", "one", gwy(image, title))
put("gwy", "two_and_mask", gwy(part("/3/data", "o", field(2, 3, [1, 2, 3, 4, 5, 6], "V")), part("/0/mask", "o", field(6, 6, [i % 4 == 0 for i in range(36)])), image))
put("gwy", "gaps", gwy(part("/0/data", "o", field(4, 4, [float("nan"), float("inf")] + [1.0] * 14))))
put("gwy", "lists", gwy(part("/0/a", "S", struct.pack("<I", 2) + b"x\0y\0"), part("/0/b", "O", struct.pack("<I", 1) + thing("Nothing", b"")), part("/0/c", "I", struct.pack("<Iii", 2, 1, 2)), part("/0/d", "b", b"\1"), image))
put("gwy", "cut", gwy(image)[:-40])
put("gwy", "count_beyond_the_file", gwy(part("/0/data", "o", field(6, 6, waves, count=2**32 - 1))))
put("gwy", "strings_beyond_the_file", gwy(part("/0/a", "S", struct.pack("<I", 2**32 - 1) + b"\0" * 20)))
put("gwy", "negative_sides", gwy(part("/0/data", "o", field(-6, -6, waves))))
put("gwy", "nested", gwy(part("/0/data", "o", thing("GwyDataField", part("data", "o", thing("a", part("b", "o", thing("c", b""))))))))

# TOML
key = "0123456789abcdef" * 4
put("toml", "keys", ('[[key]]\nidentity = "omega-1"\npsk = "%s"\nrights = "operate"\n[[certificate]]\nname = "omega-2"\nrights = "observe"\n'
                     '[[certificate]]\nfingerprint = "%s"\nrights = "administer"\n' % (key, key)).encode())
put("toml", "limits", b'scene_name = "flakes"\nscene_hash = "0123456789abcdef"\nworkspace_min_w_nm = [0, 0, -60]\n'
    b'workspace_max_w_nm = [600, 600, 100]\nstart_pos_w_nm = [300, 300, 20]\nsurface_z_w_nm = 1\nforce_max_nn = 500\n'
    b'coupling_stiffness_n_m = 13\ncoupling_damping_n_s_m = 0\nrate_max_hz = 8000\n')
for kind, more in (("step", "height_nm = 5"), ("grating", "height_nm = 5\nperiod_nm = 40"), ("sphere", "radius_nm = 30"), ("plane", "slope_x = 0.1")):
    put("toml", kind, ('name = "%s"\n[sample]\nyoungs_modulus_gpa = 1\npoisson_ratio = 0.3\nsurface_energy_j_m2 = 0.1\n'
                       '[surface]\nkind = "%s"\n%s\n[probe]\ntip_radius_nm = 20\nrigid = true\n[probe.tip]\nyoungs_modulus_gpa = 160\n'
                       'poisson_ratio = 0.27\nsurface_energy_j_m2 = 0.2\n[forces]\n[coupling]\nstiffness_n_m = 20\n[limits]\n'
                       'force_max_nn = 100\nhalf_width_nm = 16\n[start]\nx_nm = 0\ny_nm = 0\nheight_nm = 20\n' % (kind, kind, more)).encode())
put("path", "square", b"t_s,x_nm,y_nm,z_nm\n0,0,0,10\n# down\n1,0,0,-1\n\n2,10,0,-1\n3,10,10,-1.5e0\n")

# fuzz_hdf5.cpp: the base (bit 0: its writer was killed; bit 1: recover it), then changes.
OVERWRITE, FLIP, CUT, COPY, WHOLE = range(5)
for base in range(4):
    put("hdf5", "as_it_is_%d" % base, bytes([base]))
    put("hdf5", "flips_%d" % base, bytes([base]) + b"".join(bytes([FLIP]) + struct.pack("<HbB", i * 37 % 65536, 0, i % 8) for i in range(6)))
    put("hdf5", "sizes_%d" % base, bytes([base, OVERWRITE]) + struct.pack("<Hb", 900, 0) + bytes([7]) + bytes([255] * 8))
    put("hdf5", "cut_%d" % base, bytes([base, CUT]) + struct.pack("<I", 3000))
    put("hdf5", "copy_%d" % base, bytes([base, COPY]) + struct.pack("<HHB", 500, 1500, 40))
put("hdf5", "no_hdf5", bytes([0, WHOLE]) + b"time_s,x\n0,1\n")
put("hdf5", "signature_only", bytes([0, WHOLE]) + b"\x89HDF\r\n\x1a\n" + bytes([0] * 16) + bytes([255] * 72))


# Scene bundles (nve_server/scene/scene_bundle.h).
def bundle(values, scan=None, text="", count=None, version=1):
    def value(path, v):
        kind, body = ((0, b"") if v is None else (1, bytes([v])) if isinstance(v, bool) else (2, struct.pack("<q", v)) if isinstance(v, int)
                      else (3, struct.pack("<d", v)) if isinstance(v, float) else (4, struct.pack("<H", len(v)) + v.encode()))
        return bytes([kind, len(path)]) + path.encode() + body
    table = struct.pack("<I", len(values) if count is None else count) + b"".join(value(p, values[p]) for p in sorted(values))
    entries = ([("scan.gsf", scan)] if scan else []) + [("scene.toml", text.encode()), ("values", table)]
    return b"TLNB" + struct.pack("<III", 1, version, len(entries)) + b"".join(
        bytes([len(n)]) + n.encode() + struct.pack("<I", len(c)) + c for n, c in entries)


flat = {"name": "flat", "sample.youngs_modulus_gpa": 70.0, "sample.poisson_ratio": 0.27, "sample.surface_energy_j_m2": 0.2, "surface.kind": "flat",
        "probe.tip_radius_nm": 20.0, "probe.rigid": True, "probe.tip.youngs_modulus_gpa": 160.0, "probe.tip.poisson_ratio": 0.27,
        "probe.tip.surface_energy_j_m2": 0.2, "forces": None, "coupling.stiffness_n_m": 20.0, "limits.force_max_nn": 500.0,
        "start.x_nm": 0.0, "start.y_nm": 0.0, "start.height_nm": 20.0}
put("bundle", "flat", bundle(flat))
put("bundle", "text_too", bundle(dict(flat, name="a"), text='name = "a"\n'))
put("bundle", "sphere", bundle(dict(flat, **{"surface.kind": "sphere", "surface.radius_nm": 30.0, "limits.half_width_nm": 20.0})))
put("bundle", "grating", bundle(dict(flat, **{"surface.kind": "grating", "surface.height_nm": 5.0, "surface.period_nm": 40.0,
                                            "limits.half_width_nm": 20.0, "surface.spacing_nm": 1.0})))
put("bundle", "marks", bundle(dict(flat, **{"sample.hardness_gpa": 1.0, "limits.half_width_nm": 20.0, "marks.spacing_nm": 2.0})))
put("bundle", "scan", bundle(dict(flat, **{"surface.kind": "scan", "surface.file": "scan.gsf", "start.x_nm": 30.0, "start.y_nm": 30.0}),
                             scan=gsf(8, 8, [1e-10 * (i % 5) for i in range(64)])))
put("bundle", "scan_of_nan", bundle(dict(flat, **{"surface.kind": "scan", "surface.file": "scan.gsf"}), scan=gsf(2, 2, [float("nan")] * 4)))
put("bundle", "path_in_it", bundle(dict(flat, **{"surface.kind": "scan", "surface.file": "/etc/passwd"}), scan=gsf(2, 2, [0.0] * 4)))
put("bundle", "many_values", bundle(flat, count=0xffffffff))
put("bundle", "other_physics", bundle(flat, version=99))
put("bundle", "twice", bundle(flat).replace(b"start.y_nm", b"start.x_nm"))
put("bundle", "cut", bundle(flat)[:-9])
put("bundle", "not_finite", bundle(dict(flat, **{"start.x_nm": float("nan")})))
put("bundle", "bomb", bundle(dict(flat, **{"surface.kind": "grating", "surface.height_nm": 5.0, "surface.period_nm": 1e5,
                                         "limits.half_width_nm": 1e6, "surface.spacing_nm": 0.05})))
