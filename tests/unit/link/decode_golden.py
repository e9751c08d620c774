#!/usr/bin/env python3
"""A second implementation of the wire form, from PROTOCOL.md alone: no Protobuf, no code shared with the codec.

decode_golden.py FOLDER decodes FOLDER/*.bin by the tables of FOLDER/../PROTOCOL.md, and compares with FOLDER/values.txt.
"""
import pathlib
import re
import struct
import sys

FORMAT = {"fixed32": "<I", "fixed64": "<Q", "double": "<d"}
WIRE = {"fixed64": 1, "double": 1, "bytes": 2, "fixed32": 5}


def document_fields(text):
    """{type: (message, {number: (field, kind)})}"""
    found = {}
    for number, message, body in re.findall(r"^### (\d+) (\w+)[^\n]*\n(.*?)(?=^##)", text, re.M | re.S):
        fields = {}
        for numbers, names, kind in re.findall(r"^\| ([\d,– ]+) \| ([^|]+) \| (\w+) \|", body, re.M):
            first, *rest = [int(n) for n in re.findall(r"\d+", numbers)]
            names = ([names.strip().replace("{x,y,z}", axis) for axis in "xyz"] if "{x,y,z}" in names else
                     [name.strip() for name in names.split(",")])
            assert len(names) == (rest[-1] if rest else first) - first + 1, (message, numbers, names)
            fields.update({first + k: (name, kind) for k, name in enumerate(names)})
        found[int(number)] = (message, fields)
    return found


def varint(data, at):
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            return value, at


def decode(datagram, document):
    assert len(datagram) <= 512 and datagram[:4] == b"TLNO" and datagram[4] == 1
    message, fields = document[datagram[5]]
    (length,) = struct.unpack_from("<H", datagram, 6)
    assert len(datagram) == 8 + length, "length"
    payload, at, values = datagram[8:], 0, {}
    while at < len(payload):
        tag, at = varint(payload, at)
        name, kind = fields[tag >> 3]
        assert tag & 7 == WIRE[kind] and name not in values
        if kind == "bytes":
            size, at = varint(payload, at)
            assert at + size <= len(payload)
            values[name] = payload[at:at + size]
        else:
            size = struct.calcsize(FORMAT[kind])
            (values[name],) = struct.unpack_from(FORMAT[kind], payload, at)
        at += size
    assert at == len(payload)
    return message, values


def main():
    folder = pathlib.Path(sys.argv[1])
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "second_implementation"))
    sys.dont_write_bytecode = True
    import golden_values  # pylint: disable=import-outside-toplevel

    document = document_fields((folder.parent / "PROTOCOL.md").read_text(encoding="utf-8"))
    table = golden_values.read(folder)
    assert {path.stem for path in folder.glob("*.bin")} == set(table), "files are not those of values.txt"
    seen = {}
    for name, (message, _, expected) in table.items():
        datagram = (folder / (name + ".bin")).read_bytes()
        found, values = decode(datagram, document)
        padding = values.pop("padding", b"")
        assert found == message and not any(padding) and (not padding or len(datagram) == 512), name
        assert values == expected, (name, values, expected)
        seen.setdefault(message, set()).update(values)
    # Every field is in one of them, but for the padding and the bits of the Welcome, which are none.
    for message, fields in document.values():
        assert seen[message] == {name for name, _ in fields.values()} - {"padding"} - (
            {"feature_bits"} if message == "Welcome" else set()), message
    # A few by hand, should the table and the files be wrong together.
    value = {name: fields for name, (_, _, fields) in table.items()}
    assert value["command"]["tip_pos_w_z_nm"] == 3.5 and value["reply"]["force_w_z_nn"] == 12.75
    assert value["hello"]["rate_hz"] == 4000 and value["welcome"]["scene_name"] == b"flakes"
    recent = list(struct.iter_unpack("<II7d", value["command_with_recent"]["recent_commands"]))
    assert len(recent) == 4 and recent[0] == (250000, 3, 0.875, -1.75, 3.4375, 8176.5, -4.5, 5.25, -5.125), recent
    assert recent[3][:2] == (1000000, 2)
    print("decoded", len(table), "golden datagrams")


if __name__ == "__main__":
    main()
