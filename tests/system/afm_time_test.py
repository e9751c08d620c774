#!/usr/bin/env python3
"""Time that does not go as it should, while a station presses on an AFM, with the real programs over TCP: a wall clock that is set, and
processes that are suspended and go on.

afm_time_test.py SOURCE_DIR TELENANO_NVE TELENANO_AFM_SIM TELENANO_MASTER CLOCK_SHIM [unittest's arguments]
"""
import pathlib
import re
import signal
import subprocess
import sys
import time
import unittest

SHIM = pathlib.Path(sys.argv.pop(5)).resolve()
sys.path[:0] = [str(pathlib.Path(__file__).parent)]
import afm_hazards_test  # noqa: E402
from afm_hazards_test import LATE_NN, LIMIT_NN, LONG_S  # noqa: E402
from deadman_test import MASTER, SOURCE  # noqa: E402


class Time(afm_hazards_test.Base):
    def peaks_nn(self, simulator):
        return [float(x) for x in re.findall(r"its greatest force was ([0-9.]+) nN", simulator.text)]

    def ends_up(self, simulator):
        up, force_nn, text = self.end_of(simulator)
        self.assertTrue(up, text)
        self.assertGreater(force_nn, 20, "it did press")
        self.assertLess(force_nn, LIMIT_NN + LATE_NN)
        self.assertIn("SafeTip 0 times", text)

    def test_a_wall_clock_that_is_set_withdraws_nothing(self):
        """An hour ahead, then an hour back: of deadman, server, guard and station."""
        clock = self.path / "clock"
        clock.write_text("0")
        shifted = ["env", f"LD_PRELOAD={SHIM}", f"TELENANO_CLOCK={clock}"]

        def says():
            return float(subprocess.run([*shifted, sys.executable, "-c", "import time; print(time.time())"], capture_output=True,
                                        text=True, check=True).stdout)
        clock.write_text("3600")
        self.assertGreater(says(), time.time() + 3000, "the shim does what it should")
        clock.write_text("0")
        self.shifted = shifted
        simulator = self.simulator()
        watcher = self.deadman()
        server = self.server()
        self.assertTrue(server.says("surface found"), server.text)
        station = self.press(server)
        self.contact(station)
        for ahead_s in (3600, -3600):
            clock.write_text(str(ahead_s))
            time.sleep(1.5)
        self.assertIsNone(station.process.poll(), station.text)
        self.assertNotIn("withdraw", server.text.partition("surface found")[2], server.text)
        self.assertNotIn("withdraw", watcher.text.partition("watching over the server")[2], watcher.text)
        station.stop()
        server.stop()
        self.ends_up(simulator)

    def start(self, *words, **options):
        if getattr(self, "shifted", None) and "--listen" not in words[1:2]:
            words = [*self.shifted, *words]
        return super().start(*words, **options)

    def test_a_station_that_is_suspended_loses_the_tip_and_presses_no_harder(self):
        simulator = self.simulator()
        server = self.serving()
        station = self.press(server)
        self.contact(station)
        station.kill(signal.SIGSTOP)
        self.assertTrue(server.says("withdrawing"), server.text)
        self.assertTrue(simulator.says("is up again"), simulator.text)
        station.kill(signal.SIGCONT)
        time.sleep(6)  # an approach, and what the hand then does
        station.stop()
        server.stop()
        simulator.says("is up again")
        peaks = self.peaks_nn(simulator)
        self.assertGreater(peaks[0], 20)
        self.assertLess(max(peaks), LIMIT_NN + LATE_NN)
        self.ends_up(simulator)

    def test_a_server_that_is_suspended_finds_its_tip_withdrawn(self):
        """The guard has acted meanwhile. What the server then still sends moves nothing down."""
        simulator = self.simulator()
        words = self.direct()
        text = (self.path / "afm.toml").read_text()
        (self.path / "afm.toml").write_text(text.replace("reply_timeout_ms = 3000.0", "reply_timeout_ms = 500.0"))
        server = self.start(*words)
        self.assertTrue(server.says("serving an AFM on"), server.text)
        station = self.press(server, "--give-up-s", "1")
        self.contact(station)
        server.kill(signal.SIGSTOP)
        self.assertTrue(simulator.says("is up again"), simulator.text)
        station.kill(signal.SIGKILL)
        server.kill(signal.SIGCONT)
        time.sleep(2)
        peaks = self.peaks_nn(simulator)
        self.assertEqual(len(peaks), 1, simulator.text)
        server.kill(signal.SIGTERM)
        server.process.wait(LONG_S)
        self.ends_up(simulator)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[5:], verbosity=2)
