"""What somebody with a valid key can do to the others at the real server with requests that the protocol allows: each attack runs
beside a neighbour with a key of its own, whose session, account and replies must stay as they are, and costs the server a bounded
share. Times are the server's own processor time: a busy machine changes nothing in them."""
import os
import random
import select
import time
import unittest

import telenano_pb2 as pb
import test_attack
from programs import counted, now_ns
from test_station import RATE_HZ, Client, hello, indent
from wire import (CLUTCH, DEADMAN, FEATURE_PARTICLE, FEATURE_SCENE, FEATURE_SHARING, FEATURE_STEP_LOG,
                  FEATURE_UNDO, FAULT_UNDO, HAND_OVER, KNOWN_FEATURES, TAKE_OVER, UNDO, Drop, decode, encode, scene_offer, vector)

SECONDS = 2.0
SHARE = 0.4  # of a processor: on a quiet machine some two to seven hundredths
PRIVATE = KNOWN_FEATURES & ~(FEATURE_SHARING | FEATURE_PARTICLE)
ON = CLUTCH | DEADMAN


class Wire:
    """dtls.Channel as what Client takes for its socket."""

    def __init__(self, channel):
        self.channel, self.wait_s = channel, 0
        channel.sock.setblocking(False)

    def settimeout(self, wait_s):
        self.wait_s = wait_s

    def sendto(self, datagram, _server):
        try:
            self.channel.send(datagram)
        except AssertionError:
            pass  # the socket's buffer is full: lost

    def recv(self, _size):
        end = time.monotonic() + self.wait_s
        while True:
            try:
                return self.channel.recv()
            except AssertionError:
                left = end - time.monotonic()
                if left <= 0 or not select.select([self.channel.sock], [], [], left)[0]:
                    raise TimeoutError from None


