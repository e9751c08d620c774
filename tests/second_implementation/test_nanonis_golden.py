"""The golden frames in the tree are what nanonis.py says they are, and hold the document's worked example."""
import os
import unittest

import nanonis

FOLDER = os.path.join(os.environ["TELENANO_SOURCE_DIR"], "tests", "unit", "nanonis", "golden")


class Golden(unittest.TestCase):
    def test_every_command(self):
        self.assertEqual(sorted(os.listdir(FOLDER)), sorted(name + ".hex" for name in nanonis.COMMANDS))
        for name in nanonis.COMMANDS:
            with open(os.path.join(FOLDER, name + ".hex"), encoding="ascii") as file:
                self.assertEqual(file.read(), nanonis.golden_text(name), name)

    def test_worked_example(self):
        name = "FolMe.XYPosSet"
        self.assertEqual(nanonis.request(name, 10e-9, 15e-9, 1), name.encode().ljust(32, b"\0") + bytes.fromhex(
            "00000014 0001 0000 3e45798ee2308c3a 3e501b2b29a4692b 00000001"))
        self.assertEqual(nanonis.answer(name), name.encode().ljust(32, b"\0") + bytes.fromhex(
            "00000008 00000000 00000000 00000000"))


if __name__ == "__main__":
    unittest.main()
