#!/usr/bin/env python3
"""Random faults of a real server, guard, deadman, station and simulated controller over TCP, each at a random moment from the
first check to a tip that presses against the force limit. By the rig's own force: the tip ends up, and has never pressed harder
than the limit, one step and the drift of the outage allow.

afm_faults_test.py SOURCE_DIR TELENANO_NVE TELENANO_AFM_SIM TELENANO_MASTER
TELENANO_AFM_FAULTS (11) and TELENANO_AFM_SEED (1) say how many, and which.
"""
import collections
import concurrent.futures
import math
import os
import random
import re
import signal
import sys
import time
import unittest

import deadman_test
from deadman_test import children

STIFFNESS_N_M, STEP_NM, FORCE_MAX_NN, DRIFT_NM_S = 40.0, 1.0, 100.0, 0.1
PATIENCE_MS = 400   # of the server with the controller: a busy machine is no fault. The guard has four times as much with the server.
AFTER_S = 4.0       # guard 1.6 s, deadman 0.5 s, the way up, and a busy machine
FAULTS = ("station killed", "server killed", "server hangs", "guard killed", "server and guard killed", "deadman killed",
          "deadman hangs", "silent", "reset", "garbage", "slow")


class Trial(deadman_test.Rig):
    """One fault; not a test of its own."""

    def runTest(self):
        pass

    def serve_words(self, **options):
        words = super().serve_words(**options)
        text = (deadman_test.SOURCE / "deploy/afm.toml").read_text() + '\n[deadman]\nkey = "server.key"\n'
        text = text.replace("force_max_nn = 300.0", f"force_max_nn = {FORCE_MAX_NN}")
        text = text.replace("link_loss_ms = 100.0", f"link_loss_ms = {PATIENCE_MS}.0")
        text = text.replace("reply_timeout_ms = 100.0", f"stale_force_ms = {PATIENCE_MS}.0\nreply_timeout_ms = {PATIENCE_MS}.0")
        (self.path / "afm.toml").write_text(text)
        return words

    def trial(self, fault, at_s, length_s):
        control = self.path / "faults.txt"
        simulator = self.simulator("--control", control, "--drift-nm-s", str(-DRIFT_NM_S))
        watcher = self.deadman()
        server = self.start(*self.serve_words())
        begun = time.monotonic()
        station = None
        while (left := begun + at_s - time.monotonic()) > 0:
            if station is None and "serving an AFM on" in server.text and server.text.endswith("\n"):
                station = self.station(server, duration_s=8)
            time.sleep(min(0.02, left))
        guards = children(server.process.pid)
        phase = ("pressing" if station and "engaged" in station.text else "waiting" if "surface found" in server.text
                 else "approaching" if "approaching" in server.text else "checking")
        if fault in ("silent", "reset", "garbage", "slow"):
            line = {"silent": f"silent {1e3 * length_s:.0f}ms", "slow": f"slow {1e3 * length_s:.0f}ms 500ms"}.get(fault, fault)
            control.write_text(line + "\n")
        if fault == "station killed" and station:
            station.kill()
        if fault in ("server hangs", "server and guard killed"):
            server.kill(signal.SIGSTOP)
        if fault in ("guard killed", "server and guard killed"):
            for guard in guards:
                os.kill(guard, signal.SIGKILL)
        if fault in ("server killed", "server and guard killed"):
            server.kill(signal.SIGKILL)
        if fault.startswith("deadman"):
            watcher.kill(signal.SIGKILL if "killed" in fault else signal.SIGSTOP)
        fault_s = time.monotonic()
        time.sleep(AFTER_S + (length_s if fault in ("silent", "slow") else 0))
        end = simulator.stop()
        outage_s = time.monotonic() - fault_s
        peak_nn = float(re.search(r"greatest ([\d.]+) nN", end)[1])
        # What passes by itself needs no withdrawal: short silences, and a station that was not there to be killed.
        passing = (fault in ("silent", "slow") and length_s < 0.6) or (fault == "station killed" and phase != "pressing")
        # A fault of a process in the checks or while the tip waits for a station ends its server, not the tip's waiting.
        return {"fault": fault, "phase": phase, "at_s": at_s, "length_s": length_s, "peak_nn": peak_nn,
                "allowed_nn": FORCE_MAX_NN + STIFFNESS_N_M * (STEP_NM + DRIFT_NM_S * outage_s),
                "up": "tip withdrawn" in end, "must": not passing, "end": end.splitlines()[-1],
                "log": server.text + watcher.text}


def run(index, seed):
    chance = random.Random(1000 * seed + index)
    fault = FAULTS[index % len(FAULTS)]
    length_s = 1e-3 * math.exp(chance.uniform(0, math.log(3000)))
    case = Trial()
    case.setUp()
    try:
        return case.trial(fault, chance.uniform(0.05, 14), length_s)
    finally:
        case.doCleanups()


class Faults(unittest.TestCase):
    def test_no_fault_presses_harder_than_a_step_and_the_drift(self):
        count, seed = int(os.environ.get("TELENANO_AFM_FAULTS", "11")), int(os.environ.get("TELENANO_AFM_SEED", "1"))
        with concurrent.futures.ThreadPoolExecutor(4) as pool:
            trials = list(pool.map(lambda i: run(i, seed), range(count)))
        phases = collections.Counter(t["phase"] for t in trials)
        worst = max(trials, key=lambda t: (t["peak_nn"] - FORCE_MAX_NN) / (t["allowed_nn"] - FORCE_MAX_NN))
        print(f"{count} faults ({', '.join(f'{n} {p}' for p, n in sorted(phases.items()))}); "
              f"greatest force {max(t['peak_nn'] for t in trials):.1f} nN of a limit of {FORCE_MAX_NN:.0f} nN; "
              f"nearest to what is allowed: {worst['peak_nn']:.1f} of {worst['allowed_nn']:.1f} nN, {worst['fault']}; "
              f"withdrawn {sum(t['up'] for t in trials)}, due {sum(t['must'] for t in trials)}", file=sys.stderr)
        for t in trials:
            with self.subTest(fault=t["fault"], phase=t["phase"], at_s=round(t["at_s"], 3), length_s=round(t["length_s"], 3)):
                self.assertLessEqual(t["peak_nn"], t["allowed_nn"], t["log"])
                if t["must"]:
                    self.assertTrue(t["up"], t["end"] + "\n" + t["log"])
        if count >= 100:
            for phase in ("approaching", "pressing"):
                self.assertGreater(phases[phase], 10)
            self.assertGreater(sum(t["peak_nn"] > 0.9 * FORCE_MAX_NN for t in trials), 10, "the limit is put to the test")


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0]] + sys.argv[5:], warnings="ignore")
