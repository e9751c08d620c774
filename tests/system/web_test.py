"""The browsers' view of a running server, asked with raw sockets: who is let in, and what is served.

The oracle of the protocol is RFC 6455 and RFC 9112 as written here by hand; of the numbers, where the tip may be.
"""

import array
import base64
import csv
import hashlib
import io
import json
import os
import pathlib
import random
import re
import select
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import unittest

import side_by_side

NVE, MASTER, SCENE = sys.argv[1:4]
SCANS = pathlib.Path(__file__).resolve().parents[2] / "deploy" / "data"
PATIENCE_S = 30  # for an event on a loaded machine; nothing is shown by how long it takes


class Server:
    def __init__(self, *flags, web="127.0.0.1:0", scene=SCENE):
        self.process = subprocess.Popen(
            [NVE, "serve", "--scene", scene, "--listen", "127.0.0.1:0", "--web", web, *flags],
            stderr=subprocess.PIPE)
        self.log = ""
        self.port = int(self.until(r"web view.*http://(?:127\.0\.0\.1|\[::1\])(?::(\d+))?/").group(1) or 80)
        self.udp = self.until(r"serving .* on (127\.0\.0\.1:\d+)").group(1)

    def until(self, pattern, after=0):
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            found = re.search(pattern, self.log[after:])
            if found:
                return found
            if select.select([self.process.stderr], [], [], 0.2)[0]:
                piece = os.read(self.process.stderr.fileno(), 65536).decode()
                if not piece:
                    break
                self.log += piece
        raise AssertionError(f"no {pattern!r} in:\n{self.log}")

    def token(self):
        """The newest that was printed."""
        self.until(r"token=[0-9a-f]{32}")
        while select.select([self.process.stderr], [], [], 0)[0]:
            self.log += os.read(self.process.stderr.fileno(), 65536).decode()
        return re.findall(r"token=([0-9a-f]{32})", self.log)[-1]

    def close(self):
        self.process.send_signal(signal.SIGINT)
        self.process.wait(PATIENCE_S)
        self.process.stderr.close()

    def raw(self, data):
        """What comes until the server closes."""
        with socket.create_connection(("127.0.0.1", self.port), PATIENCE_S) as s:
            try:
                s.sendall(data)
                answer = b""
                while piece := s.recv(65536):
                    answer += piece
            except ConnectionError:
                pass
            return answer

    def get(self, path, host=None, **headers):
        lines = [f"GET {path} HTTP/1.1", f"Host: {host or f'127.0.0.1:{self.port}'}"]
        lines += [f"{k}: {v}" for k, v in headers.items()]
        head, _, body = self.raw("\r\n".join(lines + ["", ""]).encode()).partition(b"\r\n\r\n")
        return int(head.split()[1]), head.decode(), body

    def cookie(self):
        mark = len(self.log)
        status, head, body = self.get("/?token=" + self.token())
        # A page that goes on by itself, no redirect: after a link of another site a browser would keep a Strict cookie back.
        assert status == 200 and b'http-equiv=refresh content="0;url=/"' in body, head
        self.until(r"token=[0-9a-f]{32}", mark)  # the next one
        assert "HttpOnly" in head and "SameSite=Strict" in head, head
        return re.search(r"Set-Cookie: ([^;]+)", head).group(1)

    def live(self, cookie, origin=None, host=None):
        s = socket.create_connection(("127.0.0.1", self.port), PATIENCE_S)
        key = base64.b64encode(os.urandom(16)).decode()
        lines = ["GET /live HTTP/1.1", f"Host: {host or f'127.0.0.1:{self.port}'}", "Upgrade: websocket",
                 "Connection: Upgrade", f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13",
                 f"Cookie: {cookie}"]
        if origin is None:
            origin = f"http://127.0.0.1:{self.port}"
        if origin:
            lines.append(f"Origin: {origin}")
        s.sendall("\r\n".join(lines + ["", ""]).encode())
        head = b""
        while b"\r\n\r\n" not in head:
            piece = s.recv(1)
            if not piece:
                break
            head += piece
        status = int(head.split()[1])
        if status == 101:
            magic = key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"  # RFC 6455, 1.3
            want = base64.b64encode(hashlib.sha1(magic.encode()).digest())
            assert want in head, head
        return status, s


