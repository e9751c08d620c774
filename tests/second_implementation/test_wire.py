"""The wire form: the document against telenano.proto, golden datagrams both ways, every drop cause of a single datagram."""
import math
import os
import pathlib
import re
import struct
import unittest

import golden_values
import telenano_options_pb2 as schema
import telenano_pb2 as pb
from wire import (ANY_VERSION, FIELDS, HEADER, MAX_RECENT, RECENT, TYPES, Drop, decode, encode, features_used, scan)

PROTO = pathlib.Path(os.environ["TELENANO_SOURCE_DIR"]) / "proto"
GOLDEN = PROTO / "golden"

TABLE = golden_values.read(GOLDEN)
#: {name: message} of what the golden files hold.
VALUES = {name: getattr(pb, message)(**fields) for name, (message, _, fields) in TABLE.items()}
#: The records of "command_with_recent" by the document's own words: 250 us older and further from the first, each.
RECENT_COMMANDS = b"".join(
    RECENT.pack(250_000 * k, 2 if k == 4 else 3, 1.125 - 0.25 * k, -2.25 + 0.5 * k, 3.5 - 0.0625 * k, 8192.5 - 16 * k,
                -5.5 + k, 6.25 - k, -7.125 + 2 * k) for k in range(1, 5))
#: Those of "command_with_steps" by hand: the first in full (zigzag varints of 18432, -36864, 57344 and 1 ms), two more alike; then
#: 1000 lower and 0.25 ms longer; then a stop at the same place.
STEPS = (struct.pack("<QB", 1001, 5) + bytes.fromhex("43 80a002 ffbf04 808007 80897a".replace(" ", "")) +
         bytes.fromhex("03 00 00 cf0f a0c21e".replace(" ", "")) + bytes.fromhex("1c"))


def golden(name):
    return (GOLDEN / (name + ".bin")).read_bytes()


def without_padding(message):
    copy = type(message)()
    copy.CopyFrom(message)
    if isinstance(copy, pb.Hello):
        copy.ClearField("padding")
    return copy


def cause(datagram):
    try:
        decode(datagram)
    except Drop as drop:
        return drop.cause
    return None


def document_tables():
    """{message: {number: (name, type)}} of section 2, ranges and {x,y,z} written out."""
    text = (PROTO / "PROTOCOL.md").read_text(encoding="utf-8")
    tables = {}
    for title, body in re.findall(r"^### \d+ (\w+)[^\n]*\n(.*?)(?=^##)", text, re.M | re.S):
        fields = tables[title] = {}
        for numbers, names, kind in re.findall(r"^\| ([\d,– ]+) \| ([^|]+) \| (\w+) \|", body, re.M):
            first, *rest = [int(n) for n in re.findall(r"\d+", numbers)]
            last = rest[-1] if rest else first
            if "{x,y,z}" in names:
                names = [names.strip().replace("{x,y,z}", axis) for axis in "xyz"]
            else:
                names = [name.strip() for name in names.split(",")]
            assert len(names) == last - first + 1, (title, numbers, names)
            for number, name in zip(range(first, last + 1), names):
                fields[number] = (name, kind)
    return tables


class Document(unittest.TestCase):
    def test_its_tables_are_telenano_proto(self):
        tables = document_tables()
        names = {getattr(type(pb.Hello.DESCRIPTOR.fields[0]), "TYPE_" + kind.upper()): kind
                 for kind in ("fixed32", "fixed64", "double", "bytes")}
        self.assertEqual(set(tables), {cls.DESCRIPTOR.name for cls in TYPES.values()})
        for cls in TYPES.values():
            descriptor = cls.DESCRIPTOR
            self.assertEqual(tables[descriptor.name], {f.number: (f.name, names[f.type]) for f in descriptor.fields})

    def test_its_largest_datagrams(self):
        # Every field there, none left out as zero.
        text = (PROTO / "PROTOCOL.md").read_text(encoding="utf-8")
        sizes = {cls: HEADER.size + sum((1 if n < 16 else 2) + (4 if wire == 5 else 8)
                                        for n, wire in FIELDS[cls].items() if wire != 2) for cls in (pb.Command, pb.Reply)}
        for cls, size in sizes.items():
            section = re.search(rf"^### \d+ {cls.DESCRIPTOR.name}\b.*?(?=^##)", text, re.M | re.S).group(0)
            self.assertIn(f"At most {size} bytes", section)
            self.assertLessEqual(size, 512)
        redundant = sizes[pb.Command] + 2 + 2 + MAX_RECENT * RECENT.size
        self.assertIn(f"{redundant} bytes with redundancy", text)
        self.assertLessEqual(redundant, 512)


