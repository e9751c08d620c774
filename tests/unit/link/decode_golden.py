#!/usr/bin/env python3
"""A second implementation of the wire form, from PROTOCOL.md alone: no Protobuf, no code shared with the codec.

decode_golden.py FOLDER decodes FOLDER/*.bin and checks a few values that a person can look up in golden_messages.h.
"""
import pathlib
import struct
import sys

TYPES = {1: "hello", 2: "challenge", 3: "welcome", 4: "refuse", 5: "command", 6: "reply", 7: "bye",
         8: "scene_request", 9: "scene_chunk", 10: "snapshot_request", 11: "snapshot_piece"}
# Field list of each type in PROTOCOL.md's order: q = fixed64, i = fixed32, d = double, b = bytes.
FIELDS = {
    "hello": "iiqqqqi",
    "challenge": "qq",
    "welcome": "iqqqqiiibq" + "d" * 15 + "qqqqiq" + "-" * 8 + "qqi",
    "refuse": "qiii",
    "command": "qqqqii" + "d" * 8 + "i" + "d" * 7 + "-" * 8 + "i" + "-" * 8 + "bb",  # - = no such field
    "reply": "qqqqqqqiii" + "d" * 9 + "d" * 5 + "i" + "d" * 10 + "i" + "d" * 3 + "q" + "d" * 4 + "i" + "qqqiiq",
    "bye": "qi",
    "scene_request": "qqi",
    "scene_chunk": "qqib",
    "snapshot_request": "qii",
    "snapshot_piece": "qiiqqiib",
}
WIRE = {"q": 1, "d": 1, "b": 2, "i": 5}
FORMAT = {"q": "<Q", "d": "<d", "i": "<I"}


def varint(data, at):
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            return value, at


def decode(datagram):
    assert len(datagram) <= 512 and datagram[:4] == b"TLNO" and datagram[4] == 1
    name = TYPES[datagram[5]]
    (length,) = struct.unpack_from("<H", datagram, 6)
    assert len(datagram) == 8 + length, "length"
    payload, at, values = datagram[8:], 0, {}
    while at < len(payload):
        tag, at = varint(payload, at)
        number, wire = tag >> 3, tag & 7
        if name == "hello" and number == 15:
            size, at = varint(payload, at)
            assert wire == 2 and at + size == len(payload) and not any(payload[at:])
            break
        kind = FIELDS[name][number - 1]
        assert wire == WIRE[kind] and number not in values
        if kind == "b":
            size, at = varint(payload, at)
            values[number] = payload[at:at + size]
        else:
            size = struct.calcsize(FORMAT[kind])
            (values[number],) = struct.unpack_from(FORMAT[kind], payload, at)
        at += size
    assert at == len(payload) or name == "hello"
    return name, values


def main():
    folder = pathlib.Path(sys.argv[1])
    decoded = {}
    for path in sorted(folder.glob("*.bin")):
        name, values = decode(path.read_bytes())
        assert name == path.stem.partition("_with_")[0], path
        decoded[path.stem] = values
    more = {f"{name}_with_{what}" for name in ("command", "reply") for what in ("features", "sharing")}
    assert set(decoded) == set(TYPES.values()) | more | {"command_with_recent", "reply_with_history", "reply_with_particle", "welcome_with_scene",
                                                             "command_with_steps", "reply_with_steps", "welcome_with_steps",
                                                             "welcome_with_well"}, decoded.keys()
    for name, fields in FIELDS.items():
        seen = set().union(*(values for stem, values in decoded.items() if stem.partition("_with_")[0] == name))
        assert seen | ({15} if name == "hello" else {2} if name == "welcome" else set()) >= {
            number for number, kind in enumerate(fields, 1) if kind != "-"}, name
    assert len((folder / "hello.bin").read_bytes()) == 512
    assert decoded["hello"][7] == 4000
    assert decoded["welcome"][9] == b"flakes" and decoded["welcome"][24] == -0.375
    assert decoded["command"][2] == 1001 and decoded["command"][12] == 3.5 and decoded["command"][13] == 0.03125
    assert decoded["reply"][13] == 12.75 and decoded["reply"][19] == 1024.25 and decoded["reply"][9] == 3
    command, reply = decoded["command_with_features"], decoded["reply_with_features"]
    assert command[15] == 4 and command[17] == 0.0078125 and command[20] == -7.125 and command[22] == 0.00390625
    assert reply[20] == 512.5 and reply[24] == 256.25 and reply[25] == 42 and reply[28] == 13.25 and reply[30] == -0.5
    assert [reply[k] for k in range(32, 36)] == [0.625, 17.5, 0.3125, 2.25]
    assert decoded["command_with_sharing"][31] == 5 and decoded["command_with_sharing"][6] == 11
    assert [decoded["reply_with_sharing"][k] for k in range(36, 40)] == [6, 1.25, -2.5, 3.75]
    recent = list(struct.iter_unpack("<II7d", decoded["command_with_recent"][40]))
    assert len(recent) == 4 and recent[0] == (250000, 3, 0.875, -1.75, 3.4375, 8176.5, -4.5, 5.25, -5.125), recent
    assert recent[3][:2] == (1000000, 2)
    assert decoded["reply_with_history"][40] == 0xFEDCBA9876543210
    assert [decoded["reply_with_particle"][k] for k in range(41, 46)] == [61.5, -7.25, 30.125, 30.5, 2]
    assert decoded["welcome_with_well"] == decoded["welcome"] | {25: 384.5}
    words = [0x6162636465666768, 0x7172737475767778, 0x8182838485868788, 0x9192939495969798]
    assert decoded["welcome_with_scene"] == decoded["welcome_with_well"] | dict(zip(range(26, 30), words)) | {
        30: 262437, 31: 0xA1A2A3A4A5A6A7A8}
    assert decoded["scene_request"] == {1: 0x4142434445464740, 2: words[0], 3: 565}
    assert decoded["scene_chunk"] == decoded["scene_request"] | {4: bytes((7 * i + 3) % 256 for i in range(277))}
    assert decoded["bye"] == {1: 0x4142434445464740, 2: 1}
    print("decoded", len(decoded), "golden datagrams")


if __name__ == "__main__":
    main()
