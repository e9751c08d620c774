"""The real station at a Python server over loopback: a spring wall; every command held to the document's rules."""
import base64
import hashlib
import math
import os
import pathlib
import re
import subprocess
import tempfile
import threading
import time
import unittest

import telenano_pb2 as pb
from programs import SCENES, Child, now_ns, serve, udp
from server import Server, SpringWall
from wire import BYE_DONE, CLUTCH, DEADMAN, encode, vector

ADDRESS = ("127.0.0.1", 0)
SEEDS = pathlib.Path(os.environ["TELENANO_SOURCE_DIR"]) / "tests" / "fuzz" / "seeds" / "bundle"


class Serving:
    """A server on a socket, in a thread of its own. kill() is the end of the process: nothing is said, nothing kept."""

    def __init__(self, test, address=ADDRESS, **config):
        self.server = Server(**config)
        self.sock = udp(test, address)
        self.address = self.sock.getsockname()
        self.sock.settimeout(0.01)
        self.deaf = self.over = False
        self.error = None
        self.thread = threading.Thread(target=self.loop)
        self.thread.start()
        test.addCleanup(self.kill)

    def loop(self):
        try:
            while not self.over:
                try:
                    datagram, peer = self.sock.recvfrom(2048)
                    if not self.deaf:
                        answer = self.server.on_datagram(datagram, peer, now_ns())
                        if answer is not None:
                            self.sock.sendto(answer, peer)
                except TimeoutError:
                    pass
                if not self.deaf:
                    self.server.poll(now_ns())
        except Exception as error:  # pylint: disable=broad-except
            self.error = error

    def kill(self):
        self.over = True
        self.thread.join()
        self.sock.close()