class Golden(unittest.TestCase):
    def test_all_files_are_known(self):
        self.assertEqual({path.stem for path in GOLDEN.glob("*.bin")}, set(VALUES))

    def test_files_decode_to_their_values(self):
        for name, value in VALUES.items():
            with self.subTest(name):
                self.assertEqual(without_padding(decode(golden(name))), value)

    def test_values_encode_to_the_files(self):
        # Compared after decoding, as the document asks; these two libraries even agree in every byte.
        for name, value in VALUES.items():
            with self.subTest(name):
                self.assertEqual(without_padding(decode(encode(value))), value)
                self.assertEqual(encode(value), golden(name))

    def test_the_worked_exchange_of_the_document(self):
        text = (PROTO / "PROTOCOL.md").read_text(encoding="utf-8")
        block = re.search(r"`golden/command.bin`\):\n\n```\n(.*?)```", text, re.S).group(1)
        hexadecimal = "".join("".join(re.findall(r"\b[0-9a-f]{2,16}\b", re.split(r"\s{3,}", line)[0]))
                              for line in block.splitlines())
        self.assertEqual(bytes.fromhex(hexadecimal), golden("command"))

    def test_features_used(self):
        for name, (_, features, _) in TABLE.items():
            self.assertEqual(features_used(VALUES[name]), sum(1 << schema.Feature.Value(word) for word in features), name)

    def test_byte_strings_are_what_their_sections_say(self):
        self.assertEqual(VALUES["command_with_recent"].recent_commands, RECENT_COMMANDS)
        self.assertEqual(VALUES["command_with_steps"].steps, STEPS)
        self.assertEqual(VALUES["scene_chunk"].data, bytes((7 * i + 3) % 256 for i in range(277)))
        self.assertEqual(VALUES["snapshot_piece"].data, bytes((7 * i + 1) % 256 for i in range(200)))


