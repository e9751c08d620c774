"""The real telenano-afm-sim, by a client that was written from the protocol's tables alone."""
import os
import re
import socket
import struct
import subprocess
import time
import unittest

import nanonis

OFF, ON, SWITCHING_OFF, SAFE_TIP, WITHDRAWING = 1, 2, 4, 5, 6
DEFLECTION, LATERAL = 8, 9


class Simulator:
    def __init__(self, *flags):
        self.process = subprocess.Popen([os.environ["TELENANO_AFM_SIM"], "--ports", "0,0,0,0", *flags],
                                        stderr=subprocess.PIPE, text=True)
        line = self.process.stderr.readline()
        self.ports = [int(p) for p in re.findall(r"127\.0\.0\.1:(\d+)", line)]
        assert len(self.ports) == 4, line

    def client(self, role=0):
        return nanonis.Client("127.0.0.1", self.ports[role])

    def stop(self):
        self.process.terminate()
        text = self.process.stderr.read()
        self.process.stderr.close()
        assert self.process.wait(10) == 0
        return text


class AfmSim(unittest.TestCase):
    def setUp(self):
        self.flags = getattr(self, self._testMethodName).__dict__.get("flags", [])
        self.simulator = Simulator(*self.flags)
        self.clients = []

    def tearDown(self):
        for client in self.clients:
            client.close()
        self.simulator.stop()

    def client(self, role=0):
        self.clients.append(self.simulator.client(role))
        return self.clients[-1]

    def engage(self, client):
        client.call("ZCtrl.OnOffSet", 1)
        for _ in range(200):
            time.sleep(0.05)
            before = client.call("ZCtrl.ZPosGet")
            time.sleep(0.02)
            if client.call("ZCtrl.ZPosGet") > before - 0.2e-9 and before < 0.4e-6:
                return
        self.fail("no surface")

    def test_a_session_by_hand(self):
        c = self.client()
        names = c.call("Signals.NamesGet")
        self.assertEqual(names[DEFLECTION], "Deflection (m)")
        self.assertEqual(len(c.call("Piezo.RangeGet")), 3)
        self.assertEqual(c.call("ZCtrl.StatusGet"), OFF)
        free = c.call("Signals.ValGet", DEFLECTION, 1)
        self.engage(c)
        self.assertEqual(c.call("ZCtrl.OnOffGet"), 1)
        pressed = c.call("Signals.ValGet", DEFLECTION, 1)
        self.assertAlmostEqual((pressed - free) * 40 * 1e9, 15, delta=5)  # the set point, 40 N/m
        with self.assertRaises(nanonis.NanonisError):
            c.call("ZCtrl.ZPosSet", 0.0)
        c.call("ZCtrl.TipLiftSet", 30e-9)
        z = c.call("ZCtrl.ZPosGet")
        c.call("ZCtrl.OnOffSet", 0)
        while c.call("ZCtrl.OnOffGet") == 1:
            time.sleep(0.005)
        self.assertAlmostEqual(c.call("ZCtrl.ZPosGet"), z + 30e-9, delta=2e-9)
        c.call("ZCtrl.ZPosSet", z + 10e-9)
        self.assertAlmostEqual(c.call("ZCtrl.ZPosGet"), z + 10e-9, delta=1e-13)
        c.call("FolMe.SpeedSet", 1e-6, 1)
        c.call("FolMe.XYPosSet", 100e-9, -50e-9, 1)
        for got, wanted in zip(c.call("FolMe.XYPosGet", 1), [100e-9, -50e-9], strict=True):
            self.assertAlmostEqual(got, wanted, delta=1e-15)
        values = c.call("Signals.ValsGet", [DEFLECTION, LATERAL], 0)
        self.assertEqual(len(values), 2)
        c.call("ZCtrl.Withdraw", 1, -1)
        self.assertEqual(c.call("ZCtrl.StatusGet"), OFF)
        self.assertAlmostEqual(c.call("ZCtrl.ZPosGet"), 0.5e-6, delta=1e-12)

    def test_errors_and_strangers(self):
        c = self.client()
        with self.assertRaisesRegex(nanonis.NanonisError, "no signal"):
            c.call("Signals.ValGet", 99, 0)
        c.socket.sendall(nanonis.frame("Scan.Action", b"", 1))
        header = c.read(40)
        self.assertEqual(header[:11], b"Scan.Action")
        body = c.read(struct.unpack(">i", header[32:36])[0])
        self.assertNotEqual(struct.unpack(">I", body[:4])[0], 0)
        self.assertEqual(c.call("ZCtrl.StatusGet"), OFF, "the connection goes on")
        second = self.client()
        with self.assertRaises((nanonis.NanonisError, OSError)):
            second.call("ZCtrl.StatusGet")  # one client a port
        noise = self.client(1)
        noise.socket.sendall(b"GET / HTTP/1.1\r\n" * 10)
        with self.assertRaises((nanonis.NanonisError, OSError)):
            noise.read(1)  # closed

    def test_error_replies_alone(self):
        c = self.client()
        with self.assertRaisesRegex(nanonis.NanonisError, "no signal"):
            c.call("Signals.CalibrGet", 99)

    test_error_replies_alone.flags = ["--error-alone"]

    def test_silence_and_slowness(self):
        c = self.client()
        time.sleep(0.3)
        begin = time.monotonic()
        c.call("ZCtrl.StatusGet")
        self.assertGreater(time.monotonic() - begin, 0.4)

    test_silence_and_slowness.flags = ["--fault", "@200ms silent 800ms"]

    def test_without_a_reply(self):
        c = self.client()
        c.socket.sendall(nanonis.frame("ZCtrl.TipLiftSet", struct.pack(">f", 1e-8), 0))
        self.assertEqual(c.call("ZCtrl.StatusGet"), OFF)  # the next reply is that of the next request

    def cpu_seconds(self):
        with open(f"/proc/{self.simulator.process.pid}/stat", encoding="ascii") as file:
            fields = file.read().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def test_who_leaves_in_the_middle_of_a_read_costs_nothing(self):
        for port in range(4):
            c = self.simulator.client(port)
            c.call("Util.AcqPeriodSet", 0.5)
            # The average of the period after the next: it comes in 0.5 to 1 s.
            c.socket.sendall(nanonis.request("Signals.ValGet", DEFLECTION, 1))
            time.sleep(0.1)
            c.close()
        time.sleep(1.2)
        before, own = self.cpu_seconds(), time.process_time()
        while time.process_time() < own + 1:  # beside other work a loop that spins gets as much of the cores as this one
            pass
        self.assertLess(self.cpu_seconds() - before, 0.3)

    def test_who_reconnects_at_once_is_served(self):
        served = 0
        for turn in range(300):
            c = self.simulator.client()
            try:
                c.call("ZCtrl.StatusGet")
                served += 1
                if turn % 3 == 0:
                    c.socket.sendall(nanonis.request("Signals.ValGet", DEFLECTION, 1))  # and leaves in the middle of it
            except (nanonis.NanonisError, OSError):
                pass
            c.close()
        self.assertEqual(served, 300)


class Flags(unittest.TestCase):
    def test_what_is_refused(self):
        for flags in (["--ports", "1-2"], ["--fault", "loud 1s"], ["--scene", "/none.toml"], ["--z-sign", "0"]):
            done = subprocess.run([os.environ["TELENANO_AFM_SIM"], *flags], capture_output=True, text=True, timeout=20)
            self.assertEqual(done.returncode, 2, flags)
            self.assertEqual(len(done.stderr.strip().splitlines()), 1, done.stderr)


if __name__ == "__main__":
    unittest.main()
