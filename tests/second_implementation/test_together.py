"""Both Python ends in virtual time over a bad link: the state machines of the document fit each other."""
import heapq
import math
import random
import unittest

from server import Server
from station import MS, Station
from wire import BYE_DONE, FEATURE_LOCAL_MODEL, FEATURE_PORT_CONTROL, FEATURE_REPLY_DEADBAND, vector

HERE = ("127.0.0.1", 5101)


class Link:
    """A tick a millisecond; datagrams take `delay_ms` ± half of it, some are lost or doubled."""

    def __init__(self, station, server, seed=1, delay_ms=5, loss=0.0, double=0.0):
        self.station, self.server = station, server
        self.random = random.Random(seed)
        self.delay_ms, self.loss, self.double = delay_ms, loss, double
        self.now_ns, self.count, self.up = 0, 0, True
        self.queue = []
        self.target = (0.0, 0.0, -3.0)
        self.energy_in_j = 0.0
        self.deadband = {}

    def send(self, datagram, to_server):
        for _ in range(2 if self.random.random() < self.double else 1):
            if datagram is None or not self.up or self.random.random() < self.loss:
                continue
            self.count += 1
            delay = self.delay_ms * (0.5 + self.random.random()) * MS
            heapq.heappush(self.queue, (self.now_ns + int(delay), self.count, to_server, datagram))

    def fetch(self, ticks):
        for _ in range(ticks):
            self.ticks(1)
            for datagram in self.station.scene_requests(self.now_ns):
                self.send(datagram, True)

    def ticks(self, count):
        for _ in range(count):
            end_ns = self.now_ns + MS
            while self.queue and self.queue[0][0] <= end_ns:
                self.now_ns, _, to_server, datagram = heapq.heappop(self.queue)
                if not to_server:
                    self.station.on_datagram(datagram, self.now_ns)
                elif self.server is not None:
                    self.send(self.server.on_datagram(datagram, HERE, self.now_ns), False)
            self.now_ns = end_ns
            if self.server is not None:
                self.server.poll(end_ns)
            self.send(self.station.poll(end_ns), True)
            self.send(self.station.command(end_ns, self.target, energy_in_j=self.energy_in_j, **self.deadband), True)


