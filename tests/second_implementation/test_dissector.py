"""proto/telenano.lua in tshark: every golden datagram by every field, and what is malformed is said to be so."""
import json
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

from test_wire import PROTO, VALUES, golden
from wire import FIELDS


def write_capture(path, datagrams):
    """A pcap of UDP datagrams over IPv4 over raw IP (link type 101), one a millisecond."""
    with open(path, "wb") as file:
        file.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 101))
        for k, data in enumerate(datagrams):
            udp = struct.pack(">HHHH", 40000, 5100, 8 + len(data), 0) + data
            ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), k, 0, 64, 17, 0, bytes([127, 0, 0, 1]),
                             bytes([127, 0, 0, 1])) + udp
            file.write(struct.pack("<IIII", 0, 1000 * k, len(ip), len(ip)) + ip)


def dissect(datagrams):
    """What tshark says of each: {filter name: [values]}."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "capture.pcap"
        write_capture(path, datagrams)
        out = subprocess.run(["tshark", "-X", f"lua_script:{PROTO / 'telenano.lua'}", "-r", path, "-T", "json",
                              "--no-duplicate-keys", "-J", "telenano"],
                             capture_output=True, text=True, timeout=60, env={**os.environ, "HOME": folder})
    assert out.returncode == 0, out.stderr
    return [packet["_source"]["layers"].get("telenano") for packet in json.loads(out.stdout)]


class Dissector(unittest.TestCase):
    def test_names_every_field_of_every_golden_datagram(self):
        for (name, value), layer in zip(VALUES.items(), dissect([golden(name) for name in VALUES])):
            title = value.DESCRIPTOR.name.lower()
            self.assertEqual(layer["telenano.magic"], "TLNO")
            self.assertEqual(int(layer["telenano.version"]), 1)
            self.assertEqual(int(layer["telenano.length"]), len(golden(name)) - 8)
            self.assertNotIn("_ws.expert", layer, name)
            shown = {key.split(".")[-1]: text for key, text in layer.items() if key.startswith(f"telenano.{title}.")}
            present = {field.name for field, _ in value.ListFields()} | ({"padding"} if name == "hello" else set())
            self.assertEqual(set(shown), present, name)
            for field, expected in value.ListFields():
                text = shown[field.name]
                if isinstance(expected, float):
                    self.assertAlmostEqual(float(text), expected, delta=1e-5 * abs(expected), msg=field.name)
                elif isinstance(expected, bytes):
                    self.assertIn(text, (expected.hex(":"), expected.decode(errors="replace")))
                else:
                    self.assertEqual(int(text, 0), expected, field.name)

    def test_says_what_is_malformed(self):
        bye = golden("bye")
        longer = lambda extra: bye[:6] + struct.pack("<H", len(bye) - 8 + len(extra)) + bye[8:] + extra
        bads = [bye[:-1], bye + b"\0", bye[:5] + b"\x09" + bye[6:], bye[:4] + b"\2" + bye[5:], longer(bye[-5:]),
                longer(b"\x1d\1\0\0\0"), longer(b"\x80"), longer(b"\x22\x80\x80"), longer(b"\x15\1\0")]
        command = golden("command_with_recent")
        bads.append(command[:6] + struct.pack("<H", len(command) - 9) + command[8:-1])  # half a record
        for bad, layer in zip(bads, dissect(bads)):
            self.assertIn("_ws.expert", layer, bad)

    def test_leaves_others_alone(self):
        self.assertEqual(dissect([b"TLNX" + golden("bye")[4:], b"TLNO", b""]), [None, None, None])

    def test_knows_the_numbers_of_telenano_proto(self):
        # The golden datagrams hold every field, so that the first test has seen them all.
        for cls, numbers in FIELDS.items():
            seen = {f.number for value in VALUES.values() if isinstance(value, cls) for f, _ in value.ListFields()}
            padding = {15} if cls.DESCRIPTOR.name == "Hello" else set()
            absent = {2} if cls.DESCRIPTOR.name == "Welcome" else set()  # feature_bits 0 in the golden Welcome
            self.assertEqual(set(numbers), seen | padding | absent)


if __name__ == "__main__":
    if shutil.which("tshark") is None:
        print("skipped: no tshark (package tshark)")
        sys.exit(0)
    unittest.main()
