"""What somebody with a lesser right, or none, can take from the others at the real server: no more than a share."""
import os
import pathlib
import subprocess
import tempfile
import time
import unittest

import dtls
import telenano_pb2 as pb
from programs import serve, udp
from test_station import Client, hello, indent
from wire import CLUTCH, DEADMAN, TAKE_OVER, decode, encode, vector

SLOTS, SHARE = 64, 16  # of the defaults


class Keyed(unittest.TestCase):
    """A server with three keys; what it serves is up to the test."""

    def setUp(self):
        if dtls.SSL is None:
            self.skipTest("no libssl.so.3")
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        for name, rights in (("guest", "observe"), ("omega-1", "operate"), ("omega-2", "operate")):
            made = subprocess.run([os.environ["TELENANO_NVE"], "keys", "new", name, "--rights", rights, "--keys",
                                   self.folder / "keys.toml", "--out", self.folder / f"{name}.key"], capture_output=True, text=True)
            if "built without" in made.stderr:
                self.skipTest("a server without DTLS")
            self.assertEqual(made.returncode, 0, made.stderr)

    def serve(self, *more, scene="flat_pdms"):
        self.child, self.server = serve(self, scene, "--keys", self.folder / "keys.toml", *more)

    def channel(self, name):
        sock = udp(self)
        sock.connect(self.server)
        return dtls.Channel(self, sock, self.folder / f"{name}.key")


class WithKeys(Keyed):
    def ask(self, channel, datagram):
        channel.send(datagram)
        return decode(channel.recv())

    def use(self, channel, welcome):
        """Its first command, so that there is something to come back to."""
        reply = self.ask(channel, encode(pb.Command(session_id=welcome.session_id, sequence=1, epoch=welcome.epoch, flags=3)))
        self.assertEqual(type(reply), pb.Reply)

    def test_an_observer_neither_fills_the_server_nor_ends_an_operators_session(self):
        timeout_s = 2.0
        self.serve("--timeout-ms", f"{1000 * timeout_s:.0f}")
        operator = self.channel("omega-1")
        mine = self.ask(operator, hello(1))
        self.assertEqual(type(mine), pb.Welcome)
        self.use(operator, mine)
        time.sleep(timeout_s + 0.5)  # silent; it can be resumed for 30 s
        guest = self.channel("guest")
        begin = time.monotonic()
        answers = [self.ask(guest, hello(100 + k)) for k in range(SLOTS - 4)]
        taken = [a for a in answers if isinstance(a, pb.Welcome)]
        refused = [a for a in answers if isinstance(a, pb.Refuse)]
        # Those that it does not use are forgotten after the time-out, and may be opened again on a machine so busy.
        rounds = 1 + int((time.monotonic() - begin) / timeout_s)
        self.assertTrue(SHARE <= len(taken) <= SHARE * rounds, (len(taken), rounds))
        self.assertEqual({a.reason for a in refused}, {2})
        self.assertEqual(len(taken) + len(refused), len(answers))
        # Others come in, and the operator has its tip and account again.
        self.assertEqual(type(self.ask(self.channel("omega-2"), hello(1000))), pb.Welcome)
        again = self.ask(operator, hello(2, resume_token=mine.resume_token))
        self.assertEqual((type(again), again.epoch, again.resume_token), (pb.Welcome, mine.epoch, mine.resume_token))

    def test_a_full_server_does_not_give_an_observer_an_operators_place(self):
        self.serve("--timeout-ms", "2000", "--max-sessions", "2")
        operator = self.channel("omega-1")
        mine = [self.ask(operator, hello(1 + k)) for k in range(2)]
        for welcome in mine:
            self.use(operator, welcome)
        time.sleep(2.5)
        guest = self.channel("guest")
        for k in range(5):
            refuse = self.ask(guest, hello(100 + k))
            self.assertEqual((type(refuse), getattr(refuse, "reason", 0)), (pb.Refuse, 2))
        for k, welcome in enumerate(mine):
            again = self.ask(operator, hello(10 + k, resume_token=welcome.resume_token))
            self.assertEqual((type(again), again.epoch), (pb.Welcome, welcome.epoch))


class WithoutKeys(unittest.TestCase):
    """In the clear, on loopback: every local user."""

    def serve(self, *more):
        self.child, self.server = serve(self, "flat_pdms", *more)

    def hold_and_ask(self, *more):
        """The first presses, the second asks for the tip all the while; who has it then, and the command held."""
        self.serve("--share", "one-tip", "--timeout-ms", "5000", *more)
        a, b = Client(self, self.server), Client(self, self.server)
        start = vector(a.connect(), "start_pos_w_{}_nm")
        b.connect()
        a.check, b.check = a.replies.append, b.replies.append  # an observer's replies are not computed for its commands
        down = indent(start, 8, 4.0)
        for k in range(4000):
            a.tick(down(min(k, 200) / 200))
            b.tick((0, 0, -50), flags=CLUTCH | DEADMAN | (TAKE_OVER if k >= 50 else 0))
            a.receive(0.0025)
            b.receive(0.0025)
            # One that a busy machine has made wait for 200 ms resumes its session, and knows of no holding for a moment.
            if k >= 200 and (a.station.tip_hold == 0) != (b.station.tip_hold == 0):
                break
        return a, b

    def test_a_local_user_does_not_take_the_tip_from_who_works_with_it(self):
        a, b = self.hold_and_ask()
        self.assertEqual((a.station.tip_hold, b.station.tip_hold), (1, 0))

    def test_who_says_that_all_administer_has_it_so(self):
        a, b = self.hold_and_ask("--local-rights", "administer")
        self.assertEqual((a.station.tip_hold, b.station.tip_hold), (0, 2))

    def test_who_says_that_all_observe_has_no_tip_moved(self):
        self.serve("--local-rights", "observe")
        client = Client(self, self.server)
        start = vector(client.connect(), "start_pos_w_{}_nm")
        client.run(lambda t: (0, 0, start[2] - 20 * t), 0.5)
        self.assertGreater(len(client.replies), 10, "it is answered")
        self.assertEqual({(r.energy_in_aj, r.energy_out_aj) for r in client.replies}, {(0, 0)})
        self.assertEqual({vector(r, "tip_pos_w_{}_nm") for r in client.replies}, {vector(client.replies[0], "tip_pos_w_{}_nm")})

    def test_a_local_user_operates_a_tip_of_its_own(self):
        self.serve()
        client = Client(self, self.server)
        client.connect()
        client.run(indent(vector(client.station.welcome, "start_pos_w_{}_nm"), 8, 1.0), 1.0)
        self.assertGreater(client.replies[-1].energy_in_aj, 0)

    def test_an_address_has_its_share(self):
        self.serve()
        welcomes, refusals = [], []
        for k in range(SHARE + 4):
            sock = udp(self)
            sock.settimeout(10)
            sock.sendto(hello(1 + k), self.server)
            sock.sendto(hello(1 + k, decode(sock.recv(2048)).cookie), self.server)
            answer = decode(sock.recv(2048))
            (welcomes if isinstance(answer, pb.Welcome) else refusals).append(answer)
        self.assertEqual((len(welcomes), [r.reason for r in refusals]), (SHARE, [2] * 4))
        elsewhere = udp(self, ("127.0.0.77", 0))
        elsewhere.settimeout(10)
        elsewhere.sendto(hello(1), self.server)
        elsewhere.sendto(hello(1, decode(elsewhere.recv(2048)).cookie), self.server)
        self.assertEqual(type(decode(elsewhere.recv(2048))), pb.Welcome)


if __name__ == "__main__":
    unittest.main()
