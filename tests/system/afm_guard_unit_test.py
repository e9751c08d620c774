"""The guard of an AFM's tip in a unit of its own: the units agree with each other, and a server that is killed together with
every process that it has started leaves a guard behind that withdraws the tip. systemd-socket-activate stands in for systemd."""
import os
import pathlib
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest

SOURCE, NVE, SIM = pathlib.Path(sys.argv.pop(1)), sys.argv.pop(1), sys.argv.pop(1)
UNITS = SOURCE / "deploy" / "systemd"
LONG_S = 60


def settings(name):
    """Every key's values in their order."""
    found = {}
    for key, value in re.findall(r"^(\w+)=(.*)$", (UNITS / name).read_text(), re.M):
        found.setdefault(key, []).append(value)
    return found


def children(pid):
    """Of a process and of theirs."""
    found = []
    for child in pathlib.Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        found += [int(child)] + children(int(child))
    return found


class Units(unittest.TestCase):
    def test_the_server_calls_the_socket_that_starts_a_guard(self):
        server, listens = settings("telenano-nve.service"), settings("telenano-nve-afm-guard.socket")
        guard = settings("telenano-nve-afm-guard@.service")
        self.assertIn(f"TELENANO_AFM_GUARD={listens['ListenStream'][0]}", server["Environment"])
        for key in ("After", "Wants"):
            self.assertIn("telenano-nve-afm-guard.socket", server[key][0].split())
        self.assertEqual(listens["Accept"], ["yes"], "a process, unit and control group for each server")
        self.assertEqual((listens["SocketUser"], listens["SocketMode"]), (server["User"], ["0600"]), "only the server may call it")
        self.assertEqual(guard["ExecStart"], ["/usr/bin/telenano-nve afm-guard --from-server"])
        self.assertEqual((guard["StandardInput"], guard["User"]), (["socket"], server["User"]))

    def test_nothing_that_ends_the_server_ends_the_guard(self):
        for name in ("telenano-nve-afm-guard@.service", "telenano-nve-afm-guard.socket"):
            for key in ("PartOf", "BindsTo", "Requires", "Requisite", "Slice", "Conflicts"):
                self.assertNotIn(key, settings(name), name)
        self.assertNotIn("RuntimeMaxSec", settings("telenano-nve-afm-guard@.service"))

    def test_they_are_packaged(self):
        text = (SOURCE / "deploy" / "packaging" / "packages.cmake").read_text()
        for name in ("telenano-nve-afm-guard.socket", "telenano-nve-afm-guard@.service"):
            self.assertIn(f"deploy/systemd/{name}", text)

    @unittest.skipUnless(shutil.which("systemd-analyze"), "no systemd-analyze here")
    def test_systemd_reads_them(self):
        with tempfile.TemporaryDirectory() as folder:
            for unit in UNITS.glob("telenano-nve*"):
                text = unit.read_text().replace("/usr/bin/telenano-nve", NVE)
                (pathlib.Path(folder) / unit.name).write_text(text)
            for name in ("telenano-nve-afm-guard.socket", "telenano-nve-afm-guard@1.service"):
                answer = subprocess.run(["systemd-analyze", "verify", "--man=no", name], cwd=folder, capture_output=True, text=True,
                                        env=os.environ | {"SYSTEMD_UNIT_PATH": f"{folder}:"})
                ours = [line for line in answer.stderr.splitlines() if "telenano" in line]
                self.assertEqual(ours, [])


@unittest.skipUnless(shutil.which("systemd-socket-activate"), "no systemd-socket-activate here")
class Behaviour(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="telenano_guard_"))
        self.started = []
        text = (SOURCE / "deploy" / "afm.toml").read_text()
        # The patience that a machine with many programs needs: no real-time promise here.
        text = text.replace("link_loss_ms = 100.0", "link_loss_ms = 3000.0")
        text = text.replace("reply_timeout_ms = 100.0", "stale_force_ms = 3000.0\nreply_timeout_ms = 3000.0")
        (self.folder / "afm.toml").write_text(text)
        self.sim = self.start("sim", [SIM, "--ports", "0,0,0,0"])
        ports = re.findall(r"127\.0\.0\.1:(\d+)", self.said("sim", r"127\.0\.0\.1:\d+.*\n"))
        self.serve = [NVE, "serve", "--listen", "127.0.0.1:0", "--slave", "nanonis", "--controller", "127.0.0.1",
                      "--ports", ",".join(ports[:4]), "--afm", self.folder / "afm.toml", "--without-deadman",
                      "--afm-state", self.folder]
        self.socket = self.folder / "guard.sock"

    def tearDown(self):
        for process in reversed(self.started):
            if process.poll() is None:
                for pid in children(process.pid):
                    os.kill(pid, signal.SIGKILL)
                process.kill()
            process.wait()
        shutil.rmtree(self.folder)

    def start(self, name, command, **environment):
        with open(self.folder / name, "w") as err:
            self.started.append(subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=err, stderr=err,
                                                 env=os.environ | {k: str(v) for k, v in environment.items()}))
        return self.started[-1]

    def said(self, name, pattern):
        end = time.monotonic() + LONG_S
        while time.monotonic() < end:
            text = (self.folder / name).read_text()
            if re.search(pattern, text):
                return text
            time.sleep(0.01)
        self.fail(f"{name} has not said '{pattern}': {text}")

    def end_of_sim(self):
        self.sim.terminate()
        self.sim.wait(LONG_S)
        return (self.folder / "sim").read_text().splitlines()[-1]

    def test_a_server_killed_with_all_its_processes_leaves_a_guard_that_withdraws(self):
        unit = self.start("unit", ["systemd-socket-activate", "--accept", "--inetd", "-l", self.socket,
                                   NVE, "afm-guard", "--from-server"])
        self.said("unit", "Listening on")
        server = self.start("server", self.serve, TELENANO_AFM_GUARD=self.socket)
        self.said("server", "surface found")
        killed = [server.pid] + children(server.pid)
        self.assertEqual(len(children(unit.pid)), 1, "the guard is the unit's")
        for pid in killed:  # as what kills a whole control group does
            os.kill(pid, signal.SIGKILL)
        self.said("unit", "afm-guard: the tip is withdrawn")
        self.assertIn("tip withdrawn", self.end_of_sim())

    def test_without_a_guard_to_call_the_server_does_not_start(self):
        server = self.start("server", self.serve, TELENANO_AFM_GUARD=self.socket)
        self.assertNotEqual(server.wait(LONG_S), 0)
        said = (self.folder / "server").read_text()
        self.assertIn("no guard at " + str(self.socket), said)
        self.assertNotIn("approaching", said)

    def test_who_is_no_server_is_shown_out(self):
        for words in (b"", b"hello\n\n", b"telenano-afm-guard 1\n\n\n\n\n", b"telenano-afm-guard 1\n127.0.0.1:1\n-4\nkey \n\n"):
            ours, its = socket.socketpair()
            with ours, its:
                ours.sendall(words)
                ours.shutdown(socket.SHUT_WR)
                guard = subprocess.run([NVE, "afm-guard", "--from-server"], stdin=its, capture_output=True, timeout=LONG_S)
            self.assertEqual(guard.returncode, 2, words)
            self.assertIn(b"is not a server that wants a guard", guard.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
