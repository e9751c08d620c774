#!/usr/bin/env python3
"""Processor time of what has nothing to do: a simulated controller, a server, its guard, a deadman; by the kernel's own account.

idle_test.py SOURCE_DIR TELENANO_NVE TELENANO_AFM_SIM TELENANO_MASTER [unittest's arguments]
"""
import pathlib
import re
import subprocess
import sys
import time
import unittest

sys.path[:0] = [str(pathlib.Path(__file__).parent)]
import deadman_test  # noqa: E402
from deadman_test import NVE, children  # noqa: E402

MOST = 0.02  # of a core
# Of a simulator and of a server that nobody talks to: five times what was measured on a machine with other work (0.02 and 0.1 %).
# A simulator that looked for a client fifty times a second, and made a context of Asio's each time, took 0.4 %.
MOST_ALONE = {"alone": 0.001, "nve": 0.005}
# Of the last four twice what was found.
MOST_WAKES_S = {"alone": 6, "nve": 40, "simulator": 300, "server": 600, "guard": 300, "deadman": 300}
MEASURED_S = 2.0
# What a wake-up costs is the machine's: on a virtual one 20 to 200 µs, and 2 ms where they are rare. The floor in the same seconds is a
# process that only sleeps, about as often; a program may cost as much as is said above, or so many times the floor for its wake-ups.
FLOOR = "import sys, time\nwhile True: time.sleep(1 / float(sys.argv[1]))"
FLOOR_WAKES_S = {"alone": 2}
TIMES_FLOOR = 3


def processor_s(pid):
    """Of all its threads: nanoseconds on a processor are the first number of schedstat."""
    total = 0
    for task in pathlib.Path(f"/proc/{pid}/task").iterdir():
        total += int((task / "schedstat").read_text().split()[0])
    return 1e-9 * total


def wakes(pid):
    """How often its threads have gone to sleep."""
    total = 0
    for task in pathlib.Path(f"/proc/{pid}/task").iterdir():
        total += int(re.search(r"^voluntary_ctxt_switches:\s+(\d+)", (task / "status").read_text(), re.M)[1])
    return total


class Idle(deadman_test.Rig):
    def measure(self, **pids):
        """Shares of a core; the least of some looks, since what a program does once is no load."""
        least = dict.fromkeys(pids, 1e9)
        fewest = dict.fromkeys(pids, 1e9)
        most = {name: MOST_ALONE.get(name, MOST) for name in pids}
        sleeper = subprocess.Popen([sys.executable, "-c", FLOOR, str(max(FLOOR_WAKES_S.get(name, 100) for name in pids))])
        self.addCleanup(sleeper.wait)
        self.addCleanup(sleeper.kill)
        time.sleep(0.5)
        for _ in range(3):
            floor = processor_s(sleeper.pid), wakes(sleeper.pid)
            before = {name: processor_s(pid) for name, pid in pids.items()}
            slept = {name: wakes(pid) for name, pid in pids.items()}
            began = time.monotonic()
            time.sleep(MEASURED_S)
            took = time.monotonic() - began
            for name, pid in pids.items():
                least[name] = min(least[name], (processor_s(pid) - before[name]) / took)
                fewest[name] = min(fewest[name], (wakes(pid) - slept[name]) / took)
            a_wake_s = (processor_s(sleeper.pid) - floor[0]) / (wakes(sleeper.pid) - floor[1])
            for name in pids:
                most[name] = max(most[name], TIMES_FLOOR * a_wake_s * fewest[name])
            if all(least[name] < most[name] and fewest[name] < MOST_WAKES_S[name] for name in pids):
                break
        print(", ".join(f"{name} {100 * least[name]:.3f} %, {fewest[name]:.0f} wake-ups a second" for name in pids) + f"; a wake-up {1e6 * a_wake_s:.0f} us",
              file=sys.stderr)
        for name in pids:
            self.assertLess(least[name], most[name], name)
            self.assertLess(fewest[name], MOST_WAKES_S[name], name)

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