class Causes(unittest.TestCase):
    """Section 8, for one datagram alone."""

    def test_of_the_header(self):
        good = golden("bye")
        for bad, expected in ((good + bytes(500), "oversize"), (good[:7], "truncated"), (b"", "truncated"),
                              (b"TLNX" + good[4:], "bad_magic"), (good[:4] + b"\2" + good[5:], "wrong_version"),
                              (good[:5] + b"\0" + good[6:], "unknown_type"), (good[:5] + b"\x0f" + good[6:], "unknown_type"),
                              (good[:-1], "truncated"), (good + b"\0", "bad_length"), (golden("hello")[:400], "truncated")):
            self.assertEqual(cause(bad), expected, bad[:10])
        short_hello = b"TLNO\1\1" + struct.pack("<H", 100) + bytes([0x7A, 98]) + bytes(98)
        self.assertEqual(cause(short_hello), "bad_length")

    def test_a_hello_and_a_refuse_of_any_version_are_read(self):
        for name, value in VALUES.items():
            data = golden(name)
            other = data[:4] + b"\x63" + data[5:]
            self.assertEqual(cause(other), None if type(value) in ANY_VERSION else "wrong_version", name)

    def test_of_fields(self):
        def bye(payload):
            return cause(b"TLNO\1\7" + struct.pack("<H", len(payload)) + payload)

        good = golden("bye")[8:]
        self.assertIsNone(bye(good))
        self.assertIsNone(bye(good[9:] + good[:9]), "any order")
        for bad in (good + b"\x1d\1\0\0\0", good + good[9:], good[:-1], b"\x89\0" + good[1:], b"\x08\1", good + b"\x80",
                    good + b"\0", good + b"\x22\1\0"):
            self.assertEqual(bye(bad), "malformed_field", bad)
        # The length of a byte string, too, only in its shortest form.
        name = golden("welcome").replace(b"\x4a\x06flakes", b"\x4a\x86\0flakes")
        name = name[:6] + struct.pack("<H", len(name) - 8) + name[8:]
        self.assertEqual(cause(name), "malformed_field")
        with self.assertRaises(Drop):
            scan(b"\x4a\x31" + bytes(49), pb.Welcome)

    def changed(self, name, **values):
        message = type(VALUES[name])()
        message.CopyFrom(VALUES[name])
        for field, value in values.items():
            setattr(message, field, value)
        return cause(encode(message))

    def test_of_numbers_that_are_none(self):
        for name, value in VALUES.items():
            for field in value.DESCRIPTOR.fields:
                if isinstance(getattr(value, field.name), float):
                    for bad in (math.nan, math.inf, -math.inf):
                        self.assertEqual(self.changed(name, **{field.name: bad}), "non_finite", field.name)

    def test_of_ranges(self):
        zero = {"hello": {"nonce"}, "challenge": {"nonce", "cookie"},
                "welcome": {"version", "nonce", "session_id", "epoch", "timeout_ms"}, "refuse": {"nonce", "reason"},
                "command": {"sequence"}, "reply": {"sequence", "command_sequence"}, "bye": {"session_id", "reason"}}
        zero |= {"scene_request": {"session_id", "bundle"}, "scene_chunk": {"session_id", "bundle", "data"},
                 "snapshot_request": {"session_id", "snapshot"}, "snapshot_piece": {"session_id", "snapshot"},
                 "scene_list_request": {"session_id"}, "scene_switch": {"session_id", "nonce", "scene_hash"},
                 "scene_list_entry": {"session_id", "count", "scene_hash", "scene_name"}}
        more = dict.fromkeys(("command_with_features", "command_with_recent"), {"energy_scale_aj_j", "wave_impedance_n_s_m"})
        more["welcome_with_scene"] = {"scene_sha256_0", "scene_bytes"}
        zero = {name: zero[name.partition("_with_")[0]] | more.get(name, set()) for name in VALUES}
        not_negative = {"force_max_nn", "coupling_stiffness_n_m", "coupling_damping_n_s_m", "energy_in_j", "energy_out_j",
                        "energy_in_aj", "energy_out_aj", "energy_scale_aj_j", "energy_sent_j", "energy_sent_aj",
                        "wave_energy_aj", "wave_impedance_n_s_m", "model_stiffness_n_m", "model_adhesion_nn",
                        "model_shear_stiffness_n_m", "model_friction_nn", "particle_radius_nm", "well_aj"}
        for name, value in VALUES.items():
            for field in value.DESCRIPTOR.fields:
                # Padding is no value; ranges between fields stand below.
                if field.name.startswith(("padding", "version_m", "workspace", "model_normal")):
                    continue
                expected = "out_of_range" if field.name in zero[name] else None
                default = b"" if field.name in ("scene_name", "recent_commands", "data", "steps") else 0
                self.assertEqual(self.changed(name, **{field.name: default}), expected, (name, field.name))
                if isinstance(getattr(value, field.name), float):
                    expected = "out_of_range" if field.name in not_negative else None
                    self.assertEqual(self.changed(name, **{field.name: -1.5}), expected, (name, field.name))
        for name in ("hello", "refuse"):
            self.assertEqual(self.changed(name, version_min=0), "out_of_range")
            self.assertEqual(self.changed(name, version_min=2), "out_of_range")
            self.assertIsNone(self.changed(name, version_max=2))
        self.assertEqual(self.changed("command_with_features", method=8), "out_of_range")
        self.assertEqual(self.changed("reply", contact_state=4), "out_of_range")
        self.assertEqual(self.changed("reply_with_particle", particle_state=4), "out_of_range")
        self.assertIsNone(self.changed("reply_with_particle", particle_state=3))
        self.assertEqual(self.changed("command_with_deadband", reply_relative_permille=1001), "out_of_range")
        self.assertIsNone(self.changed("command_with_deadband", reply_relative_permille=1000))
        self.assertEqual(self.changed("command_with_recent", sequence=4), "out_of_range")
        self.assertIsNone(self.changed("command_with_recent", sequence=5))
        first, second = RECENT_COMMANDS[:64], RECENT_COMMANDS[64:128]
        for records, expected in ((first, None), (second + first, "out_of_range"), (first[:63], "malformed_field"),
                                  (RECENT_COMMANDS + RECENT.pack(2_000_000, *[0] * 8), "malformed_field")):
            self.assertEqual(cause(encode(pb.Command(sequence=9, recent_commands=records))), expected)
        for at, bad, expected in ((32, -1.0, "out_of_range"), (32, math.nan, "non_finite"), (8, math.inf, "non_finite"),
                                  (56, -math.inf, "non_finite"), (24, -1.0, None)):
            records = first[:at] + struct.pack("<d", bad) + first[at + 8:]
            self.assertEqual(self.changed("command_with_recent", recent_commands=records), expected, at)
        self.assertEqual(self.changed("refuse", reason=6), "out_of_range")
        self.assertEqual(self.changed("bye", reason=6), "out_of_range")
        self.assertEqual(self.changed("scene_list_entry", index=5), "out_of_range")
        self.assertEqual(self.changed("scene_list_entry", scene_name=b"a\0b"), "out_of_range")
        self.assertEqual(self.changed("welcome", workspace_min_w_x_nm=301), "out_of_range")
        self.assertEqual(self.changed("reply_with_features", model_normal_w_x=0.76), "out_of_range")
        no_normal = dict.fromkeys(("model_normal_w_x", "model_normal_w_y", "model_normal_w_z"), 0)
        self.assertEqual(self.changed("reply_with_features", **no_normal), "out_of_range")
        self.assertIsNone(self.changed("reply_with_features", **no_normal, model_version=0))


if __name__ == "__main__":
    unittest.main()
