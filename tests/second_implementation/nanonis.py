"""The Nanonis TCP protocol, written from its published tables: a second encoder, and a client for real sockets.

`python3 nanonis.py golden FOLDER` writes each command's request and reply as hex, one file a command.
"""
import os
import socket
import struct
import sys

#: name: (arguments, returned values); letters as in struct, big-endian, and *i, *f arrays with their count, *s string arrays.
COMMANDS = {
    "FolMe.XYPosSet": (["d", "d", "I"], []),
    "FolMe.XYPosGet": (["I"], ["d", "d"]),
    "FolMe.SpeedSet": (["f", "I"], []),
    "FolMe.SpeedGet": ([], ["f", "I"]),
    "FolMe.Stop": ([], []),
    "ZCtrl.OnOffSet": (["I"], []),
    "ZCtrl.OnOffGet": ([], ["I"]),
    "ZCtrl.ZPosSet": (["f"], []),
    "ZCtrl.ZPosGet": ([], ["f"]),
    "ZCtrl.StatusGet": ([], ["H"]),
    "ZCtrl.SetpntSet": (["f"], []),
    "ZCtrl.SetpntGet": ([], ["f"]),
    "ZCtrl.Withdraw": (["I", "i"], []),
    "ZCtrl.WithdrawRateSet": (["f"], []),
    "ZCtrl.TipLiftSet": (["f"], []),
    "ZCtrl.SwitchOffDelaySet": (["f"], []),
    "ZCtrl.LimitsEnabledSet": (["I"], []),
    "ZCtrl.LimitsSet": (["f", "f"], []),
    "SafeTip.OnOffSet": (["H"], []),
    "SafeTip.OnOffGet": ([], ["H"]),
    "SafeTip.PropsSet": (["H", "H", "f"], []),
    "SafeTip.PropsGet": ([], ["H", "H", "f"]),
    "Signals.NamesGet": ([], ["*s"]),
    "Signals.ValGet": (["i", "I"], ["f"]),
    "Signals.ValsGet": (["*i", "I"], ["*f"]),
    "Signals.CalibrGet": (["i"], ["f", "f"]),
    "Piezo.RangeGet": ([], ["f", "f", "f"]),
    "Util.AcqPeriodSet": (["f"], []),
    "Util.AcqPeriodGet": ([], ["f"]),
    "ZCtrl.WithdrawRateGet": ([], ["f"]),
    "ZCtrl.TipLiftGet": ([], ["f"]),
    "ZCtrl.SwitchOffDelayGet": ([], ["f"]),
    "ZCtrl.LimitsEnabledGet": ([], ["I"]),
    "ZCtrl.LimitsGet": ([], ["f", "f"]),
    "SafeTip.SignalGet": ([], ["f"]),
}

#: One example of each: arguments, returned values.
EXAMPLES = {
    "FolMe.XYPosSet": ([10e-9, 15e-9, 1], []),
    "FolMe.XYPosGet": ([1], [-2.5e-7, 1.25e-9]),
    "FolMe.SpeedSet": ([1e-6, 1], []),
    "FolMe.SpeedGet": ([], [2.5e-7, 0]),
    "FolMe.Stop": ([], []),
    "ZCtrl.OnOffSet": ([1], []),
    "ZCtrl.OnOffGet": ([], [1]),
    "ZCtrl.ZPosSet": ([-3.5e-8], []),
    "ZCtrl.ZPosGet": ([], [4.75e-8]),
    "ZCtrl.StatusGet": ([], [5]),
    "ZCtrl.SetpntSet": ([2e-9], []),
    "ZCtrl.SetpntGet": ([], [1.875e-9]),
    "ZCtrl.Withdraw": ([1, -1], []),
    "ZCtrl.WithdrawRateSet": ([5e-6], []),
    "ZCtrl.TipLiftSet": ([2e-8], []),
    "ZCtrl.SwitchOffDelaySet": ([0.05], []),
    "ZCtrl.LimitsEnabledSet": ([1], []),
    "ZCtrl.LimitsSet": ([5e-7, -5e-7], []),
    "SafeTip.OnOffSet": ([2], []),
    "SafeTip.OnOffGet": ([], [1]),
    "SafeTip.PropsSet": ([0, 1, 1.5e-8], []),
    "SafeTip.PropsGet": ([], [0, 1, 1.5e-8]),
    "Signals.NamesGet": ([], [["Current (A)", "Deflection (m)", ""]]),
    "Signals.ValGet": ([24, 1], [-1.5e-9]),
    "Signals.ValsGet": ([[8, 9], 0], [[2e-9, -0.125]]),
    "Signals.CalibrGet": ([8], [5e-8, 1e-9]),
    "Piezo.RangeGet": ([], [1e-5, 1e-5, 2e-6]),
    "Util.AcqPeriodSet": ([0.005], []),
    "Util.AcqPeriodGet": ([], [0.02]),
    "ZCtrl.WithdrawRateGet": ([], [5e-6]),
    "ZCtrl.TipLiftGet": ([], [2e-8]),
    "ZCtrl.SwitchOffDelayGet": ([], [0.05]),
    "ZCtrl.LimitsEnabledGet": ([], [1]),
    "ZCtrl.LimitsGet": ([], [5e-7, -2.5e-7]),
    "SafeTip.SignalGet": ([], [-1.5e-9]),
}