class StationAtThePythonServer(unittest.TestCase):
    def station(self, serving, *more):
        host, port = serving.address
        return Child(self, os.environ["TELENANO_MASTER"], "run", "--quiet", "--server", f"{host}:{port}", "--rt-priority", "0",
                     *more)

    def ends_well(self, child):
        self.assertEqual(child.wait(), 0, child.said())

    def sessions_of(self, server):
        """{session_id: commands} in the order of their coming, each held to the rules of sections 2, 4 and 5."""
        sessions = {}
        for session_id, command in server.accepted:
            sessions.setdefault(session_id, []).append(command)
        for commands in sessions.values():
            self.assertEqual(commands[0].energy_in_j + commands[0].energy_out_j, 0, "since the Welcome")
            for a, b in zip(commands, commands[1:]):
                self.assertGreater(b.send_time_ns, a.send_time_ns)
                self.assertGreaterEqual(b.newest_reply, a.newest_reply)
                self.assertGreaterEqual(b.energy_in_j, a.energy_in_j)
                self.assertGreaterEqual(b.energy_out_j, a.energy_out_j)
                self.assertEqual(b.flags & ~7, 0)
        return sessions

    def test_a_session_presses_the_wall_and_ends(self):
        serving = Serving(self)
        child = self.station(serving, "--task", "indent", "--duration-s", "3")
        self.ends_well(child)
        time.sleep(0.1)
        server = serving.server
        self.assertIsNone(serving.error)
        (commands,) = self.sessions_of(server).values()
        # Loopback loses nothing; a tick or two of a busy machine may be skipped, never repeated.
        numbers = [c.sequence for c in commands]
        self.assertEqual(numbers, list(range(1, len(numbers) + 1)))
        self.assertGreater(len(numbers), 1000, "of 3000 ticks, on a machine that does other things too")
        self.assertGreater(commands[-1].newest_reply, len(numbers) / 2, "a server in Python is behind on a busy machine")
        self.assertEqual({c.epoch for c in commands}, {server.sessions[0].epoch})
        self.assertEqual(vector(commands[0], "tip_pos_w_{}_nm"), SpringWall.START, "no leap")
        self.assertIn(CLUTCH | DEADMAN, {c.flags for c in commands})
        self.assertLess(min(c.tip_pos_w_z_nm for c in commands), -1, "pressed")
        self.assertTrue(all(math.isfinite(v) for c in commands for v in vector(c, "tip_vel_w_{}_nm_s")))
        # The wall's account closes: it has given back what was put in, up to what it still holds.
        slave = server.sessions[0].slave
        held = slave.force_nn() ** 2 / (2 * slave.k)
        self.assertAlmostEqual(slave.energy_in_aj - slave.energy_out_aj, held, delta=1e-9 * slave.energy_in_aj)
        self.assertGreater(slave.energy_in_aj, 0.5)
        self.assertGreater(commands[-1].energy_in_j, 0)
        # One Hello, one Challenge, one Welcome; Bye, said more than once.
        self.assertEqual(server.challenges, 1)
        self.assertEqual(server.sessions[0].state, "ending")
        self.assertEqual({cause for cause, n in server.drops.items() if n}, {"duplicate"})
        self.assertLessEqual(server.drops["duplicate"], 2)

    def test_the_station_counts_what_is_left_out_and_takes_none_for_lost(self):
        serving = Serving(self, timeout_ms=20_000)
        child = self.station(serving, "--task", "indent", "--duration-s", "3", "--method", "ks-clamp", "--reply-deadband", "100")
        self.ends_well(child)
        self.assertIsNone(serving.error)
        (session,) = serving.server.sessions
        (commands,) = self.sessions_of(serving.server).values()
        asked = [c.reply_relative_permille for c in commands]
        begins = asked.index(100)  # before, the link was measured
        self.assertEqual((set(asked[:begins]) | {0}, set(asked[begins:])), ({0}, {100}))
        self.assertTrue(all(c.reply_floor_pn > 0 for c in commands[begins:]))
        self.assertGreater(session.deadband.left_out, 0.3 * len(commands))
        said = re.search(r"replies left out +(\d+) of (\d+)", child.said())
        self.assertLessEqual(abs(int(said.group(1)) - session.deadband.left_out), 40)
        lost = re.search(r"commands lost or overtaken +(\d+) of (\d+)", child.said())
        self.assertEqual(lost.group(1), "0", child.said())

    def test_a_restarted_server_goes_on_in_a_new_epoch(self):
        first = Serving(self)
        child = self.station(first, "--task", "indent", "--duration-s", "5")
        time.sleep(2.5)
        first.kill()
        time.sleep(0.6)
        second = Serving(self, first.address)
        self.ends_well(child)
        time.sleep(0.1)
        self.assertIsNone(first.error or second.error)
        (before,) = self.sessions_of(first.server).values()
        (after,) = self.sessions_of(second.server).values()
        self.assertGreater(len(before), 500)
        self.assertGreater(len(after), 500)
        self.assertNotEqual(before[0].epoch, after[0].epoch)
        self.assertEqual(after[0].sequence, 1)
        self.assertEqual(vector(after[0], "tip_pos_w_{}_nm"), SpringWall.START, "where the new slave starts")
        self.assertGreaterEqual(second.server.drops["unknown_session"], 1, "commands of the old session")
        self.assertEqual({cause for cause, n in second.server.drops.items() if n} - {"unknown_session", "duplicate"}, set())

    def test_a_deaf_server_is_waited_for_in_the_same_account(self):
        serving = Serving(self, timeout_ms=300)
        child = self.station(serving, "--task", "indent", "--duration-s", "5")
        time.sleep(2)
        serving.deaf = True
        time.sleep(0.8)
        serving.deaf = False
        self.ends_well(child)
        self.assertIsNone(serving.error)
        sessions = list(self.sessions_of(serving.server).values())
        # What was queued during the silence may still belong to the old session; then the token resumes it.
        self.assertIn(len(sessions), (1, 2))
        self.assertEqual(len({commands[0].epoch for commands in sessions}), 1)
        self.assertEqual(len(serving.server.sessions), 1)

    def test_a_server_without_features_is_as_good(self):
        serving = Serving(self, features=0, timeout_ms=20_000)  # a station that a busy machine keeps silent is not what is asked
        self.ends_well(self.station(serving, "--task", "position", "--duration-s", "1"))
        self.assertEqual(serving.server.drops["unexpected"], 0)
        self.assertEqual(serving.server.sessions[0].features, 0)
        self.assertGreater(len(serving.server.accepted), 300)

    def fetching(self, serving, cache, *more):
        """The station's own words, and how many pieces it asked for."""
        host, port = serving.address
        asked = []
        answer = serving.server.on_scene_request
        serving.server.on_scene_request = lambda m, *of: asked.append(m.chunk) or answer(m, *of)
        environment = dict(os.environ, XDG_CACHE_HOME=str(cache))
        done = subprocess.run([os.environ["TELENANO_MASTER"], "run", "--server", f"{host}:{port}", "--rt-priority", "0", "--task",
                               "position", "--duration-s", "1.5", *more], env=environment, capture_output=True, text=True,
                              timeout=60, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIsNone(serving.error)
        self.assertGreater(len(serving.server.accepted), 300, "the session went on")
        warnings = [line for line in done.stderr.splitlines() if "scene" in line and line.startswith("telenano-master: warning:")]
        return asked, warnings, done.stderr

    def test_the_station_fetches_the_scene_once_and_records_it(self):
        with tempfile.TemporaryDirectory() as folder:
            bundles = []
            for recording in (folder + "/one.h5", folder + "/two.h5"):
                child, (host, port) = serve(self, "flat_pdms")
                done = subprocess.run([os.environ["TELENANO_MASTER"], "run", "--server", f"{host}:{port}", "--rt-priority", "0",
                                       "--task", "position", "--duration-s", "1", "--record", recording],
                                      env=dict(os.environ, XDG_CACHE_HOME=folder), capture_output=True, text=True, timeout=60,
                                      check=False)
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertEqual(child.stop(), 0)
                self.assertEqual("pieces of the scene were fetched" in child.said(), not bundles, "only the first time")
                scenes = pathlib.Path(folder, "telenano", "scenes").iterdir()
                (kept,) = (file for file in scenes if "-" not in file.name)  # beside it: what the station found in it
                bundles.append(kept.read_bytes())
                self.assertEqual(hashlib.sha256(bundles[-1]).hexdigest() + ".scene", kept.name)
                self.assertEqual((kept.stat().st_mode & 0o777, kept.parent.stat().st_mode & 0o777), (0o600, 0o700))
                self.assertIn(base64.b64encode(bundles[-1]), pathlib.Path(recording).read_bytes())
            self.assertEqual(bundles[0], bundles[1])
            self.assertIn((SCENES / "flat_pdms.toml").read_bytes(), bundles[0])

    def test_a_hostile_scene_is_one_line_and_the_session_goes_on(self):
        good = (SEEDS / "flat").read_bytes()

        class Liar(Server):
            def welcome(self, session, nonce):
                w = super().welcome(session, nonce)
                self.lie(w)
                return w

        def other_hash(w):
            w.scene_sha256_3 ^= 1

        def huge(w):
            w.scene_bytes = 0xFFFFFFFF

        with tempfile.TemporaryDirectory() as folder:
            for lie, bundle, words in ((other_hash, good, "the announced hash"), (huge, good, "4294967295 bytes"),
                                       (lambda w: None, b"TLNB" + bytes(3000), "form 0"),
                                       (lambda w: None, (SEEDS / "bomb").read_bytes(), "scene bundle: ")):
                serving = Serving(self)
                serving.server = Liar(bundle=bundle)
                serving.server.lie = lie
                _, warnings, said = self.fetching(serving, folder)
                self.assertEqual(len(warnings), 1, said)
                self.assertIn(words, warnings[0])
                self.assertIn("the session goes on without", warnings[0])
            self.assertEqual(list(pathlib.Path(folder).rglob("*.scene")), [])

    def test_refusals_end_the_program_with_one_line(self):
        for config, word in ((dict(rate_max_hz=500), "500|rate"), (dict(capacity=0), "full|sessions")):
            serving = Serving(self, **config)
            child = self.station(serving, "--duration-s", "1")
            self.assertEqual(child.wait(), 1, child.said())
            self.assertEqual(len(child.lines), 1, child.said())
            self.assertRegex(child.said(), word)
            self.assertIsNone(serving.error)

    def test_a_bye_done_of_the_server_is_final(self):
        serving = Serving(self)
        child = self.station(serving, "--duration-s", "20", "--give-up-s", "1")
        time.sleep(1.5)
        session = serving.server.sessions[0]
        serving.sock.sendto(encode(pb.Bye(session_id=session.session_id, reason=BYE_DONE)), session.address)
        time.sleep(0.3)
        accepted, challenges = len(serving.server.accepted), serving.server.challenges
        self.assertEqual(child.wait(), 1, child.said())
        self.assertEqual(len(serving.server.accepted), accepted, "no command after it")
        self.assertEqual((challenges, serving.server.challenges), (1, 1), "nor a Hello")


if __name__ == "__main__":
    unittest.main()
