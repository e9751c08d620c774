#!/usr/bin/env python3
"""The view in a real browser: headless Chromium opens the printed address while a station moves the tip.

web_browser_test.py TELENANO_NVE TELENANO_MASTER SCENE PICTURE.png

It speaks the DevTools protocol over a plain WebSocket. The picture is for a person; what is asserted is read from the pixels of the page's own
canvases and from its words. Exit 77, with the reason, where there is no Chromium or no three.js.
"""

import base64
import json
import os
import pathlib
import re
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import time

THREE = "/usr/share/javascript/three/three.min.js"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
if not CHROMIUM:
    print("skipped: no Chromium (apt install chromium)")
    sys.exit(77)
if not os.path.exists(THREE):
    print("skipped: no three.js (apt install libjs-three)")
    sys.exit(77)

import unittest  # noqa: E402

import web_test  # noqa: E402  (reads the first three arguments)

PICTURE = pathlib.Path(sys.argv[4])
PATIENCE_S = 90  # for an event: a software renderer beside a busy machine


class Browser:
    """A page of Chromium, driven over its DevTools socket."""

    def __init__(self):
        self.folder = tempfile.TemporaryDirectory(prefix="telenano_chromium_", ignore_cleanup_errors=True)
        self.process = subprocess.Popen(
            [CHROMIUM, "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader",
             "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--no-first-run", "--disable-background-networking",
             "--window-size=980,900", "--remote-debugging-port=0", f"--user-data-dir={self.folder.name}", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.number = 0
        port_file = pathlib.Path(self.folder.name) / "DevToolsActivePort"
        self.until(lambda: port_file.exists() and port_file.read_text().count("\n") >= 1)
        port = int(port_file.read_text().splitlines()[0])
        page = self.until(lambda: self.page(port))
        self.socket = socket.create_connection(("127.0.0.1", port), PATIENCE_S)
        path = page["webSocketDebuggerUrl"].split(str(port), 1)[1]
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall((f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                             f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n").encode())
        head = b""
        while b"\r\n\r\n" not in head:
            head += web_test.exactly(self.socket, 1)
        assert b" 101 " in head, head
        self.errors = []
        self.call("Page.enable")
        self.call("Runtime.enable")
        self.call("Log.enable")

    @staticmethod
    def until(condition):
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            value = condition()
            if value:
                return value
            time.sleep(0.1)
        raise AssertionError("it did not come")

    @staticmethod
    def page(port):
        with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as s:
            s.sendall(f"GET /json/list HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
            head = b""
            while b"\r\n\r\n" not in head:
                head += web_test.exactly(s, 1)
            body = web_test.exactly(s, int(re.search(rb"Content-Length: *(\d+)", head, re.I)[1]))
        return next((one for one in json.loads(body) if one["type"] == "page"), None)

    def message(self):
        whole = b""
        while True:
            first, length = web_test.exactly(self.socket, 2)
            if length == 126:
                length, = struct.unpack(">H", web_test.exactly(self.socket, 2))
            elif length == 127:
                length, = struct.unpack(">Q", web_test.exactly(self.socket, 8))
            whole += web_test.exactly(self.socket, length)
            if first & 128:
                return json.loads(whole)

    def call(self, method, **params):
        self.number += 1
        text = json.dumps({"id": self.number, "method": method, "params": params}).encode()
        self.socket.sendall(b"\x81\xff" + struct.pack(">Q", len(text)) + b"\0\0\0\0" + text)  # mask 0
        while True:
            m = self.message()
            if m.get("method") == "Runtime.exceptionThrown":
                self.errors.append(m["params"]["exceptionDetails"])
            if m.get("method") == "Log.entryAdded" and m["params"]["entry"]["level"] == "error":
                self.errors.append(m["params"]["entry"])
            if m.get("id") == self.number:
                assert "error" not in m, m
                return m["result"]

    def value(self, expression):
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def picture(self, path):
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def close(self):
        self.socket.close()
        self.process.terminate()
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.folder.cleanup()


# How many pixels of a chart have the curve's colour, and over how many rows and columns they spread.
CURVE = """(id => { const c = document.getElementById(id), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
  let n = 0, rows = new Set(), columns = new Set();
  for (let i = 0; i < d.length; i += 4) if (d[i] > 200 && d[i + 1] > 160 && d[i + 2] < 150 && d[i + 3] > 128) {
    ++n; rows.add(Math.floor(i / 4 / c.width)); columns.add(i / 4 % c.width); }
  return [n, rows.size, columns.size]; })"""

# The scene is copied in the same turn in which it is drawn: its buffer is not kept after that.
SCENE = """new Promise(done => { const draw = three; three = tip => { draw(tip); three = draw;
  const from = document.querySelector('#scene canvas'), c = document.createElement('canvas');
  c.width = from.width; c.height = from.height; const g = c.getContext('2d'); g.drawImage(from, 0, 0);
  const d = g.getImageData(0, 0, c.width, c.height).data; let drawn = 0, arrow = 0, white = 0, trail = 0; const colours = new Set();
  for (let i = 0; i < d.length; i += 4) if (d[i + 3] > 0 && d[i] + d[i + 1] + d[i + 2] > 60) {
    ++drawn; colours.add((d[i] >> 4) * 256 + (d[i + 1] >> 4) * 16 + (d[i + 2] >> 4));
    if (d[i] > 240 && d[i + 1] > 70 && d[i + 1] < 110 && d[i + 2] < 80) ++arrow;
    if (d[i] > 180 && Math.abs(d[i] - d[i + 1]) < 6 && Math.abs(d[i] - d[i + 2]) < 6) ++white;
    if (d[i] < 140 && d[i + 1] > 180 && d[i + 2] > 220) ++trail; }
  done({drawn, arrow, white, trail, colours: colours.size, all: c.width * c.height}); }; })"""


class InABrowser(unittest.TestCase):
    def test_surface_tip_trail_arrow_and_charts_are_drawn(self):
        server = web_test.Server()
        self.addCleanup(lambda: server.process.poll() is None and server.close())
        station = subprocess.Popen([web_test.MASTER, "run", "--server", server.udp, "--task", "scan", "--duration-s", "120", "--quiet"],
                                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.addCleanup(lambda: (station.kill(), station.wait()))
        browser = Browser()
        self.addCleanup(browser.close)
        browser.call("Page.navigate", url=f"http://127.0.0.1:{server.port}/?token={server.token()}")
        browser.until(lambda: browser.value("document.readyState === 'complete' && location.pathname === '/' && location.search === ''"))
        browser.until(lambda: browser.value("three !== null && past.length > 150"))  # 150 pictures: 5 s at 30 a second
        browser.until(lambda: browser.value("past.some(s => s.n > 1)"))              # it has touched
        self.assertEqual(browser.value("document.getElementById('mode').textContent"), "SIM")
        self.assertRegex(browser.value("document.getElementById('words').textContent"), r"^1 session · .* nN, lateral .* nN · tip at ")
        # A curve over 5 s of 20 is a quarter of 900 columns; a touch is more than a line's width high.
        n, rows, columns = browser.value(CURVE + "('normal')")
        self.assertGreater(n, 200)
        self.assertGreater(columns, 150)
        self.assertGreater(rows, 20, "a touch, not a flat line")
        self.assertGreater(browser.value(CURVE + "('lateral')")[2], 150)

        def with_arrow():
            seen = browser.value(SCENE)
            return seen if seen["arrow"] > 5 else None

        seen = browser.until(with_arrow)  # while the tip touches
        browser.picture(PICTURE)
        self.assertGreater(seen["drawn"], 0.1 * seen["all"], "the surface fills a good part")
        self.assertGreater(seen["colours"], 20, "heights have colours")
        self.assertGreater(seen["white"], 30, "the tip")
        self.assertGreater(seen["trail"], 5, "where it was")
        self.assertEqual(browser.errors, [])  # no script error, nothing that the policy blocks
        server.close()
        browser.until(lambda: browser.value("document.getElementById('mode').textContent") == "CONNECTION LOST")
        self.assertIn("What you see is old", browser.value("document.getElementById('words').textContent"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
