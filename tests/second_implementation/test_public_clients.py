"""Public clients of the Nanonis TCP interface against telenano-afm-sim: each command that they send (public_clients.txt)."""
import os
import struct
import unittest

import nanonis
from test_afm_sim import Simulator

FILE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "public_clients.txt")
NO_SUCH = "unknown command"


def table():
    """command: (clients, arguments, values returned); None: the client writes no layout."""
    with open(FILE, encoding="ascii") as file:
        rows = [line.rstrip("\n").split(";") for line in file if line[0] != "#"]
    return {name: (clients, *(None if kinds == "?" else kinds.split() for kinds in layouts)) for name, clients, *layouts in rows}


def without_counts(kinds):
    """As nanonis.py has them: an array with its count, a list of names with its bytes and its count, is one thing there."""
    text = " ".join(kinds).replace("i i *s", "*s")
    return [kind for kind in text.replace("i *f", "*f").split(" ") if kind]


def a_body(kinds):
    """Zeros, in that layout."""
    size = {"*s": 8, "*": 4, "2": 8}
    return b"".join(b"\0" * (size.get(kind) or size.get(kind[0]) or struct.calcsize(">" + kind)) for kind in kinds or [])


class PublicClients(unittest.TestCase):
    def test_what_the_simulator_has_is_laid_out_as_they_do(self):
        rows = table()
        self.assertGreater(len(rows), 600)
        for name, (arguments, values) in nanonis.COMMANDS.items():
            clients, sent, read = rows[name]
            self.assertTrue({"s", "r"} <= set(clients), name)
            self.assertEqual(without_counts(sent), arguments, name)
            self.assertEqual(without_counts(read), values, name)

    def test_every_command_is_answered(self):
        """What it has with the values' layout; the rest as by a controller without that module, and the connection goes on."""
        simulator = Simulator()
        client = simulator.client()
        known = unknown = 0
        try:
            for name, (_, sent, _) in table().items():
                client.socket.sendall(nanonis.frame(name, a_body(sent), 1))
                header = client.read(40)
                self.assertEqual(header[:32].rstrip(b"\0").decode(), name)
                size, reply, zero = struct.unpack(">iHH", header[32:])
                self.assertEqual((reply, zero), (0, 0), name)
                body = client.read(size)
                if name in nanonis.COMMANDS:
                    known += 1
                    _, body = nanonis.unpack(nanonis.COMMANDS[name][1], body)
                else:
                    unknown += 1
                status, length = struct.unpack_from(">Ii", body)
                self.assertEqual(length, len(body) - 8, name)
                self.assertEqual(body[8:].decode().startswith(NO_SUCH), name not in nanonis.COMMANDS, name)
                self.assertTrue(status != 0 or length == 0, name)
            self.assertEqual(client.call("ZCtrl.StatusGet"), 1, "off, and still talking")
        finally:
            client.close()
            simulator.stop()
        print(f"{known} commands that the simulator has, {unknown} that it has not: each answered")
        self.assertEqual(known, len(nanonis.COMMANDS))


if __name__ == "__main__":
    unittest.main()
