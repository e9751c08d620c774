"""What the golden datagrams hold: proto/golden/values.txt, as its README.md describes it. No Protobuf here."""
import pathlib
import re


def value_of(text):
    if text.startswith('"'):
        return text[1:-1].encode()
    if text.startswith("hex"):
        return bytes.fromhex(text[3:])
    if text.startswith("0x"):
        return int(text, 16)
    return float(text) if re.search("[.e]", text) else int(text)


def read(folder):
    """{name: (message, features, {field: value})}, in the order of the table; what comes from another one is in it."""
    table, name = {}, None
    text = (pathlib.Path(folder) / "values.txt").read_text(encoding="ascii")
    for line in re.sub(r"\n +", " ", re.sub(r"^#.*\n", "", text, flags=re.M)).splitlines():
        heading = re.fullmatch(r"\[(\w+)\] (\w+)(?: \+ ([A-Z_ ]+))?", line)
        if heading:
            name, of, more = heading.groups()
            message, features, fields = table.get(of, (of, frozenset(), {}))
            table[name] = (message, features | frozenset((more or "").split()), dict(fields))
        elif line:
            field, _, value = line.partition(": ")
            table[name][2][field] = value_of(value)
    return table
