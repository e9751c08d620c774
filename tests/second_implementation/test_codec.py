"""The codec and wire.py on the same datagrams: the same drop cause for each, and the same message where there is none."""
import collections
import os
import random
import struct
import subprocess
import unittest

from test_wire import VALUES, golden
from wire import FIELDS, HEADER, Drop, decode, encode

COUNT = 30_000


class Generator:
    """Golden datagrams with a few bytes changed, cut, extended, their fields in any order, some left out or twice, their
    numbers replaced by odd ones; a header that is right in most."""

    ODD = (0.0, -0.0, 1.0, -1.0, 5e-324, 1e308, -1e308, float("inf"), float("-inf"), float("nan"), 1 + 1e-6, 1 - 1.1e-6)

    def __init__(self, seed):
        self.random = random.Random(seed)
        self.golden = [golden(name) for name in VALUES]
        self.fields = {data: self.split(data) for data in self.golden}

    @staticmethod
    def split(data):
        """The fields of a golden datagram, each with its tag."""
        at, out, wires = HEADER.size, [], FIELDS[type(decode(data))]
        while at < len(data):
            tag = data[at] & 0x7F | (data[at + 1] << 7 if data[at] >= 0x80 else 0)
            size = 1 if data[at] < 0x80 else 2
            wire = wires[tag >> 3]
            if wire == 2:
                length = data[at + size]
                lengths = 1
                if length >= 0x80:
                    length, lengths = length & 0x7F | data[at + size + 1] << 7, 2
                size += lengths + length
            else:
                size += 4 if wire == 5 else 8
            out.append(data[at:at + size])
            at += size
        return out

    def next(self):
        r = self.random
        data = r.choice(self.golden)
        kind = r.randrange(4)
        if kind == 0:  # fields in any order, some left out, some twice
            fields = list(self.fields[data])
            if r.random() < 0.7:
                r.shuffle(fields)
            fields = [f for f in fields if r.random() < 0.9 or len(fields) < 3]
            if r.random() < 0.3:
                fields.append(r.choice(fields or [b""]))
            payload = b"".join(fields)
        elif kind == 1:  # odd numbers
            fields = list(self.fields[data])
            for _ in range(r.randrange(1, 4)):
                k = r.randrange(len(fields))
                if len(fields[k]) in (9, 10) and fields[k][0] & 7 == 1:
                    value = struct.pack("<d", r.choice(self.ODD)) if r.random() < 0.7 else r.randbytes(8)
                    fields[k] = fields[k][:-8] + value
                elif fields[k][0] & 7 == 5:
                    fields[k] = fields[k][:-4] + struct.pack("<I", r.choice((0, 1, 2, 3, 4, 5, 6, 7, 8, 0xFFFFFFFF)))
            payload = b"".join(fields)
        else:  # bytes changed, cut, added
            payload = bytearray(data[8:])
            for _ in range(r.randrange(1, 4)):
                payload[r.randrange(len(payload))] = r.randrange(256)
            if kind == 3:
                cut = r.randrange(len(payload) + 1)
                payload = payload[:cut] + r.randbytes(r.choice((0, 0, 1, 2, 9)))
        payload = bytes(payload)
        header = bytearray(HEADER.pack(b"TLNO", 1, data[5], len(payload)))
        if r.random() < 0.1:
            header[r.randrange(8)] = r.randrange(256)
        if data[5] == 1 and r.random() < 0.9:  # a Hello is dropped by its length otherwise
            payload = payload[:504] + bytes(504 - len(payload[:504]))
            header[6:8] = struct.pack("<H", 504)
        return bytes(header) + payload


class Codec(unittest.TestCase):
    def test_agrees_on_every_datagram(self):
        generator = Generator(2026)
        datagrams = [golden(name) for name in VALUES] + [generator.next() for _ in range(COUNT)]
        stream = b"".join(struct.pack("<H", len(d)) + d for d in datagrams)
        done = subprocess.run([os.environ["TELENANO_ECHO"]], input=stream, capture_output=True, timeout=60, check=True)
        lines = done.stdout.decode().split("\n")[:-1]
        self.assertEqual(len(lines), len(datagrams))
        causes = collections.Counter()
        for datagram, line in zip(datagrams, lines):
            cause, echo = line.split(" ")
            try:
                message = decode(datagram)
                expected = "none"
            except Drop as drop:
                expected = drop.cause
            self.assertEqual(cause, expected, datagram.hex())
            causes[cause] += 1
            if expected == "none":
                # In bytes, so that every bit of a number counts, the sign of a zero too; a padding is no value.
                if datagram[5] == 1:
                    message.ClearField("padding")
                elif datagram[5] == 5:  # the echo leaves out the steps, which test_wire.py looks at
                    message.ClearField("steps")
                self.assertEqual(bytes.fromhex(echo), encode(message), datagram.hex())
        print(dict(causes))
        for cause in ("none", "truncated", "oversize", "bad_magic", "wrong_version", "unknown_type", "bad_length",
                      "malformed_field", "non_finite", "out_of_range"):
            self.assertGreaterEqual(causes[cause], 10, cause)


if __name__ == "__main__":
    unittest.main()
