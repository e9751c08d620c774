"""A Python station at the real server over loopback: every reply held to the document's rules."""
import math
import struct
import time
import tomllib
import unittest

import telenano_pb2 as pb
from programs import SCENES, counted, now_ns, serve, udp
from rules import ReplyDeadband
from station import Station
from wire import (CLUTCH, DEADMAN, FAULT_RETRACTED, FEATURE_LOCAL_MODEL, FEATURE_PORT_CONTROL, FEATURE_REDUNDANCY, FEATURE_REPLY_DEADBAND,
                  FAULT_UNDO, FEATURE_SHARED_LOG, FEATURE_STEP_LOG, FEATURE_UNDO, UNDO,
                  FEATURE_PARTICLE, FEATURE_SCENE, FEATURE_SHARING, KNOWN_FEATURES, RECENT, TAKE_OVER, Drop, decode, encode, features_used, vector)

RATE_HZ = 200
ALL = KNOWN_FEATURES & ~(FEATURE_SHARING | FEATURE_PARTICLE)  # of a server with private tips and no particle


class Client:
    """A station on a socket; keeps commanded positions and accepted replies."""

    def __init__(self, test, server, **config):
        self.test, self.server = test, server
        self.sock = udp(test)
        self.station = Station(rate_hz=RATE_HZ, **config)
        self.commanded = {}  # position and time by sequence
        self.replies = []

    def receive(self, timeout_s):
        """Everything that comes within that time goes to the station; the accepted messages."""
        end = time.monotonic() + timeout_s
        accepted = []
        while True:
            self.sock.settimeout(max(end - time.monotonic(), 1e-6))
            try:
                datagram = self.sock.recv(2048)
            except (TimeoutError, BlockingIOError):
                return accepted
            message = self.station.on_datagram(datagram, now_ns())
            if isinstance(message, pb.Reply):
                self.check(message)
            if message is not None:
                accepted.append(message)

    def send(self, datagram):
        if datagram is not None:
            self.sock.sendto(datagram, self.server)

    def connect(self):
        if self.station.state == "idle":
            self.station.start(now_ns())
        for _ in range(1000):
            self.send(self.station.poll(now_ns()))
            self.receive(0.005)
            if self.station.state == "established":
                return self.station.welcome
        raise AssertionError(self.station.state)

    def tick(self, position, **more):
        at = now_ns()
        self.send(self.station.poll(at))
        datagram = self.station.command(at, position, **more)
        if datagram is not None:
            self.commanded[self.station.sent] = (position, at)
            self.send(datagram)

    def run(self, path, duration_s, **more):
        """Commands at RATE_HZ along path(seconds)."""
        start = time.monotonic()
        for k in range(int(duration_s * RATE_HZ)):
            self.tick(path(k / RATE_HZ), **more)
            self.receive(max(start + (k + 1) / RATE_HZ - time.monotonic(), 0))
        self.receive(0.1)

    def check(self, r):
        """What sections 2, 4 and 5 say about a reply beyond what makes the station drop it."""
        t, w, now = self.test, self.station.welcome, now_ns()
        position, sent_ns = self.commanded[r.command_sequence]
        t.assertEqual(r.command_send_time_ns, sent_ns)
        t.assertLessEqual(r.hold_time_ns, now - sent_ns)
        t.assertEqual(r.measurement_age_ns, 0, "computed for this command")
        t.assertEqual(r.fault_bits & ~0xBF, 0)
        t.assertTrue(all(map(math.isfinite, vector(r, "force_w_{}_nn"))))
        t.assertLessEqual(math.hypot(*vector(r, "force_w_{}_nn")), w.force_max_nn * 1.01)
        if self.replies and self.replies[-1].session_id == r.session_id:
            last = self.replies[-1]
            t.assertGreater(r.command_sequence, last.command_sequence)
            t.assertGreater(r.server_time_ns, last.server_time_ns)
        if self.replies and self.replies[-1].epoch == r.epoch:
            t.assertGreaterEqual(r.energy_in_aj, self.replies[-1].energy_in_aj)
            t.assertGreaterEqual(r.energy_out_aj, self.replies[-1].energy_out_aj)
        self.replies.append(r)


def indent(start, depth_nm, duration_s):
    """From the start down to `depth_nm` below the surface and back."""
    x, y, top = start
    return lambda t: (x, y, top - (top + depth_nm) * 0.5 * (1 - math.cos(2 * math.pi * t / duration_s)))


