"""A Python station at the real server with two scenes: the list, another scene, and what is refused (section 17)."""
import unittest

import telenano_pb2 as pb
from programs import SCENES, counted, now_ns, serve, udp
from test_station import ALL, Client, indent
from wire import FEATURE_SCENE_SWITCH, decode, encode, vector


class StationAtSeveralScenes(unittest.TestCase):
    def setUp(self):
        self.child, self.server = serve(self, "flat_pdms", "--scene", SCENES / "flat_silicon_oxide.toml", "--timeout-ms", "5000")

    def end(self):
        self.assertEqual(self.child.stop(), 0, self.child.said())
        return self.child.said()

    def ask(self, sock, datagram):
        """The answer to one datagram; None if there is none."""
        sock.sendto(datagram, self.server)
        sock.settimeout(0.3)
        try:
            return decode(sock.recv(2048))
        except TimeoutError:
            return None

    def scenes(self):
        client = Client(self, self.server, features=ALL | FEATURE_SCENE_SWITCH)
        first = client.connect()
        self.assertTrue(first.feature_bits & FEATURE_SCENE_SWITCH)
        for index in (0, 1, 2):
            client.send(client.station.list_request(index))
        client.receive(0.3)
        return client, first

    def switch(self, client, scene_hash):
        client.station.ask_scene(scene_hash, now_ns())
        for _ in range(200):
            client.send(client.station.poll(now_ns()))
            client.receive(0.005)
            if client.station.switch is None:
                return client.station.welcome
        raise AssertionError("no answer")

    def test_the_list_and_the_other_scene(self):
        client, first = self.scenes()
        self.assertEqual(client.station.scenes[0], (b"flat_pdms", first.scene_hash))
        self.assertEqual(sorted(client.station.scenes), [0, 1], "and there is no third")
        name, scene_hash = client.station.scenes[1]
        client.run(indent(vector(first, "start_pos_w_{}_nm"), 8, 1), 1)
        second = self.switch(client, scene_hash)
        self.assertEqual((second.scene_name, second.scene_hash), (name, scene_hash))
        self.assertNotIn(second.session_id, (0, first.session_id))
        self.assertNotEqual(second.epoch, first.epoch)
        self.assertEqual(second.resume_token, first.resume_token)
        self.assertNotEqual(second.well_aj, first.well_aj)
        before = len(client.replies)
        client.run(indent(vector(second, "start_pos_w_{}_nm"), 1, 1), 1)
        replies = client.replies[before:]
        self.assertEqual([r.sequence for r in replies], list(range(1, len(replies) + 1)))
        self.assertLess(replies[0].energy_in_aj, 1, "an account of its own")
        # Back: a new sample again.
        self.assertEqual(self.switch(client, first.scene_hash).scene_name, b"flat_pdms")
        said = self.end()
        self.assertIn("switches of a session to another scene: 2", said)
        self.assertEqual(counted(said).get("out_of_range"), 1, "the third line")

    def test_a_wish_that_is_repeated_is_one(self):
        client, _ = self.scenes()
        wish = encode(pb.SceneSwitch(session_id=client.station.welcome.session_id, nonce=77, scene_hash=client.station.scenes[1][1]))
        welcomes = [self.ask(client.sock, wish) for _ in range(3)]
        self.assertEqual([type(w) for w in welcomes], [pb.Welcome] * 3)
        self.assertEqual(len({w.session_id for w in welcomes}), 1)
        self.assertEqual(welcomes[0].nonce, 77)
        self.assertIn("switches of a session to another scene: 1", self.end())

    def test_what_is_refused_changes_nothing(self):
        client, first = self.scenes()
        refuse = self.ask(client.sock, encode(pb.SceneSwitch(session_id=first.session_id, nonce=77, scene_hash=1)))
        self.assertEqual((type(refuse), refuse.reason, refuse.nonce), (pb.Refuse, 5, 77))
        # Another address, and a session that has not agreed.
        wish = encode(pb.SceneSwitch(session_id=first.session_id, nonce=78, scene_hash=client.station.scenes[1][1]))
        self.assertIsNone(self.ask(udp(self), wish))
        old = Client(self, self.server, features=ALL)
        session = old.connect().session_id
        self.assertIsNone(self.ask(old.sock, encode(pb.SceneSwitch(session_id=session, nonce=79, scene_hash=client.station.scenes[1][1]))))
        client.run(indent(vector(first, "start_pos_w_{}_nm"), 8, 1), 1)
        self.assertEqual(client.station.welcome.session_id, first.session_id)
        self.assertGreater(client.replies[-1].energy_in_aj, 0)
        counts = counted(self.end())
        self.assertEqual((counts["unauthenticated"], counts["unexpected"]), (1, 1))


if __name__ == "__main__":
    unittest.main()
