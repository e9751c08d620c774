#!/usr/bin/env python3
"""Processor time of what has nothing to do: a simulated controller, a server, its guard, a deadman; by the kernel's own account.

idle_test.py SOURCE_DIR TELENANO_NVE TELENANO_AFM_SIM TELENANO_MASTER [unittest's arguments]
"""
import pathlib
import sys
import time
import unittest

sys.path[:0] = [str(pathlib.Path(__file__).parent)]
import deadman_test  # noqa: E402
from deadman_test import NVE, children  # noqa: E402

MOST = 0.02  # of a core
MEASURED_S = 2.0


def processor_s(pid):
    """Of all its threads: nanoseconds on a processor are the first number of schedstat."""
    total = 0
    for task in pathlib.Path(f"/proc/{pid}/task").iterdir():
        total += int((task / "schedstat").read_text().split()[0])
    return 1e-9 * total


class Idle(deadman_test.Rig):
    def measure(self, **pids):
        """Shares of a core; the least of some looks, since what a program does once is no load."""
        least = dict.fromkeys(pids, 1e9)
        for _ in range(3):
            before = {name: processor_s(pid) for name, pid in pids.items()}
            began = time.monotonic()
            time.sleep(MEASURED_S)
            took = time.monotonic() - began
            for name, pid in pids.items():
                least[name] = min(least[name], (processor_s(pid) - before[name]) / took)
            if max(least.values()) < MOST:
                break
        print(", ".join(f"{name} {100 * share:.2f} %" for name, share in least.items()), file=sys.stderr)
        for name, share in least.items():
            self.assertLess(share, MOST, name)

    def test_a_controller_and_a_server_with_nobody_there(self):
        """The tip is up, as an hour after the last session."""
        simulator = self.simulator()
        self.measure(alone=simulator.process.pid)
        server = self.start(NVE, "serve", "--scene", "flat_silicon_oxide", "--listen", "127.0.0.1:0")
        self.assertTrue(server.says(" on 127.0.0.1:"), server.text)
        self.measure(nve=server.process.pid)

    def test_an_afm_whose_tip_is_up(self):
        simulator = self.simulator()
        watcher = self.deadman()
        words = self.serve_words()
        text = (self.path / "afm.toml").read_text()
        self.assertIn("park_after_s = 60.0", text)
        (self.path / "afm.toml").write_text(text.replace("park_after_s = 60.0", "park_after_s = 1.0"))
        server = self.start(*words)
        self.assertTrue(server.says("serving an AFM on"), server.text)
        self.assertTrue(simulator.says("is up again"), simulator.text)
        time.sleep(1)
        guard, = children(server.process.pid)
        self.measure(simulator=simulator.process.pid, server=server.process.pid, guard=guard, deadman=watcher.process.pid)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[5:], verbosity=2)
