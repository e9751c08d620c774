"""What the tests of the real programs share: where they are, children that do not outlive a test, sockets and a clock."""
import os
import pathlib
import re
import signal
import socket
import subprocess
import threading
import time

SCENES = pathlib.Path(os.environ["TELENANO_SOURCE_DIR"]) / "deploy" / "scenes"
LONG_S = 60  # only what hangs takes so long


def now_ns():
    return time.monotonic_ns()


class Child:
    """A program whose standard error is kept line by line; killed, if it still runs, when the test is over."""

    def __init__(self, test, *command):
        self.process = subprocess.Popen([str(word) for word in command], stderr=subprocess.PIPE, text=True)
        self.lines = []
        self.reader = threading.Thread(target=lambda: self.lines.extend(iter(self.process.stderr.readline, "")))
        self.reader.start()
        test.addCleanup(self.kill)

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.reader.join()
        self.process.stderr.close()

    def said(self):
        return "".join(self.lines)

    def wait_for(self, pattern):
        end = time.monotonic() + LONG_S
        while time.monotonic() < end:
            match = re.search(pattern, self.said())
            if match:
                return match
            assert self.process.poll() is None, self.said()
            time.sleep(0.005)
        raise AssertionError(f"no '{pattern}' in: {self.said()}")

    def wait(self):
        code = self.process.wait(LONG_S)
        self.reader.join()
        return code

    def stop(self):
        self.process.send_signal(signal.SIGTERM)
        return self.wait()


def serve(test, scene, *more):
    """telenano-nve serve on a free port of loopback: the child and its address."""
    child = Child(test, os.environ["TELENANO_NVE"], "serve", "--scene", SCENES / f"{scene}.toml", "--listen", "127.0.0.1:0",
                  *more)
    return child, ("127.0.0.1", int(child.wait_for(r"serving .* on 127\.0\.0\.1:(\d+)[,\n]").group(1)))


def udp(test, *address):
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    test.addCleanup(sock.close)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    sock.bind(*address or (("127.0.0.1", 0),))
    return sock


def counted(text):
    """{cause: count} of the last "dropped: ..." that a program has said."""
    return {cause: int(count) for cause, count in re.findall(r"(\w+) (\d+)", text[text.rindex("dropped: ") + 9:])}