def hello(nonce, cookie=0, **more):
    return encode(pb.Hello(**{**dict(version_min=1, version_max=1, nonce=nonce, cookie=cookie, rate_hz=RATE_HZ), **more}))


class StationAtTheServer(unittest.TestCase):
    def setUp(self):
        self.start_server("--timeout-ms", "5000")  # a test that waits for silence on a busy machine is not silent itself

    def start_server(self, *more):
        self.child, self.server = serve(self, "flat_pdms", *more)

    def end(self):
        self.assertEqual(self.child.stop(), 0, self.child.said())
        return self.child.said()

    def ask(self, sock, datagram, timeout_s=0.3):
        """The answer to one datagram; None if there is none."""
        sock.sendto(datagram, self.server)
        sock.settimeout(timeout_s)
        try:
            answer = sock.recv(2048)
        except TimeoutError:
            return None
        self.assertLessEqual(len(answer), max(len(datagram), 419))
        return decode(answer)

    def test_a_session_indents_and_every_reply_keeps_the_rules(self):
        client = Client(self, self.server)
        w = client.connect()
        self.assertEqual((w.version, w.feature_bits & ~ALL, w.scene_name), (1, 0, b"flat_pdms"))
        start = vector(w, "start_pos_w_{}_nm")
        self.assertEqual(start, (0, 0, 20))
        client.run(indent(start, 8, 2.5), 2.5)
        self.assertEqual(len(client.replies), 500, "loopback loses nothing")
        self.assertEqual([r.sequence for r in client.replies], list(range(1, 501)))
        self.assertEqual([r.command_sequence for r in client.replies], list(range(1, 501)))
        self.assertEqual({r.contact_state for r in client.replies} & {1, 3}, {1, 3}, "attracted, pressed")
        self.assertTrue(all(r.fault_bits == 0 for r in client.replies))
        # Energy put in is the work at the commanded end, −∫F·dx. The trapezium rule errs by at most ½|ΔF||Δx| a step where
        # the force does not leave the range between its ends.
        work = bound = 0.0
        for a, b in zip(client.replies, client.replies[1:]):
            dz = client.commanded[b.command_sequence][0][2] - client.commanded[a.command_sequence][0][2]
            work -= 0.5 * (a.force_w_z_nn + b.force_w_z_nn) * dz
            bound += 0.5 * abs(b.force_w_z_nn - a.force_w_z_nn) * abs(dz)
            first, last = client.replies[0], b
            account = (last.energy_in_aj - last.energy_out_aj) - (first.energy_in_aj - first.energy_out_aj)
            self.assertLess(abs(account - work), bound + 1e-6)
        self.assertGreater(client.replies[-1].energy_in_aj, 50)
        self.assertLess(bound, 0.1 * client.replies[-1].energy_in_aj, "or the comparison above says little")
        # Back at the start, where as much is stored as before: what came out went in, and snap-in and pull-off cost.
        self.assertGreater(work, bound)
        self.assertEqual(sum(client.station.drops.values()), 0)
        self.assertLess(client.station.times.srtt_ns, 20e6)
        self.assertLess(abs(client.station.times.offset_ns()), 20e6, "one machine, one monotonic clock")
        client.send(client.station.end())
        time.sleep(0.2)  # or the server, told to stop, ends the session first, and this Bye is a second one
        self.assertIn("500 exchanges in 1 sessions (0 resumed); dropped: none", self.end())

    def test_cookies(self):
        mine, other = udp(self), udp(self)
        challenge = self.ask(mine, hello(7))
        self.assertEqual((type(challenge), challenge.nonce), (pb.Challenge, 7))
        for sock, nonce, cookie in ((mine, 7, challenge.cookie ^ 1), (other, 7, challenge.cookie), (mine, 8, challenge.cookie)):
            answer = self.ask(sock, hello(nonce, cookie))
            self.assertEqual((type(answer), answer.nonce), (pb.Challenge, nonce), "not a session")
        welcome = self.ask(mine, hello(7, challenge.cookie))
        self.assertIsInstance(welcome, pb.Welcome)
        self.assertEqual(self.ask(mine, hello(7, challenge.cookie)), welcome, "the first was lost: the same again")
        self.assertEqual(counted(self.end()), {"unauthenticated": 3})

    def test_refusals_and_features(self):
        sock = udp(self)
        refuse = self.ask(sock, hello(1, version_min=2, version_max=9))
        self.assertEqual((refuse.nonce, refuse.reason, refuse.version_min, refuse.version_max), (1, 1, 1, 1))
        cookie = self.ask(sock, hello(2, rate_hz=8001)).cookie
        refuse = self.ask(sock, hello(2, cookie, rate_hz=8001))
        self.assertEqual((refuse.nonce, refuse.reason), (2, 3))
        for nonce, asked in enumerate((0, 1, 2, 3, 7, 1 << 63 | 1), start=10):
            cookie = self.ask(sock, hello(nonce)).cookie
            welcome = self.ask(sock, hello(nonce, cookie, feature_bits=asked))
            self.assertEqual(welcome.feature_bits, asked & ALL, "what there is, and no shared tip")
        self.assertEqual(counted(self.end()), {"wrong_version": 1, "out_of_range": 1})

    def test_a_particle_is_told_where_there_is_one(self):
        child, self.server = serve(self, "particle", "--timeout-ms", "5000")
        client = Client(self, self.server)
        w = client.connect()
        self.assertEqual(w.feature_bits, ALL | FEATURE_PARTICLE)
        x, y, top = vector(w, "start_pos_w_{}_nm")

        def push(t):  # down to 10 nm in the first second, then along x into it
            return (x + 25 * max(t - 1, 0), y, top - 30 * min(t, 1))

        client.run(push, 3.0)
        first, last = client.replies[0], client.replies[-1]
        self.assertEqual({r.particle_radius_nm for r in client.replies}, {30})
        self.assertLess(math.dist(vector(first, "particle_pos_w_{}_nm"), (60, 0, 30)), 2, "of the scene; it sinks in a little")
        self.assertEqual((first.particle_state, last.particle_state), (0, 1))
        self.assertGreater(last.particle_pos_w_x_nm, 80)
        self.assertEqual(sum(client.station.drops.values()), 0)
        plain = Client(self, self.server, features=ALL)
        self.assertEqual(plain.connect().feature_bits, ALL)
        plain.run(push, 0.1)
        self.assertEqual({features_used(r) & FEATURE_PARTICLE for r in plain.replies}, {0})
        self.assertEqual(child.stop(), 0, child.said())

    def test_fields_of_features(self):
        for features, answered in ((ALL, True), (FEATURE_LOCAL_MODEL, False)):
            client = Client(self, self.server, features=features)
            w = client.connect()
            command = pb.Command(session_id=w.session_id, sequence=1, epoch=w.epoch, flags=3, method=5,
                                 energy_scale_aj_j=1e17, tip_pos_w_z_nm=20)
            answer = self.ask(client.sock, encode(command))
            self.assertEqual(isinstance(answer, pb.Reply), answered)
        self.assertEqual(counted(self.end()), {"unexpected": 1})

    def answered(self, deadband):
        """Commands and replies of two seconds of indentation at 1 kHz by the commands' own times; None where the server was
        behind, so that the motion is not what the commands say."""
        client = Client(self, self.server, features=FEATURE_REPLY_DEADBAND)
        client.station.rate_hz = 1000
        start = vector(client.connect(), "start_pos_w_{}_nm")
        path, begun_ns = indent(start, 8, 2.0), now_ns()
        commands = {}
        for k in range(2000):
            at = begun_ns - 3_000_000_000 + k * 1_000_000
            datagram = client.station.command(at, path(1e-3 * k), **deadband)
            commands[client.station.sent] = decode(datagram)
            client.commanded[client.station.sent] = (path(1e-3 * k), at)
            client.send(datagram)
            client.receive(max(begun_ns + (k + 1) * 1_000_000 - now_ns(), 0) * 1e-9)
        client.receive(0.2)
        client.send(client.station.end())
        self.assertEqual(sum(client.station.drops.values()), 0)
        return None if any(r.fault_bits & 0x80 for r in client.replies) else (commands, client.replies, client.station)

    def test_replies_are_left_out_by_the_documents_rule(self):
        for _ in range(5):
            every = self.answered({})
            some = every and self.answered({"reply_floor_pn": 200, "reply_relative_permille": 100})
            if some:
                break
        self.assertIsNotNone(some, "the server was behind in each of five tries")
        # The same motion is the same force: the rule, over all of its replies, says which ones the server leaves out.
        commands, replies, station = some
        self.assertEqual([r.command_sequence for r in every[1]], list(range(1, 2001)))
        rule = ReplyDeadband()
        expected, left_out = [], []
        for whole in every[1]:
            if not rule.leaves_out(commands[whole.command_sequence], whole, 1_000_000):
                expected.append(whole.command_sequence)
                left_out.append(rule.left_out)
        self.assertEqual([r.command_sequence for r in replies], expected)
        self.assertEqual([r.replies_left_out for r in replies], left_out)
        self.assertLess(len(replies), 900)
        self.assertEqual([r.sequence for r in replies], list(range(1, len(replies) + 1)))
        of = {r.command_sequence: r for r in every[1]}
        for r in replies:
            self.assertEqual((r.force_w_z_nn, r.energy_in_aj, r.energy_out_aj),
                             tuple(getattr(of[r.command_sequence], name) for name in ("force_w_z_nn", "energy_in_aj", "energy_out_aj")))
        self.assertEqual(station.commands_not_accepted(), 0)

    def test_repeated_commands_are_played_once(self):
        client = Client(self, self.server, features=FEATURE_REDUNDANCY)
        w = client.connect()

        def command(sequence, repeats):
            records = b"".join(RECENT.pack(1_000_000 * k, 3, 0.0, 0.0, 20.0, 0.0, 0.0, 0.0, 0.0) for k in range(1, repeats + 1))
            return self.ask(client.sock, encode(pb.Command(
                session_id=w.session_id, sequence=sequence, send_time_ns=sequence * 1_000_000, epoch=w.epoch, flags=3,
                tip_pos_w_z_nm=20, recent_commands=records)))

        self.assertEqual(command(1, 0).sequence, 1)
        self.assertEqual(command(2, 1).sequence, 2, "nothing is missing")
        self.assertEqual(command(5, 4).sequence, 3, "3 and 4; one reply a datagram")
        self.assertEqual(command(12, 4).sequence, 4, "8 to 11; 6 and 7 are lost for good")
        self.assertIn("6 lost commands were repeated in time", self.end())

    def test_what_is_late_repeated_or_not_ours_is_dropped(self):
        client = Client(self, self.server)
        w = client.connect()
        other = udp(self)

        def command(sequence, sock=client.sock, **changes):
            message = pb.Command(session_id=w.session_id, sequence=sequence, send_time_ns=sequence * 5_000_000, epoch=w.epoch,
                                 flags=3, tip_pos_w_z_nm=20)
            for name, value in changes.items():
                setattr(message, name, value)
            return self.ask(sock, encode(message), 0.1)

        self.assertEqual(command(10).sequence, 1)
        self.assertIsNone(command(10), "duplicate")
        self.assertIsNone(command(5), "stale")
        self.assertIsNone(command(5), "duplicate of a stale one")
        self.assertIsNone(command(10 + (1 << 12)), "a leap: 200 Hz for less than ten seconds")
        self.assertIsNone(command(11, epoch=w.epoch ^ 1), "another account")
        self.assertIsNone(command(11, newest_reply=2), "a reply that was never sent")
        self.assertIsNone(command(11, sock=other), "another address")
        bye = command(11, session_id=w.session_id ^ (1 << 40))
        self.assertEqual((type(bye), bye.reason, bye.session_id), (pb.Bye, 5, w.session_id ^ (1 << 40)))
        self.assertEqual(command(11, newest_reply=1).sequence, 2, "none of them did harm")
        self.assertEqual(command(11 + 64 + 250).sequence, 3, "the largest leap that needs no time")
        self.assertEqual(counted(self.end()), {"duplicate": 2, "stale": 1, "out_of_range": 2, "wrong_epoch": 1,
                                               "unauthenticated": 1, "unknown_session": 1})

    def test_silence_retracts_and_the_token_resumes(self):
        self.start_server()
        client = Client(self, self.server)
        first = client.connect()
        self.assertEqual(first.timeout_ms, 500, "of the scene")
        start = vector(first, "start_pos_w_{}_nm")
        down = indent(start, 8, 2.0)
        client.run(down, 1.0)  # half of the way: pressed
        pressed = client.replies[-1]
        self.assertEqual(pressed.contact_state, 3)
        time.sleep(0.8)
        client.tick(down(1.0))
        byes = [m for m in client.receive(0.2) if isinstance(m, pb.Bye)]
        self.assertEqual([(b.reason, b.session_id) for b in byes], [(2, first.session_id)], "idle")
        self.assertEqual((client.station.state, client.station.alive), ("lost", False))
        second = client.connect()
        self.assertNotEqual(second.session_id, first.session_id)
        self.assertEqual((second.epoch, second.resume_token), (first.epoch, first.resume_token))
        held = vector(second, "start_pos_w_{}_nm")
        self.assertGreater(held[2], down(1.0)[2] + 10, "it has withdrawn, 1000 nm/s")
        client.run(lambda t: held, 0.2)
        resumed = client.replies[-1]
        self.assertEqual(resumed.fault_bits & FAULT_RETRACTED, 0, "it follows again")
        self.assertNotEqual(resumed.contact_state, 3)
        self.assertGreaterEqual(resumed.energy_in_aj, pressed.energy_in_aj, "one account")
        # From another address while it is active: it roams, and the old address and id are unknown.
        roaming = Client(self, self.server, token=second.resume_token)
        third = roaming.connect()
        self.assertEqual((third.epoch, third.resume_token), (first.epoch, first.resume_token))
        self.assertEqual(vector(third, "start_pos_w_{}_nm"), held, "what the slave holds")
        roaming.run(lambda t: held, 0.2)
        self.assertGreaterEqual(roaming.replies[-1].energy_in_aj, resumed.energy_in_aj)
        client.tick(held)
        self.assertEqual([m.reason for m in client.receive(0.2) if isinstance(m, pb.Bye)], [5])
        said = self.end()
        self.assertIn("(2 resumed)", said)
        self.assertEqual(counted(said), {"unexpected": 1, "unknown_session": 1})

    def test_after_a_bye_the_token_is_worth_nothing(self):
        client = Client(self, self.server)
        first = client.connect()
        client.run(lambda t: (0, 0, 20), 0.1)
        for _ in range(3):
            client.send(client.station.end())
        again = Client(self, self.server, token=first.resume_token)
        second = again.connect()
        self.assertNotEqual(second.epoch, first.epoch)
        self.assertNotEqual(second.resume_token, first.resume_token)
        late = pb.Command(session_id=first.session_id, sequence=1000, epoch=first.epoch)
        self.assertIsNone(self.ask(client.sock, encode(late)), "ending: not answered")
        time.sleep(2.2)
        self.assertEqual(self.ask(client.sock, encode(late)).reason, 5, "its slot is free")
        self.assertEqual(counted(self.end()), {"duplicate": 2, "unexpected": 1, "unknown_session": 1})

    def test_shutting_down_says_bye(self):
        client = Client(self, self.server)
        client.connect()
        client.run(lambda t: (0, 0, 20), 0.1)
        self.end()
        self.assertEqual([m.reason for m in client.receive(0.2) if isinstance(m, pb.Bye)], [3], "the others are late")
        self.assertEqual((client.station.state, client.station.alive), ("lost", False))
        self.assertEqual(client.station.drops["unexpected"], 2, "it is said three times")

    def test_fetches_the_scene_and_finds_what_the_document_says_in_it(self):
        client = Client(self, self.server)
        w = client.connect()
        self.assertTrue(w.feature_bits & FEATURE_SCENE)
        for _ in range(400):
            client.tick(vector(w, "start_pos_w_{}_nm"))
            for datagram in client.station.scene_requests(now_ns()):
                client.send(datagram)
            client.receive(1 / RATE_HZ)
            if client.station.scene() is not None:
                break
        bundle = client.station.scene()  # its hash is looked at there
        self.assertEqual(bundle[:4], b"TLNB")
        form, _, count = struct.unpack_from("<3I", bundle, 4)
        at, entries = 16, {}
        for _ in range(count):
            name = bundle[at + 1:at + 1 + bundle[at]].decode()
            at += 1 + bundle[at]
            size, = struct.unpack_from("<I", bundle, at)
            entries[name], at = bundle[at + 4:at + 4 + size], at + 4 + size
        self.assertEqual((form, at, sorted(entries)), (1, len(bundle), ["scene.toml", "values"]))
        self.assertEqual(entries["scene.toml"], (SCENES / "flat_pdms.toml").read_bytes())
        values, at = {}, 4
        for _ in range(struct.unpack_from("<I", entries["values"])[0]):
            kind, length = entries["values"][at:at + 2]
            path, at = entries["values"][at + 2:at + 2 + length].decode(), at + 2 + length
            size = {0: 0, 1: 1, 2: 8, 3: 8}.get(kind)
            if size is None:
                size, at = struct.unpack_from("<H", entries["values"], at)[0], at + 2
            data, at = entries["values"][at:at + size], at + size
            values[path] = {0: dict, 1: lambda d: bool(d[0]), 2: lambda d: struct.unpack("<q", d)[0],
                            3: lambda d: struct.unpack("<d", d)[0], 4: bytes.decode}[kind](*([data] if kind else []))
        self.assertEqual(at, len(entries["values"]))
        # The document's own example of what the numbers are: those of the text.
        with open(SCENES / "flat_pdms.toml", "rb") as file:
            said = tomllib.load(file)

        def flat(table, before=""):
            for key, value in table.items():
                if isinstance(value, dict) and value:
                    yield from flat(value, before + key + ".")
                else:
                    yield before + key, value

        self.assertEqual(values, dict(flat(said)))
        self.assertEqual(list(values), sorted(values))
        client.send(client.station.end())
        self.assertEqual(self.child.stop(), 0, self.child.said())
        self.assertIn("pieces of the scene were fetched", self.child.said())

    def test_a_server_told_not_to_share_its_scene_does_not(self):
        self.child.stop()
        self.start_server("--no-scene-sharing")
        client = Client(self, self.server)
        w = client.connect()
        self.assertEqual((w.feature_bits & FEATURE_SCENE, w.scene_sha256_0, w.scene_bytes), (0, 0, 0))
        client.send(encode(pb.SceneRequest(session_id=w.session_id, bundle=1)))
        client.send(client.station.end())
        self.assertEqual(self.child.stop(), 0, self.child.said())
        self.assertEqual(counted(self.child.said()).get("unexpected"), 1, self.child.said())
        self.assertIn("cannot fetch the scene: --no-scene-sharing", self.child.said())

    def test_shutting_down_answers_while_the_tip_is_withdrawn(self):
        client = Client(self, self.server)
        w = client.connect()
        client.run(indent(vector(w, "start_pos_w_{}_nm"), 8, 2.0), 1.0)
        late = encode(pb.Command(session_id=w.session_id, sequence=1000, epoch=w.epoch))
        stranger, answers = udp(self), set()
        stranger.setblocking(False)
        client.sock.setblocking(False)
        self.child.process.terminate()
        for k in range(80):
            for sock, datagram in ((stranger, hello(100 + k)), (client.sock, late)):
                try:
                    sock.sendto(datagram, self.server)
                    answer = decode(sock.recv(2048))
                    answers.add((type(answer), getattr(answer, "reason", 0)))
                except (BlockingIOError, ConnectionRefusedError):
                    pass
            time.sleep(0.002)
        self.assertIn((pb.Refuse, 4), answers)
        self.assertIn((pb.Bye, 3), answers)
        self.assertEqual(self.child.wait(), 0, self.child.said())
        self.assertGreater(counted(self.child.said()).get("unexpected", 0), 4, "more than the farewells' echo")

    def test_a_shared_tip_goes_to_who_asks_by_right(self):
        self.start_server("--share", "one-tip", "--timeout-ms", "5000", "--local-rights", "administer")
        old = udp(self)
        cookie = self.ask(old, hello(3)).cookie
        refuse = self.ask(old, hello(3, cookie, feature_bits=ALL))
        self.assertEqual((type(refuse), refuse.reason), (pb.Refuse, 1), "does not know of it: too old")
        a, b = Client(self, self.server), Client(self, self.server)
        start = vector(a.connect(), "start_pos_w_{}_nm")
        self.assertEqual(b.connect().feature_bits, KNOWN_FEATURES & ~FEATURE_PARTICLE)
        self.assertNotEqual(a.station.welcome.epoch, b.station.welcome.epoch, "an account for each")
        down = indent(start, 8, 2.0)
        a.run(down, 1.0)  # pressed
        self.assertEqual(a.station.tip_hold, 1)
        here = down(1.0 - 1 / RATE_HZ)
        a.check, b.check = a.replies.append, b.replies.append  # an observer's replies are not computed for its commands
        b.run(lambda t: (0, 0, -100 * t), 0.1)  # moves nothing
        seen, own = b.replies[-1], a.replies[-1]
        self.assertEqual((seen.tip_hold, seen.energy_in_aj, seen.energy_out_aj), (0, 0, 0))
        self.assertEqual(vector(seen, "hold_pos_w_{}_nm"), here)
        self.assertEqual(vector(seen, "force_w_{}_nn"), vector(own, "force_w_{}_nn"))
        self.assertEqual(seen.measurement_age_ns, 0, "computed, whoever looks on and however long after")
        # Who administers has it at once. Until its commands carry the new number, they move nothing.
        b.tick((0, 0, -50), flags=CLUTCH | DEADMAN | TAKE_OVER)
        b.receive(0.05)
        self.assertEqual((b.station.tip_hold, vector(b.station.reply, "hold_pos_w_{}_nm")), (2, here))
        late = pb.Command(session_id=b.station.welcome.session_id, sequence=b.station.sent + 5, epoch=b.station.welcome.epoch,
                          flags=CLUTCH | DEADMAN, tip_pos_w_z_nm=-50, tip_hold=1)
        self.assertEqual(vector(self.ask(b.sock, encode(late)), "hold_pos_w_{}_nm"), here, "of another holding")
        a.run(lambda t: (0, 0, -50), 0.1)
        self.assertEqual((a.station.tip_hold, vector(a.replies[-1], "hold_pos_w_{}_nm")), (0, here))
        self.assertEqual(a.replies[-1].energy_in_aj, own.energy_in_aj)
        b.station.sent += 10
        b.run(lambda t: (*here[:2], here[2] + 100 * t), 0.5)
        last = b.replies[-1]
        self.assertLessEqual(last.energy_out_aj, last.energy_in_aj + 1e-9, "not credited with what a has put in")
        self.assertGreater(vector(last, "hold_pos_w_{}_nm")[2], here[2] + 40)
        for client in (a, b):
            client.send(client.station.end())
        self.end()

    def log_path(self, client, path, ticks, lose=lambda k: False, flags=3):
        """A step a tick along path(tick), a command each five; what lose() says never leaves. Then until all is executed."""
        for k in range(ticks + 400):
            if k < ticks:
                client.station.step(path(k), flags)
            elif client.station.executed == client.station.made:
                break
            if k % 5 == 4:
                at = now_ns()
                client.send(client.station.poll(at))
                datagram = client.station.command(at, (0, 0, 0), flags=flags)
                client.commanded[client.station.sent] = ((0, 0, 0), at)
                if not lose(k):
                    client.send(datagram)
            client.receive(0.001)
        return client.station.reply

    def test_steps_are_executed_once_and_in_order_whatever_is_lost(self):
        start, replies = None, []
        for lose in (lambda k: False, lambda k: k // 5 % 3 == 1, lambda k: 400 <= k < 560):
            client = Client(self, self.server, features=ALL | FEATURE_STEP_LOG)
            w = client.connect()
            self.assertTrue(w.feature_bits & FEATURE_STEP_LOG)
            start = start or vector(w, "start_pos_w_{}_nm")
            replies.append(self.log_path(client, lambda k: (0.003 * k, 0, max(start[2] - 0.06 * k, -3)), 1000, lose))
            client.send(client.station.end())
        # All alike to the last bit: state_hash is the server's own business, but the same log is the same state.
        self.assertEqual([(r.steps_executed, r.steps_breaks) for r in replies], [(1000, 0)] * 3)
        self.assertEqual(len({(r.state_hash, r.force_w_z_nn) for r in replies}), 1)
        self.assertGreater(abs(replies[0].force_w_z_nn), 1, "it touches")
        # A step more, or another one, is another state.
        client = Client(self, self.server, features=ALL | FEATURE_STEP_LOG)
        client.connect()
        other = self.log_path(client, lambda k: (0.003 * k, 0, max(start[2] - 0.06 * k, -3) - 0.1 * (k == 700)), 1000)
        self.assertNotEqual(other.state_hash, replies[0].state_hash)
        client.send(client.station.end())
        self.end()

    def test_marks_are_taken_back_stroke_by_stroke(self):
        client = Client(self, self.server, features=ALL | FEATURE_UNDO)
        self.assertFalse(client.connect().feature_bits & FEATURE_UNDO, "this sample keeps no marks")
        client.send(client.station.end())
        self.end()
        self.child, self.server = serve(self, "lithography", "--timeout-ms", "5000")
        client = Client(self, self.server, features=KNOWN_FEATURES & ~FEATURE_SHARING & ~FEATURE_PARTICLE | FEATURE_UNDO)
        self.assertTrue(client.connect().feature_bits & FEATURE_UNDO)
        client.check = client.replies.append
        start = vector(client.station.welcome, "start_pos_w_{}_nm")

        def press():
            """Down to 12 nm below where the bare sample is touched, up again: the tip's height as 20 nN push back."""
            before = len(client.replies)
            client.run(lambda s: (0, 0, max(start[2] - 60 * s, -12)), start[2] / 60 + 0.4)
            client.run(lambda s: (0, 0, min(-12 + 60 * s, start[2])), start[2] / 60 + 0.4)
            return next(r.tip_pos_w_z_nm for r in client.replies[before:] if r.force_w_z_nn > 20)

        def ask(times=20):
            client.run(lambda s: (0, 0, start[2]), times / RATE_HZ, flags=CLUTCH | DEADMAN | UNDO)
            faults = client.replies[-1].fault_bits
            client.run(lambda s: (0, 0, start[2]), 10 / RATE_HZ)
            self.assertFalse(client.replies[-1].fault_bits & FAULT_UNDO, "no longer asked")
            return faults & FAULT_UNDO

        first = press()
        again = press()
        self.assertLess(again, first - 1.5, "there is a dent")
        self.assertFalse(ask(), "taken back")
        # Where the second press left no mark of its own, that was the only stroke; else one more is to go.
        while not ask():
            pass
        out = client.replies[-1].energy_out_aj
        # Commands 5 ms apart at 60 nm/s: 0.3 nm, on a busy machine the double.
        self.assertAlmostEqual(press(), first, delta=0.7, msg="the bare sample again")
        self.assertGreaterEqual(client.replies[-1].energy_out_aj, out)
        client.send(client.station.end())
        self.end()

    def test_at_a_shared_tip_steps_belong_to_a_holding(self):
        self.start_server("--share", "one-tip", "--timeout-ms", "5000", "--local-rights", "administer")
        old = Client(self, self.server, features=KNOWN_FEATURES | FEATURE_STEP_LOG)
        self.assertFalse(old.connect().feature_bits & FEATURE_STEP_LOG, "knows only of private logs")
        old.send(old.station.end())
        a, b = (Client(self, self.server, features=KNOWN_FEATURES | FEATURE_STEP_LOG | FEATURE_SHARED_LOG) for _ in range(2))
        start = vector(a.connect(), "start_pos_w_{}_nm")
        self.assertTrue(b.connect().feature_bits & FEATURE_SHARED_LOG)
        for client in (a, b):
            client.check = client.replies.append
        self.log_path(a, lambda k: start, 30)
        self.assertNotEqual(a.station.tip_hold, 0)
        pressed = self.log_path(a, lambda k: (0, 0, max(start[2] - 0.06 * k, -3)), 800)
        self.assertEqual((pressed.steps_breaks, pressed.break_reason), (1, 6), "one holding")
        here = vector(pressed, "hold_pos_w_{}_nm")
        self.assertAlmostEqual(here[2], -3, 3)
        seen = self.log_path(b, lambda k: (0, 0, -50), 50)
        self.assertEqual((seen.steps_executed, seen.tip_hold), (50, 0), "executed, and none of the slave's")
        self.assertEqual(vector(seen, "hold_pos_w_{}_nm"), here)
        # b takes it where it stands.
        taken = self.log_path(b, lambda k: here, 50, flags=CLUTCH | DEADMAN | TAKE_OVER)
        self.assertEqual((taken.steps_breaks, taken.break_reason), (1, 6))
        self.assertNotEqual(taken.tip_hold, 0)
        last = self.log_path(b, lambda k: (here[0], here[1], here[2] + 5), 400)
        self.assertAlmostEqual(last.hold_pos_w_z_nm, here[2] + 5, 3)
        lost = self.log_path(a, lambda k: (0, 0, -50), 50)
        self.assertEqual(lost.tip_hold, 0)
        self.assertAlmostEqual(lost.hold_pos_w_z_nm, here[2] + 5, 3)
        for client in (a, b):
            client.send(client.station.end())
        self.end()

    def test_nonsense_is_counted_by_cause_and_not_answered(self):
        client = Client(self, self.server)
        w = client.connect()
        good = encode(pb.Command(session_id=w.session_id, sequence=1, epoch=w.epoch, flags=3, tip_pos_w_z_nm=20))
        nan = encode(pb.Command(session_id=w.session_id, sequence=1, epoch=w.epoch, tip_pos_w_z_nm=math.nan))
        negative = encode(pb.Command(session_id=w.session_id, sequence=1, epoch=w.epoch, energy_in_j=-1))
        bads = [bytes(513), b"", good[:-1], good + b"\0", b"X" + good[1:], good[:4] + b"\2" + good[5:],
                good[:5] + b"\x09" + good[6:], hello(5)[:100], good[:-9] + b"\x12" + good[-8:], nan, negative,
                encode(pb.Reply(session_id=w.session_id, sequence=1, command_sequence=1, epoch=w.epoch))]
        expected = {}
        for bad in bads:
            try:
                decode(bad)
                cause = "unknown_type"  # of the other side
            except Drop as drop:
                cause = drop.cause
            expected[cause] = expected.get(cause, 0) + 1
            client.sock.sendto(bad, self.server)
        self.assertEqual(type(self.ask(client.sock, good)), pb.Reply)
        self.assertEqual(counted(self.end()), expected)


if __name__ == "__main__":
    unittest.main()