def exactly(s, n):
    data = b""
    while len(data) < n:
        piece = s.recv(n - len(data))
        if not piece:
            raise EOFError
        data += piece
    return data


def frame(s):
    first, length = exactly(s, 2)
    if length == 126:
        length, = struct.unpack(">H", exactly(s, 2))
    return first & 15, exactly(s, length)


def has_end(s):
    """The other end has closed; what has come is left alone (TCP_INFO's first byte is the state, 1 = established)."""
    return s.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 1)[0] != 1


def ended(s):
    try:
        while frame(s)[0] != 8:
            pass
    except (EOFError, ConnectionError):
        pass
    s.close()
    return True


class Web(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.server = Server("--web-clients", "2")

    @classmethod
    def tearDownClass(cls):
        cls.server.close()

    def test_nothing_without_a_token_and_each_works_once(self):
        s = self.server
        for path in ("/", "/surface", "/view.js", "/three.js", "/?token=", "/?token=" + "0" * 32):
            self.assertEqual(s.get(path)[0], 403, path)
        first = s.token()
        cookie = s.cookie()
        self.assertEqual(s.get("/?token=" + first)[0], 403)
        status, head, body = s.get("/", Cookie=cookie)
        self.assertEqual(status, 200)
        self.assertIn("default-src 'none'", head)
        self.assertNotIn(b"http", body.replace(b"</html", b"").replace(b"<!doctype", b""))  # no other host
        self.assertEqual(s.get("/", Cookie=cookie[:-1] + ("0" if cookie[-1] != "0" else "1"))[0], 403)

    def test_a_foreign_host_or_origin_gets_nothing(self):
        s = self.server
        cookie = s.cookie()
        self.assertEqual(s.get("/", host=f"evil.example:{s.port}", Cookie=cookie)[0], 403)
        self.assertEqual(s.get("/", host="127.0.0.1", Cookie=cookie)[0], 403)
        self.assertEqual(s.get("/surface", Cookie=cookie, Origin="http://evil.example")[0], 403)
        for origin in ("http://evil.example", "null", "", f"https://127.0.0.1:{s.port}"):
            status, connection = s.live(cookie, origin=origin)
            connection.close()
            self.assertEqual(status, 403, origin)
        status, connection = s.live("telenano=0")
        connection.close()
        self.assertEqual(status, 403)

    def test_what_is_no_bounded_request_ends(self):
        s = self.server
        host = f"Host: 127.0.0.1:{s.port}\r\n".encode()
        self.assertEqual(s.raw(b"GET / HTTP/1.1\r\n" + host + b"X: " + b"a" * 20000 + b"\r\n\r\n"), b"")
        self.assertEqual(s.raw(b"GET /" + b"a" * 20000), b"")
        self.assertEqual(s.raw(os.urandom(3000) + b"\r\n\r\n"), b"")
        self.assertNotIn(b"200", s.raw(b"POST / HTTP/1.1\r\n" + host + b"Content-Length: 5\r\n\r\nhello")[:20])
        self.assertEqual(s.raw(b"GET / HT"), b"")  # half a request: closed after its time
        self.assertEqual(s.get("/", Cookie=s.cookie())[0], 200)

    def test_any_word_of_a_browser_ends_its_connection(self):
        s = self.server
        cookie = s.cookie()
        masked = b"\0\0\0\0"
        for words in (b"\x81\x82" + masked + b"hi", b"\x82\x82" + masked + b"hi", b"\x89\x80" + masked,
                      b"\x81\x02hi", os.urandom(64), b"\x81\xff" + b"\x7f" * 8 + masked):
            status, connection = s.live(cookie)
            self.assertEqual(status, 101, words)
            frame(connection)
            connection.sendall(words)
            self.assertTrue(ended(connection), words)

    def test_places_are_bounded_and_become_free(self):
        s = self.server
        cookie = s.cookie()
        two = [s.live(cookie) for _ in range(2)]
        self.assertEqual([status for status, _ in two], [101, 101])
        status, third = s.live(cookie)
        third.close()
        self.assertEqual(status, 503)
        for _, connection in two:
            connection.close()
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:  # until the server has seen it
            status, again = s.live(cookie)
            again.close()
            if status == 101:
                break
        self.assertEqual(status, 101)

    def test_a_session_is_seen(self):
        s = self.server
        cookie = s.cookie()
        _, _, body = s.get("/surface", Cookie=cookie)
        columns, rows = struct.unpack_from("<II", body, 4)
        self.assertEqual((body[:4], len(body)), (b"TNHG", 28 + 4 * columns * rows))
        status, connection = s.live(cookie)
        self.assertEqual(status, 101)
        before = json.loads(frame(connection)[1])
        self.assertEqual(before, {"mode": "SIM", "sessions": 0, "tips": []})
        station = subprocess.Popen([MASTER, "run", "--server", s.udp, "--duration-s", "20"],
                                   stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        try:
            end = time.monotonic() + PATIENCE_S
            seen = before
            while time.monotonic() < end and not seen["tips"]:
                kind, text = frame(connection)
                if kind == 1:
                    seen = json.loads(text)
            self.assertEqual((seen["sessions"], len(seen["tips"])), (1, 1), seen)
            self.assertEqual(set(seen["tips"][0]), {"p", "f", "c", "e"})  # no name, key or address
        finally:
            connection.close()
            station.kill()
            station.communicate()


    def test_what_is_shown_is_what_the_station_got(self):
        """Every shown pair of tip and force, to the last bit, is a row of the recording of the same session."""
        s = self.server
        with tempfile.TemporaryDirectory(prefix="telenano_web_") as folder:
            recording = pathlib.Path(folder) / "session.h5"
            status, connection = s.live(s.cookie())
            self.assertEqual(status, 101)
            station = subprocess.Popen([MASTER, "run", "--server", s.udp, "--task", "indent", "--duration-s", "6", "--quiet",
                                        "--rt-priority", "0", "--method", "model", "--record", str(recording)],
                                       stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
            shown, began = set(), False
            while True:
                kind, text = frame(connection)
                state = json.loads(text) if kind == 1 else {"sessions": 1, "tips": []}
                began = began or state["sessions"] > 0
                shown.update((*tip["p"], *tip["f"]) for tip in state["tips"])
                if began and station.poll() is not None:
                    break
            connection.close()
            self.assertEqual(station.returncode, 0, station.communicate()[1])
            station.stderr.close()
            text = subprocess.run([MASTER, "export", str(recording), "--columns", "tip_pos_w_nm,force_w_nn"],
                                  capture_output=True, text=True, check=True, timeout=60).stdout
        rows = {tuple(map(float, (row[c + a] for c in ("tip_pos_w_nm_", "force_w_nn_") for a in "xyz")))
                for row in csv.DictReader(io.StringIO(text))}
        self.assertGreater(len(shown), 60)  # 6 s at 30 a second, half of them at rest or lost by a busy machine
        self.assertGreater(max(v[5] for v in shown), 1)  # it has touched
        # The recording has one row a tick, so that a reply that came together with the next is not in it; on a
        # busy machine that may be one in three. A wrong sign, order or unit leaves none.
        self.assertGreater(len(shown & rows), 0.6 * len(shown), sorted(shown - rows)[:3])

    def test_the_surface_is_the_scan(self):
        """Against the .gsf as read here: heights between those of the pixels around, the right way up."""
        header, _, rest = (SCANS / "wsxm_600nm.gsf").read_bytes().partition(b"\0")
        fields = dict(line.split(" = ", 1) for line in header.decode().splitlines()[1:] if " = " in line)
        columns, rows = int(fields["XRes"]), int(fields["YRes"])
        start = len(header) + 4 - len(header) % 4  # 1 to 4 zeros after the header
        z = array.array("f", (header + b"\0" + rest)[start:start + 4 * columns * rows])
        lowest = min(z)
        dx, dy = 1e9 * float(fields["XReal"]) / columns, 1e9 * float(fields["YReal"]) / rows
        _, _, body = self.server.get("/surface", Cookie=self.server.cookie())
        nx, ny, step_x, step_y, x0, y0 = struct.unpack_from("<IIffff", body, 4)
        shown = array.array("f", body[28:])
        inside = turned = 0
        for j in range(ny):
            for i in range(nx):
                # Pixels are centred at half-numbers; the file's first row is the image's top.
                c, r = int((x0 + i * step_x) / dx - 0.5), int((y0 + j * step_y) / dy - 0.5)

                def lies(height, row_of):
                    near = [1e9 * (z[row_of(y) * columns + x] - lowest)
                            for y in range(max(r - 1, 0), min(r + 3, rows)) for x in range(max(c - 1, 0), min(c + 3, columns))]
                    # A cubic spline overshoots an edge by less than a quarter of it; 0.05 nm: pixels farther off.
                    margin = 0.25 * (max(near) - min(near)) + 0.05
                    return min(near) - margin <= height <= max(near) + margin

                inside += lies(shown[j * nx + i], lambda y: rows - 1 - y)
                turned += lies(shown[j * nx + i], lambda y: y)
        self.assertGreater(inside, 0.99 * nx * ny)
        self.assertLess(turned, 0.8 * nx * ny)  # that this test can tell

    def test_marks_that_are_taken_back_at_a_shared_tip_are_gone_here_too(self):
        """The groove is in the surface until its maker takes it back; then the surface is flat again, in half a second."""
        with tempfile.TemporaryDirectory(prefix="telenano_web_") as folder:
            s = Server("--share", "one-tip", scene="lithography")
            self.addCleanup(s.close)
            cookie = s.cookie()

            def lowest():
                return min(array.array("f", s.get("/surface", Cookie=cookie)[2][28:]))

            status, connection = s.live(cookie)
            self.assertEqual(status, 101)
            groove = pathlib.Path(folder) / "groove.csv"
            groove.write_text("t_s,x_nm,y_nm,z_nm\n0,0,0,10\n1,0,0,-4\n2,40,0,-4\n2.5,40,0,10\n8,40,0,10\n")
            station = subprocess.Popen([MASTER, "run", "--server", s.udp, "--task", "script", "--script", str(groove), "--quiet",
                                        "--rt-priority", "0", "--undo-marks-at", "5.5"],
                                       stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            deepest, flat_at, number, last = 0.0, None, 0, time.monotonic()
            while station.poll() is None:
                kind, text = frame(connection)
                if kind != 1:
                    continue
                state = json.loads(text)
                if state.get("marks", 0) != number:
                    number, last = state["marks"], time.monotonic()
                    now = lowest()
                    deepest = min(deepest, now)
                    if deepest < -0.5 and now > -1e-3 and flat_at is None:
                        flat_at = last
            out, err = station.communicate()
            connection.close()
            self.assertIn(b"last stroke of marks taken back", out, err)
            self.assertLess(deepest, -0.5)
            self.assertIsNotNone(flat_at, "a browser is told that the surface is another one")
            self.assertGreater(lowest(), -1e-3)

    def test_marks_are_shown_while_they_are_made(self):
        """At the end the surface is what the server keeps in a file of its own, read and interpolated here."""
        with tempfile.TemporaryDirectory(prefix="telenano_web_") as folder:
            s = Server("--save-surface", folder, scene="lithography")
            self.addCleanup(s.close)
            cookie = s.cookie()
            status, connection = s.live(cookie)
            self.assertEqual(status, 101)
            unmarked = array.array("f", s.get("/surface", Cookie=cookie)[2][28:])
            self.assertEqual(set(unmarked), {0.0})
            groove = pathlib.Path(folder) / "groove.csv"  # along x, so that x for y is seen
            groove.write_text("t_s,x_nm,y_nm,z_nm\n0,0,0,10\n1,0,0,-4\n3,40,0,-4\n3.5,40,0,10\n")
            station = subprocess.Popen([MASTER, "run", "--server", s.udp, "--task", "script", "--script", str(groove), "--quiet",
                                        "--rt-priority", "0"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
            numbers = []
            while station.poll() is None or len(numbers) < 2:
                kind, text = frame(connection)
                state = json.loads(text) if kind == 1 else {}
                if "marks" in state and state["marks"] not in numbers:
                    numbers.append(state["marks"])
            self.assertEqual(station.returncode, 0, station.communicate()[1])
            station.stderr.close()
            connection.close()
            self.assertGreater(len(numbers), 3)
            self.assertEqual(numbers, sorted(numbers))
            _, _, body = s.get("/surface", Cookie=cookie)
            kept = pathlib.Path(folder) / "lithography-1.gsf"
            end = time.monotonic() + PATIENCE_S
            s.process.send_signal(signal.SIGINT)
            while s.process.poll() is None and time.monotonic() < end:
                time.sleep(0.1)
            header, _, _ = kept.read_bytes().partition(b"\0")
            fields = dict(line.split(" = ", 1) for line in header.decode().splitlines()[1:] if " = " in line)
            self.assertEqual(fields["TelenanoFrame"], "W")
            columns, rows = int(fields["XRes"]), int(fields["YRes"])
            start = len(header) + 4 - len(header) % 4
            z = array.array("f", kept.read_bytes()[start:start + 4 * columns * rows])
        dx, dy = 1e9 * float(fields["XReal"]) / columns, 1e9 * float(fields["YReal"]) / rows
        left, below = 1e9 * float(fields["XOffset"]) + dx / 2, 1e9 * float(fields["YOffset"]) + dy / 2
        nx, ny, step_x, step_y, x0, y0 = struct.unpack_from("<IIffff", body, 4)
        shown = array.array("f", body[28:])
        self.assertLess(min(shown), -0.3)
        for j in range(ny):
            for i in range(nx):
                c = min(max((x0 + i * step_x - left) / dx, 0), columns - 1)
                r = min(max((y0 + j * step_y - below) / dy, 0), rows - 1)
                c0, r0 = min(int(c), columns - 2), min(int(r), rows - 2)
                u, v = c - c0, r - r0
                at = lambda row, column: 1e9 * z[(rows - 1 - row) * columns + column]  # noqa: E731  top row first
                height = ((1 - u) * (1 - v) * at(r0, c0) + u * (1 - v) * at(r0, c0 + 1) + (1 - u) * v * at(r0 + 1, c0) +
                          u * v * at(r0 + 1, c0 + 1))
                # Single precision of places (300 nm) times slopes below 1.
                self.assertAlmostEqual(shown[j * nx + i], height, delta=1e-4)

    def test_who_does_not_read_loses_its_place(self):
        """One says nothing more at all; one answers pings (a pong is allowed) but never reads a picture."""
        s = self.server
        cookie = s.cookie()
        silent = s.live(cookie)
        slow = socket.socket()
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        slow.connect(("127.0.0.1", s.port))
        slow.sendall(("GET /live HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nOrigin: http://127.0.0.1:%d\r\nUpgrade: websocket\r\n"
                      "Connection: Upgrade\r\nSec-WebSocket-Key: %s\r\nSec-WebSocket-Version: 13\r\nCookie: %s\r\n\r\n"
                      % (s.port, s.port, base64.b64encode(bytes(16)).decode(), cookie)).encode())
        self.addCleanup(slow.close)
        self.addCleanup(silent[1].close)
        end = time.monotonic() + 120
        ended_slow = ended_silent = False
        while time.monotonic() < end and not (ended_slow and ended_silent):
            time.sleep(0.5)
            try:
                slow.sendall(b"\x8a\x80\0\0\0\0")
            except ConnectionError:
                ended_slow = True
            # A reset or end of the silent one shows without reading its pictures.
            ended_silent = ended_silent or has_end(silent[1])
        self.assertTrue(ended_slow, "the slow reader was kept")
        self.assertTrue(ended_silent, "the silent one was kept")
        status, reader = s.live(cookie)
        reader.close()
        self.assertEqual(status, 101)

    def test_bytes_that_are_nearly_a_request(self):
        """One byte of a good request changed, left out or put in, 300 times: it is answered or closed, and the next is served."""
        s = self.server
        cookie = s.cookie()
        good = f"GET /surface HTTP/1.1\r\nHost: 127.0.0.1:{s.port}\r\nCookie: {cookie}\r\n\r\n".encode()
        dice = random.Random(1)
        for _ in range(300):
            at = dice.randrange(len(good) - 4)  # what ends the header stays, or each would wait for its time-out
            bad = good[:at] + dice.choice((bytes([dice.randrange(256)]), b"", bytes([dice.randrange(256)] * 2))) + good[at + 1:]
            answer = s.raw(bad)
            self.assertTrue(answer == b"" or re.match(rb"HTTP/1\.[01] (200|403|404|405) ", answer), (bad, answer[:60]))
        self.assertEqual(s.get("/", Cookie=cookie)[0], 200)


class BadInput(unittest.TestCase):
    def refused(self, *flags):
        run = subprocess.run([NVE, "serve", "--scene", SCENE, "--listen", "127.0.0.1:0", *flags],
                             capture_output=True, text=True, timeout=60)
        self.assertEqual(run.returncode, 2, run.stderr)
        self.assertIn("--web", run.stderr.strip().splitlines()[-1])

    def test_every_address_is_opened_as_it_is_printed(self):
        # Port 80 is not written by a browser; a wildcard is no address to open; a socket for both kinds says v4 as v6.
        tried = 0
        for web in ("127.0.0.1:80", "127.0.0.1:0", "[::1]:0", "0.0.0.0:0", "[::]:0"):
            family = socket.AF_INET6 if web[0] == "[" else socket.AF_INET
            try:
                host, _, port = web.rpartition(":")
                with socket.socket(family) as s:
                    s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                    s.bind((host.strip("[]"), int(port)))
            except OSError:
                continue  # this machine has no such address, or somebody is there
            server = Server(*(["--web-public"] if host in ("0.0.0.0", "[::]") else []), web=web)
            try:
                server.token()
                line = re.search(r"web view.*", server.log).group(0)
                urls = re.findall(r"http://([^/ ]+)/\?token=[0-9a-f]{32}", line)
                self.assertIn("127.0.0.1", line.replace("[::1]", "127.0.0.1"))
                self.assertNotRegex(line, r"//0\.0\.0\.0|//\[::\]|::ffff|:80/")
                for url in urls:
                    name = re.fullmatch(r"\[?([^\]]*?)\]?(?::(\d+))?", url)
                    for host in [url] + (["localhost" + url[len(name.group(1)):]] if name.group(1) == "127.0.0.1" else []):
                        answer = b""
                        token = server.token()
                        mark = len(server.log)
                        with socket.create_connection((name.group(1), int(name.group(2) or 80)), PATIENCE_S) as s:
                            s.sendall(f"GET /?token={token} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
                            while piece := s.recv(65536):
                                answer += piece
                        self.assertIn(b" 200 ", answer.split(b"\r\n")[0], (web, host, answer))
                        server.until(r"token=[0-9a-f]{32}", mark)  # the next one
                        tried += 1
            finally:
                server.close()
        self.assertGreaterEqual(tried, 2)

    def test_a_bad_public_or_taken_address_is_one_line(self):
        self.refused("--web", "nonsense")
        self.refused("--web", "0.0.0.0:0")
        with socket.create_server(("127.0.0.1", 0)) as taken:
            self.refused("--web", f"127.0.0.1:{taken.getsockname()[1]}")


if __name__ == "__main__":
    sys.exit(side_by_side.main(3, at_once=3))  # each case waits for most of its time
