#!/usr/bin/env python3
"""A server with several scenes and a station that chooses one, through the real programs.

server_scenes_test.py TELENANO_NVE TELENANO_MASTER
"""
import pathlib
import re
import sys
import unittest

from real_programs import RealPrograms

NVE, MASTER = (str(pathlib.Path(word).resolve()) for word in sys.argv[1:3])
FIRST, SECOND = "flat_silicon_oxide", "flat_pdms"


class ServerScenes(RealPrograms):
    def server(self, *scenes, more=()):
        words = [word for scene in scenes for word in ("--scene", scene)]
        server = self.start("server", NVE, "serve", *words, "--listen", "127.0.0.1:0", *more)
        server.address = server.said(r"serving .* on (127\.0\.0\.1:\d+)")
        return server

    def station(self, server, *words):
        return self.run_program(MASTER, "run", "--server", server.address, "--duration-s", "1", "--task", "indent", "--rt-priority", "0", *words)

    def scene_of(self, done):
        self.assertEqual(done.returncode, 0, done.stderr)
        return re.search(r"session [0-9a-f]{16} on scene '(.*?)', method (\w+)", done.stderr).groups()

    def test_a_station_begins_in_the_first_and_may_have_another(self):
        server = self.server(FIRST, SECOND, more=("--audit", "audit.jsonl"))
        done = self.station(server)
        first, _ = self.scene_of(done)
        names = re.search(r"this server has 2 scenes: (.*) \(--server-scene NAME\)", done.stderr)[1].split(", ")
        self.assertEqual(names[0], first)
        plan = self.run_program(MASTER, "plan", "--server", server.address, "--server-scene", names[1], "--felt")
        self.assertEqual(plan.returncode, 0, plan.stderr)
        self.assertIn(f"scene_1,{names[0]},\nscene_2,{names[1]},\n", plan.stdout)
        self.assertIn(f"\nscene,{names[1]},\n", plan.stdout)
        # The second one is felt as it is there: with a twin of its own, where it is soft.
        done = self.station(server, "--server-scene", names[1], "--method", "twin", "--record", "second.h5")
        self.assertEqual(self.scene_of(done), (names[1], "twin"))
        self.assertNotIn("no twin", done.stderr)
        self.assertNotIn("another scene", done.stdout + done.stderr)
        self.assertIn(names[1].encode(), (self.folder / "second.h5").read_bytes())
        # Who has asked for the one that it begins with stays there.
        self.assertEqual(self.scene_of(self.station(server, "--server-scene", names[0]))[0], first)
        server.signal(15)
        self.assertEqual(server.end(), 0)
        self.assertIn("switches of a session to another scene: 2", server.text())
        self.assertEqual((self.folder / "audit.jsonl").read_text().count('"scene switched"'), 2)

    def refused(self, done, pattern, code):
        self.assertEqual(done.returncode, code, done.stderr)
        lines = [line for line in done.stderr.splitlines() if not line.startswith("note:")]
        self.assertEqual(len(lines), 1, done.stderr)
        self.assertRegex(lines[0], pattern)

    def test_a_scene_that_is_not_there_is_one_line(self):
        server = self.server(FIRST, SECOND)
        self.refused(self.station(server, "--server-scene", "nowhere"), "--server-scene 'nowhere': the server has .*, ", 1)
        server.signal(15)
        server.end()
        server = self.server(FIRST)
        done = self.station(server)
        alone, _ = self.scene_of(done)
        self.assertNotIn("scenes:", done.stderr)
        self.refused(self.station(server, "--server-scene", "nowhere"), "'nowhere': the server serves only '.*'", 1)
        self.assertEqual(self.scene_of(self.station(server, "--server-scene", alone))[0], alone)

    def restarted(self, server, *scenes):
        """It dies with no word, and another one begins at its address."""
        server.kill()
        words = [word for scene in scenes for word in ("--scene", scene)]
        again = self.start("again", NVE, "serve", *words, "--listen", server.address)
        again.said(r"serving .* on (127\.0\.0\.1:\d+)")
        return again

    def station_in_the_second(self, server, method):
        words = ("--server", server.address, "--server-scene", SECOND, "--method", method, "--duration-s", "6", "--task", "indent",
                 "--rt-priority", "0", "--record", "session.h5")
        station = self.start("station", MASTER, "run", *words)
        self.wait_for(lambda: re.search(r"engaged", station.text()), "the touch")
        return station

    def test_a_station_asks_a_restarted_server_for_its_scene_again(self):
        for method in ("tank", "twin"):
            with self.subTest(method):
                server = self.server(FIRST, SECOND)
                station = self.station_in_the_second(server, method)
                again = self.restarted(server, FIRST, SECOND)
                self.assertEqual(station.end(), 0, station.text())
                self.assertNotIn("another scene", station.text())
                again.signal(15)
                self.assertEqual(again.end(), 0)
                self.assertIn("switches of a session to another scene: 1", again.text())
                (self.folder / "session.h5").unlink()

    def test_a_station_whose_scene_is_refused_stops(self):
        server = self.server(FIRST, SECOND)
        station = self.station_in_the_second(server, "tank")
        again = self.restarted(server, FIRST, "flakes")
        self.assertEqual(station.end(), 1, station.text())
        self.assertIn("another scene", station.text())
        again.signal(15)
        self.assertEqual(again.end(), 0)
        self.assertNotIn("switches of a session", again.text())

    def test_what_is_of_one_scene_only_is_refused_with_several(self):
        for words, flag in ((("--share", "one-tip"), "--share one-tip"),
                            (("--web", "127.0.0.1:0"), "--web"), (("--slave", "nanonis"), "--scene")):
            done = self.run_program(NVE, "serve", "--scene", FIRST, "--scene", SECOND, "--listen", "127.0.0.1:0", *words)
            self.refused(done, f"{flag}: ", 2)
        done = self.run_program(NVE, "serve", "--scene", FIRST, "--scene", FIRST, "--listen", "127.0.0.1:0")
        self.refused(done, "given twice", 2)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