class Together(unittest.TestCase):
    def test_a_session_comes_up_and_goes_on_under_loss_doubling_and_reordering(self):
        for seed in range(5):
            station, server = Station(), Server()
            link = Link(station, server, seed, delay_ms=10, loss=0.3, double=0.2)
            station.start(0)
            link.ticks(4000)
            self.assertTrue(station.alive, seed)
            self.assertGreater(station.replies.newest, 500)
            self.assertEqual(station.energy_in_aj.value, 4.5)  # ½·1·3²
            self.assertEqual(vector(station.reply, "force_w_{}_nn"), (0, 0, 3))
            self.assertGreater(server.drops["stale"], 100)
            self.assertGreater(server.drops["duplicate"], 100)

    def test_a_scene_is_fetched_under_loss_and_goes_on_over_an_outage(self):
        bundle = random.Random(5).randbytes(100_001)
        for seed in range(3):
            station, server = Station(), Server(bundle=bundle)
            link = Link(station, server, seed, delay_ms=10, loss=0.1, double=0.1)
            station.start(0)
            link.fetch(150)
            had = len(station.pieces)
            self.assertTrue(0 < had < 216, had)
            link.up = False
            link.fetch(1500)
            link.up = True
            link.fetch(2500)
            self.assertEqual(station.scene(), bundle)
            self.assertGreater(len(station.welcomes), 1)

    def test_a_server_without_a_scene_offers_none(self):
        station, server = Station(), Server()
        link = Link(station, server)
        station.start(0)
        link.fetch(100)
        self.assertEqual((station.scene(), station.pieces), (None, {}))
        self.assertEqual(server.drops["unexpected"], 0)

    def test_features_are_those_of_both(self):
        for asked in range(4):
            for granted in range(4):
                station, server = Station(features=asked | 1 << 50), Server(features=granted)
                link = Link(station, server)
                station.start(0)
                link.ticks(50)
                self.assertEqual(station.welcome.feature_bits, asked & granted)
                self.assertEqual(server.drops["unexpected"] + station.drops["out_of_range"], 0)

    def test_repeated_commands_give_the_slave_the_whole_path(self):
        for redundancy in range(5):
            station, server = Station(redundancy=redundancy), Server()
            link = Link(station, server, seed=3, delay_ms=0)
            station.start(0)
            link.ticks(20)
            server.told.clear()
            link.loss = 0.2
            commanded = []
            for k in range(2000):
                link.loss = 0.2 if k < 1980 else 0.0
                link.target = (0.01 * k, 0.0, 3.0)
                commanded.append(link.target)
                link.ticks(1)
            link.ticks(2)
            # From the first target on, without the last ones, which were all the same.
            told = [target for target, _, _ in server.told if target[2] > 0 and target != commanded[-1]]
            missing = len(set(commanded[:-1]) - set(told))
            self.assertEqual(sorted(set(told)), told, "each once, in their order")
            # Lost for good: a run longer than what is repeated, 0.2^(n+1) of all.
            self.assertLess(abs(missing - 2000 * 0.2 ** (redundancy + 1)), 5 * (2000 * 0.2 ** (redundancy + 1)) ** 0.5 + 3)
            self.assertAlmostEqual(sum(dt for _, dt, _ in server.told), 2.002, delta=0.0021)

    def test_replies_tell_which_commands_came_before(self):
        station, server = Station(), Server()
        link = Link(station, server, seed=7, delay_ms=0)
        station.start(0)
        link.ticks(20)
        link.loss = 0.3
        gaps = 0
        for _ in range(500):
            link.ticks(1)
            numbers = [m.sequence for session, m in server.accepted if session == station.welcome.session_id]
            if station.reply is None or station.reply.command_sequence != numbers[-1]:
                continue
            came = {numbers[-1] - 1 - i for i in range(64) if station.reply.steps_before >> i & 1}
            self.assertEqual(came, {n for n in numbers[:-1] if numbers[-1] - n <= 64})
            gaps += 64 - len(came) if numbers[-1] > 64 else 0
        self.assertGreater(gaps, 1000)

    def test_replies_are_left_out_and_the_books_agree(self):
        for seed, loss in enumerate((0.0, 0.1, 0.3)):
            station, server = Station(), Server(features=FEATURE_REPLY_DEADBAND)
            link = Link(station, server, seed=seed, delay_ms=2 if loss else 0, loss=loss, double=0.05)
            link.deadband = {"reply_floor_pn": 50, "reply_relative_permille": 100}
            station.start(0)
            link.ticks(200)
            shown = []
            for k in range(3000):
                link.target = (0.0, 0.0, -3.0 - 2.0 * math.sin(0.01 * k))
                link.ticks(1)
                shown.append(station.replies.newest)
            link.loss = 0.0
            link.ticks(100)
            (session,) = [s for s in server.sessions if s.session_id == station.welcome.session_id]
            accepted = sum(session_id == station.welcome.session_id for session_id, _ in server.accepted)
            self.assertEqual(session.replies + session.deadband.left_out, accepted)
            self.assertGreater(session.deadband.left_out, 2 * session.replies)
            self.assertEqual(station.energy_in_aj.value, session.slave.energy_in_aj)
            self.assertEqual(station.energy_out_aj.value, session.slave.energy_out_aj)
            # Of the commands up to the one answered: those that the server has not.
            numbers = {m.sequence for session_id, m in server.accepted if session_id == station.welcome.session_id}
            self.assertEqual(station.commands_not_accepted(),
                             sum(n not in numbers for n in range(1, station.reply.command_sequence)))
            self.assertEqual(station.commands_not_accepted() > 100, loss > 0)
            if loss == 0:
                # A reply in six ticks at least, and then the force that is there, within its deadband.
                self.assertTrue(all(shown[k + 8] > shown[k] for k in range(100, 2900)))
            self.assertEqual(station.drops["out_of_range"], 0)

    def test_fields_without_their_feature_are_unexpected(self):
        for granted, expected in ((FEATURE_LOCAL_MODEL, 1), (FEATURE_PORT_CONTROL, 0)):
            station, server = Station(), Server(features=granted)
            link = Link(station, server)
            station.start(0)
            link.ticks(50)
            station.welcome.feature_bits = 3  # a station that does not keep to it
            link.send(station.command(link.now_ns, (0, 0, 0), method=2), True)
            link.ticks(20)
            self.assertEqual(server.drops["unexpected"], expected)

    def test_a_short_outage_needs_no_handshake_a_long_one_resumes(self):
        station, server = Station(), Server(timeout_ms=700)
        link = Link(station, server)
        station.start(0)
        link.ticks(300)
        link.energy_in_j = 5.0
        link.up = False
        link.ticks(450)
        self.assertEqual(station.state, "lost")
        link.up = True
        link.ticks(1500)
        self.assertEqual((station.state, len(station.welcomes)), ("established", 1))
        self.assertEqual(server.sessions[0].energy_in_j.value, 5.0)
        link.up = False
        link.ticks(2000)
        self.assertEqual(server.sessions[0].state, "silent")
        link.up = True
        link.ticks(2500)
        first, second = station.welcomes
        self.assertEqual((station.state, second.epoch, second.resume_token),
                         ("established", first.epoch, first.resume_token))
        self.assertNotEqual(second.session_id, first.session_id)
        self.assertEqual(server.sessions[0].energy_in_j.value, 0.0, "counts from the Welcome")
        self.assertGreaterEqual(station.energy_in_aj.value, 9.0, "the slave's account goes on: pressed twice")

    def test_a_restarted_server_is_a_new_epoch(self):
        station, link = Station(), None
        link = Link(station, Server())
        station.start(0)
        link.ticks(300)
        link.server = None
        link.ticks(400)
        link.server = Server()
        link.ticks(2000)
        first, second = station.welcomes
        self.assertEqual(station.state, "established")
        self.assertNotEqual(first.epoch, second.epoch)
        self.assertEqual(station.energy_in_aj.value, 4.5)
        self.assertEqual(station.bye.reason, 5)

    def test_shutting_down_and_bye(self):
        station, server = Station(), Server()
        link = Link(station, server)
        station.start(0)
        link.ticks(300)
        for datagram, _ in server.byes():
            link.send(datagram, False)
        link.ticks(500)
        self.assertEqual((station.state, station.alive, station.refuse.reason), ("lost", False, 4))
        link.server = Server()
        link.ticks(2000)
        self.assertEqual(station.state, "established")
        link.send(station.end(BYE_DONE), True)
        link.ticks(20)
        self.assertEqual(link.server.sessions[0].state, "ending")
        link.ticks(2001)
        self.assertEqual(link.server.sessions, [])

    def test_refusals_are_final_for_a_new_session(self):
        for station, reason in ((Station(versions=(2, 3)), 1), (Station(rate_hz=8001), 3)):
            link = Link(station, Server())
            station.start(0)
            link.ticks(100)
            self.assertEqual((station.state, station.refuse.reason), ("refused", reason))

    def test_clock_of_the_link(self):
        station = Station()
        link = Link(station, Server(), delay_ms=8)
        station.start(0)
        link.ticks(2000)
        # 4 to 12 ms each way, both clocks the same: the offset is within half of the best round trip.
        self.assertTrue(8 * MS < station.times.srtt_ns < 24 * MS)
        self.assertLess(abs(station.times.offset_ns()), 6 * MS)


if __name__ == "__main__":
    unittest.main()