def pack(kinds, values):
    out = b""
    for kind, value in zip(kinds, values, strict=True):
        if kind == "*s":
            parts = b"".join(struct.pack(">i", len(s)) + s.encode() for s in value)
            out += struct.pack(">ii", len(parts), len(value)) + parts
        elif kind[0] == "*":
            out += struct.pack(">i", len(value)) + b"".join(struct.pack(">" + kind[1], v) for v in value)
        else:
            out += struct.pack(">" + kind, value)
    return out


def unpack(kinds, body):
    values, at = [], 0

    def take(kind):
        nonlocal at
        (value,) = struct.unpack_from(">" + kind, body, at)
        at += struct.calcsize(">" + kind)
        return value

    for kind in kinds:
        if kind == "*s":
            _total, count = take("i"), take("i")
            names = []
            for _ in range(count):
                n = take("i")
                names.append(body[at:at + n].decode())
                at += n
            values.append(names)
        elif kind[0] == "*":
            values.append([take(kind[1]) for _ in range(take("i"))])
        else:
            values.append(take(kind))
    return values, body[at:]


def zeros(kinds):
    return [[] if kind[0] == "*" else 0 for kind in kinds]


def frame(name, body, reply):
    return name.encode().ljust(32, b"\0") + struct.pack(">iHH", len(body), reply, 0) + body


def request(name, *arguments):
    return frame(name, pack(COMMANDS[name][0], arguments), 1)


def answer(name, *values):
    return frame(name, pack(COMMANDS[name][1], values) + struct.pack(">Ii", 0, 0), 0)


def error_answer(name, status, text, alone):
    values = b"" if alone else pack(COMMANDS[name][1], zeros(COMMANDS[name][1]))
    return frame(name, values + struct.pack(">Ii", status, len(text)) + text.encode(), 0)


class NanonisError(Exception):
    pass


class Client:
    """One serial connection, as anyone's script would have it."""

    def __init__(self, host, port, timeout=5):
        self.socket = socket.create_connection((host, port), timeout=timeout)

    def close(self):
        self.socket.close()

    def read(self, n):
        data = b""
        while len(data) < n:
            more = self.socket.recv(n - len(data))
            if not more:
                raise NanonisError("the controller closed the connection")
            data += more
        return data

    def call(self, name, *arguments):
        self.socket.sendall(request(name, *arguments))
        header = self.read(40)
        assert header[:32].rstrip(b"\0").decode() == name, header
        size, reply, zero = struct.unpack(">iHH", header[32:])
        assert reply == 0 and zero == 0
        body = self.read(size)
        if size >= 8:
            status, length = struct.unpack_from(">Ii", body)
            if status != 0 and length == size - 8:
                raise NanonisError(body[8:].decode())
        values, rest = unpack(COMMANDS[name][1], body)
        status, length = struct.unpack_from(">Ii", rest)
        if status != 0:
            raise NanonisError(rest[8:8 + length].decode())
        assert length == len(rest) - 8
        return values[0] if len(values) == 1 else values


def golden_text(name):
    arguments, values = EXAMPLES[name]
    lines = [("request", request(name, *arguments)), ("reply", answer(name, *values)),
             ("error-zero-filled", error_answer(name, 7, "no tip", False)),
             ("error-alone", error_answer(name, 7, "no tip", True))]
    return "".join(f"{kind} {data.hex()}\n" for kind, data in lines)


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] != "golden":
        sys.exit("usage: nanonis.py golden FOLDER")
    for command in COMMANDS:
        with open(os.path.join(sys.argv[2], command + ".hex"), "w", encoding="ascii") as file:
            file.write(golden_text(command))