class Insider(test_attack.Keyed):
    def client(self, name, rate_hz=1000, **config):
        client = Client(self, self.server, **config)
        client.station.rate_hz = rate_hz
        client.sock = Wire(self.channel(name))
        return client

    def cpu_s(self):
        with open(f"/proc/{self.child.process.pid}/stat", encoding="ascii") as stat:
            fields = stat.read().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def memory_mb(self):
        with open(f"/proc/{self.child.process.pid}/statm", encoding="ascii") as statm:
            return int(statm.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    def attack(self, attacker, burst, hear, path=None, name="omega-2", features=PRIVATE):
        """`burst(k)` datagrams each five milliseconds beside a neighbour at work; what came back goes to hear(message). Returns how
        many were sent, how long it took and how much processor time of the server's."""
        neighbour = self.client(name, RATE_HZ, features=features)
        start = vector(neighbour.connect(), "start_pos_w_{}_nm")
        epoch = neighbour.station.welcome.epoch
        path = path or indent(start, 8, SECONDS)
        begin, cpu, sent = time.monotonic(), self.cpu_s(), 0
        for k in range(int(SECONDS * RATE_HZ)):
            neighbour.tick(path(k / RATE_HZ))
            for datagram in burst(k):
                attacker.send(datagram)
                sent += 1
            while True:
                attacker.sock.settimeout(0)
                try:
                    datagram = attacker.sock.recv(2048)
                except TimeoutError:
                    break
                try:
                    hear(decode(datagram))
                except Drop as drop:
                    self.fail(drop.cause)
            neighbour.receive(max(begin + (k + 1) / RATE_HZ - time.monotonic(), 0.0005))
        neighbour.receive(0.5)
        took, cpu = time.monotonic() - begin, self.cpu_s() - cpu
        # Every reply has kept the rules (Client.check); it is the same session's account, and the hand has felt the sample.
        self.assertEqual(neighbour.station.welcome.epoch, epoch)
        self.assertGreater(len(neighbour.replies), 0.5 * len(neighbour.commanded))
        if neighbour.station.welcome.feature_bits & FEATURE_SHARING == 0:
            self.assertGreater(neighbour.replies[-1].energy_in_aj, 0)
        neighbour.send(neighbour.station.end())
        return sent, took, cpu

    def end_with(self, attacker):
        attacker.send(attacker.station.end())
        self.assertEqual(self.child.stop(), 0, self.child.said())
        return counted(self.child.said())

    def test_strokes_are_made_and_taken_back_without_an_end(self):
        """Down, up, undo, and no longer: four commands a stroke, a thousand commands a second."""
        self.serve("--timeout-ms", "5000", scene="lithography")
        attacker = self.client("omega-1", features=PRIVATE | FEATURE_UNDO)
        start = vector(attacker.connect(), "start_pos_w_{}_nm")
        self.assertTrue(attacker.station.welcome.feature_bits & FEATURE_UNDO)
        replies = []
        z = [start[2]] * 5 + [-10] * 5 + [start[2]] * 5 + [start[2]] * 5

        def burst(k):
            return [attacker.station.command(now_ns(), (0, 0, z[(5 * k + i) % 20]),
                                             flags=ON | (UNDO if (5 * k + i) % 20 >= 15 else 0)) for i in range(5)]

        memory = self.memory_mb()
        sent, took, cpu = self.attack(attacker, burst, lambda m: isinstance(m, pb.Reply) and replies.append(m))
        print(f"undo: {sent} commands in {took:.1f} s, {len(replies)} replies, {cpu:.2f} s of the server's processor", flush=True)
        self.assertGreater(len(replies), 100)
        for a, b in zip(replies, replies[1:]):
            self.assertGreaterEqual(b.energy_in_aj, a.energy_in_aj)
            self.assertGreaterEqual(b.energy_out_aj, a.energy_out_aj)
        last = replies[-1]
        self.assertLessEqual(last.energy_out_aj, last.energy_in_aj, "it has been given no energy")
        self.assertLess(self.memory_mb() - memory, 30, "strokes are not kept without end")
        self.assertLess(cpu, SHARE * took)
        asked = [r for r in replies if (r.command_sequence - 1) % 20 >= 15]
        self.assertTrue(any(not r.fault_bits & FAULT_UNDO for r in asked), "strokes were taken back")
        self.end_with(attacker)

    def test_snapshots_are_asked_for_in_a_loop(self):
        """Each request under another number, and pieces anywhere: frozen ten times a second at most."""
        self.serve("--timeout-ms", "5000", scene="lithography")
        attacker = self.client("omega-1", features=PRIVATE | FEATURE_STEP_LOG)
        self.assertTrue(attacker.connect().feature_bits & FEATURE_STEP_LOG)
        session, chance = attacker.station.welcome.session_id, random.Random(5)
        frozen, heard = set(), []

        def burst(k):
            return [encode(pb.SnapshotRequest(session_id=session, snapshot=1 + 20 * k + i // 2,
                                              piece=0 if i % 2 == 0 else chance.getrandbits(32))) for i in range(20)]

        def hear(message):
            self.assertEqual(type(message), pb.SnapshotPiece)
            frozen.add(message.snapshot)
            heard.append(message)

        memory = self.memory_mb()
        sent, took, cpu = self.attack(attacker, burst, hear)
        print(f"snapshots: {sent} requests in {took:.1f} s, {len(heard)} pieces of {len(frozen)} states, {cpu:.2f} s", flush=True)
        self.assertTrue(1 <= len(frozen) <= 10 * took + 2, (len(frozen), took))
        self.assertLess(self.memory_mb() - memory, 40)
        self.assertLess(cpu, SHARE * took)
        drops = self.end_with(attacker)
        self.assertGreater(drops["rate_limited"], 0)

    def test_the_scene_is_asked_for_at_random(self):
        """Any piece, many beyond its end, and those of another scene: only what exists is sent, and no faster than a session may."""
        self.serve("--timeout-ms", "5000", scene="flakes")
        attacker = self.client("omega-1", features=PRIVATE)
        welcome = attacker.connect()
        self.assertTrue(welcome.feature_bits & FEATURE_SCENE)
        pieces = -(-scene_offer(welcome)[1] // 464)
        chance, right, wrong = random.Random(6), set(), 0
        heard = []

        def burst(_k):
            nonlocal wrong
            for _ in range(30):
                chunk = chance.choice((chance.randrange(pieces), pieces + chance.randrange(5), chance.getrandbits(32)))
                bundle = welcome.scene_sha256_0 ^ (1 if chance.random() < 0.3 else 0)
                if chunk < pieces and bundle == welcome.scene_sha256_0:
                    right.add(chunk)
                else:
                    wrong += 1
                yield encode(pb.SceneRequest(session_id=welcome.session_id, bundle=bundle, chunk=chunk))

        def hear(message):
            self.assertEqual((type(message), message.bundle), (pb.SceneChunk, welcome.scene_sha256_0))
            self.assertIn(message.chunk, right)
            heard.append(message.chunk)

        sent, took, cpu = self.attack(attacker, burst, hear)
        print(f"scene: {sent} requests, {wrong} of them for nothing, in {took:.1f} s, {len(heard)} pieces, {cpu:.2f} s", flush=True)
        self.assertTrue(0 < len(heard) <= 2000 * took + 2000)
        self.assertLess(cpu, SHARE * took)
        self.assertGreater(self.end_with(attacker)["out_of_range"], 0)

    def test_a_session_is_handed_over_to_itself(self):
        """Its token shown again and again, from two channels of one key: one session, one account, and none of anybody else's."""
        self.serve("--timeout-ms", "5000")
        first, second = self.client("omega-1", features=PRIVATE), self.client("omega-1", features=PRIVATE)
        start = vector(first.connect(), "start_pos_w_{}_nm")
        first.run(indent(start, 5, 0.5), 0.5)
        token, epoch = first.station.token, first.station.welcome.epoch
        welcomes, nonce = [], iter(range(10, 10 ** 9))

        def burst(_k):
            for client in (first, second):
                client.send(hello(next(nonce), resume_token=token))
            yield hello(next(nonce), resume_token=token)

        def hear(message):
            if isinstance(message, pb.Welcome):
                welcomes.append(message)

        sent, took, cpu = self.attack(first, burst, hear)
        # The second one's are heard now.
        try:
            second.sock.settimeout(0.2)
            while True:
                hear(decode(second.sock.recv(2048)))
        except TimeoutError:
            pass
        print(f"itself: {3 * sent} openings in {took:.1f} s, {len(welcomes)} welcomes, {cpu:.2f} s", flush=True)
        self.assertGreater(len(welcomes), 0)
        own = [w for w in welcomes if w.resume_token == token]
        self.assertTrue(own)
        self.assertEqual({w.epoch for w in own}, {epoch})
        self.assertLess(cpu, SHARE * took)
        others = {w.resume_token for w in welcomes} - {token}
        self.assertLessEqual(len(others), 16, "its share of sessions")
        self.assertEqual(self.child.stop(), 0, self.child.said())

    def test_a_shared_tip_goes_to_and_fro_between_two_sessions_of_one_key(self):
        """Take over and hand over in every command of both: the tip stays one, and a third may look on."""
        self.serve("--share", "one-tip", "--timeout-ms", "5000")
        a, b = (self.client("omega-1", features=KNOWN_FEATURES) for _ in range(2))
        start = vector(a.connect(), "start_pos_w_{}_nm")
        b.connect()
        heard = []

        def burst(k):
            for _ in range(5):
                for client in (a, b):
                    gives = (k // 4 + (client is b)) % 2 == 0
                    client.send(client.station.command(now_ns(), start, flags=ON | (HAND_OVER if gives else TAKE_OVER)))
            for client in (a, b):
                client.check = heard.append
                client.receive(0)
            return ()

        _, took, cpu = self.attack(a, burst, heard.append, path=lambda t: start, name="guest", features=KNOWN_FEATURES)
        print(f"to and fro: {len(heard)} replies in {took:.1f} s, {len({r.tip_hold for r in heard})} holdings, {cpu:.2f} s", flush=True)
        self.assertGreater(len(heard), 100)
        self.assertGreater(len({r.tip_hold for r in heard} - {0}), 10, "holdings")
        self.assertLess(cpu, SHARE * took)
        for station in (a, b):
            self.assertTrue(station.station.alive)
        self.assertEqual(self.child.stop(), 0, self.child.said())


if __name__ == "__main__":
    unittest.main()
