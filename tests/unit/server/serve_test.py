#!/usr/bin/env python3
"""Talks to `serve` over UDP with the protocol written from PROTOCOL.md, sharing no code with the C++ side.

serve_test.py PROGRAM: handshake, exchange, every kind of nonsense, a second server on the same port, SIGTERM.
"""
import pathlib
import re
import signal
import socket
import struct
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "link"))
import decode_golden  # noqa: E402
from decode_golden import FORMAT, WIRE  # noqa: E402

PROTOCOL = pathlib.Path(__file__).resolve().parents[3] / "proto" / "PROTOCOL.md"
DOCUMENT = decode_golden.document_fields(PROTOCOL.read_text(encoding="utf-8"))
NUMBER = {message.lower(): number for number, (message, _) in DOCUMENT.items()}
FIELDS = {message.lower(): fields for message, fields in DOCUMENT.values()}


def decode(datagram):
    """The message and its values by field number; padding is none."""
    message, values = decode_golden.decode(datagram, DOCUMENT)
    numbers = {name: number for number, (name, _) in FIELDS[message.lower()].items()}
    return message.lower(), {numbers[name]: value for name, value in values.items() if name != "padding"}


def tag(number, wire):
    value = number << 3 | wire
    return bytes([value]) if value < 128 else bytes([value & 127 | 128, value >> 7])


def encode(name, values):
    payload = b""
    for number, value in values.items():
        _, kind = FIELDS[name][number]
        payload += tag(number, WIRE[kind]) + struct.pack(FORMAT[kind], value)
    if name == "hello":
        zeros = 504 - len(payload) - 3
        payload += bytes([0x7A, zeros & 127 | 128, zeros >> 7]) + bytes(zeros)
    return b"TLNO" + bytes([1, NUMBER[name]]) + struct.pack("<H", len(payload)) + payload


class Server:
    def __init__(self, program, *arguments):
        self.process = subprocess.Popen([program, "serve", "--scene", "x", *arguments], stderr=subprocess.PIPE, text=True)
        line = self.process.stderr.readline()
        match = re.search(r"serving x on 127\.0\.0\.1:(\d+)", line)
        assert match, line
        self.port = int(match.group(1))


def main():
    program = sys.argv[1]
    for extra in ([], ["--busy-poll", "--timeout-ms", "900"]):
        server = Server(program, "--listen", "127.0.0.1:0", *extra)
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.settimeout(20)
        sock.connect(("127.0.0.1", server.port))

        def ask(datagram):
            sock.send(datagram)
            answer = sock.recv(2000)
            assert len(answer) <= max(len(datagram), 171), "amplification"
            return decode(answer)

        # Another version is refused, with the range that is spoken.
        name, refuse = ask(encode("hello", {1: 2, 2: 9, 4: 77}))
        assert name == "refuse" and refuse == {1: 77, 2: 1, 3: 1, 4: 1}, refuse
        # Cookie, session.
        hello = {1: 1, 2: 1, 4: 4711, 7: 1000}
        name, challenge = ask(encode("hello", hello))
        assert name == "challenge" and challenge[1] == 4711
        name, welcome = ask(encode("hello", {**hello, 5: challenge[2]}))
        assert welcome[7] == (900 if extra else 700), "the scene's time-out; the flag wins over it"
        assert name == "welcome" and welcome[3] == 4711 and welcome[9] == b"spring floor", welcome
        assert ask(encode("hello", {**hello, 5: challenge[2]})) == ("welcome", welcome), "the same once more"
        session, epoch = welcome[4], welcome[6]
        # Exchange: 1 nN/nm floor.
        for k in range(1, 101):
            command = {1: session, 2: k, 3: k * 1000000, 5: epoch, 6: 3, 12: -0.5 * k}
            name, reply = ask(encode("command", command))
            assert name == "reply" and reply[1] == session and reply[2] == k and reply[3] == k, reply
            assert reply[4] == k * 1000000 and reply[13] == 0.5 * k and reply[9] == 3, reply
        # Nonsense is not answered; the session goes on.
        good = encode("command", {1: session, 2: 101, 3: 101000000, 5: epoch, 6: 3})
        for bad in (b"", b"x", good[:-1], good + b"\0", b"TLNP" + good[4:], good[:4] + b"\x02" + good[5:],
                    encode("command", {1: session, 2: 100, 5: epoch}), encode("command", {1: session, 2: 101, 5: epoch ^ 1}),
                    encode("command", {1: session, 2: 101, 5: epoch, 10: float("nan")}), bytes(1400),
                    encode("hello", hello)[:300]):
            sock.send(bad)
        name, reply = ask(good)
        assert name == "reply" and reply[2] == 101, reply
        # A session that does not exist is said to be so.
        name, bye = ask(encode("command", {1: session ^ 0x100, 2: 1, 5: epoch}))
        assert (name, bye) == ("bye", {1: session ^ 0x100, 2: 5}), bye

        second = subprocess.run([program, "serve", "--scene", "x", "--listen", f"127.0.0.1:{server.port}"],
                                stderr=subprocess.PIPE, text=True, timeout=20)
        assert second.returncode == 2 and "in use" in second.stderr and second.stderr.count("\n") == 1, second

        server.process.send_signal(signal.SIGTERM)
        assert decode(sock.recv(2000)) == ("bye", {1: session, 2: 3})
        rest = server.process.stderr.read()
        assert server.process.wait(20) == 0, rest
        for cause in ("truncated", "bad_length", "bad_magic", "wrong_version", "duplicate", "wrong_epoch", "non_finite",
                      "oversize", "unknown_session"):
            assert cause in rest, (cause, rest)

    for arguments, words in ((["--listen", "127.0.0.1:99999"], ["--listen", "0 to 65535"]),
                             (["--listen", "nowhere"], ["--listen", "no port"]),
                             (["--listen", "192.0.2.1:5100"], ["192.0.2.1", "off loopback", "--keys"]),
                             (["--max-sessions", "0"], ["--max-sessions"])):
        wrong = subprocess.run([program, "serve", "--scene", "x", *arguments], stderr=subprocess.PIPE,
                               stdout=subprocess.PIPE, text=True, timeout=20)
        assert wrong.returncode == 2, (arguments, wrong)
        assert all(word in wrong.stderr for word in words), wrong
    print("serve: all good")


if __name__ == "__main__":
    started = time.monotonic()
    main()
    print(f"{time.monotonic() - started:.1f} s")
