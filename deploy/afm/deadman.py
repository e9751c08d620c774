#!/usr/bin/env python3
"""Withdraws an AFM's tip when the server that moves it is no longer heard.

Runs on the computer of the AFM's controller (Windows or Linux; Python 3.11 or newer, nothing else), because the controller's
protocol has no time-out of its own: a server whose machine loses its power or its network leaves the tip pressing. It owns the
controller's emergency port and passes on to it what the server's guard asks. The guard proves ten times a second, with a key that
both know, that the server is alive. When no proof has come for `silence_ms`, the tip is withdrawn and kept up until somebody has
looked and says `clear`.

    deadman.py new-key deadman.key             makes a key; the server needs a copy of it
    deadman.py run --config deadman.toml       runs until Ctrl-C
    deadman.py clear --config deadman.toml     after a withdrawal: the tip may be used again

The wire format is in nve_server/afm/README.md.
"""
import argparse
import collections
import datetime
import hashlib
import hmac
import os
import secrets
import selectors
import signal
import socket
import stat
import struct
import sys
import time

GREETING, BEAT = "Telenano.Deadman", "Telenano.Beat"
VERSION = 1
BEAT_BODY = struct.Struct(">16sQH32s")  # the guard's nonce, a number that grows, what the guard says, proof
ANSWER_BODY = struct.Struct(">QH32s")   # the beat's number, what the deadman says, proof
QUIET, WATCH, DONE = 0, 1, 2            # said by a guard: nothing has moved; watch over me; the tip is up and stays up
READY, LATCHED, IN_USE, NO_CONTROLLER = 0, 1, 2, 3  # said by the deadman
# What the emergency connection is for. Whatever else comes is answered with an error.
PASSED_ON = {"ZCtrl.StatusGet", "ZCtrl.Withdraw", "ZCtrl.ZPosGet", "ZCtrl.LimitsEnabledSet", "ZCtrl.LimitsSet", "FolMe.Stop",
             "Piezo.RangeGet"}
STRANGER_S = 2.0        # in which who connects must have proved to know the key
STRANGERS = 8           # of them at once
RECONNECT_S = 0.2
LIMITS_S = 0.05         # the withdrawal does not wait longer for an answer to what comes before it
REPLY_S = 1.0
SAME_M = 1e-9           # two heights that are one
UP_PART = 0.01          # of the range along Z: so far below where it stood withdrawn at the start a tip still is up
NOT_UP_S = 10.0         # between two lines that say that it is not
LOOK_S = 0.1            # between two looks at a tip that is up
PLACE_END = "m: Z of the withdrawn tip at the start, range of Z\n"


class ConfigError(Exception):
    """What a person can mend: one line."""


# ---- the protocol

def frame(name, body=b"", reply=0):
    return name.encode("ascii").ljust(32, b"\0") + struct.pack(">iHH", len(body), reply, 0) + body


def error_reply(name, text):
    return frame(name, struct.pack(">Ii", 1, len(text)) + text.encode("ascii"))


def proof(key, what, deadman_nonce, guard_nonce, number, state):
    text = what + deadman_nonce + guard_nonce + struct.pack(">QH", number, state)
    return hmac.new(key, text, hashlib.sha256).digest()


def beat_proof(key, deadman_nonce, guard_nonce, number, state):
    return proof(key, b"Telenano beat 1", deadman_nonce, guard_nonce, number, state)


def answer_proof(key, deadman_nonce, guard_nonce, number, state):
    return proof(key, b"Telenano answer 1", deadman_nonce, guard_nonce, number, state)


class Frames:
    """Cuts a stream into frames; ValueError where it is none."""

    def __init__(self, most):
        self.data, self.most = b"", most

    def feed(self, data):
        self.data += data
        while len(self.data) >= 40:
            size, reply, zero = struct.unpack(">iHH", self.data[32:40])
            if not 0 <= size <= self.most or zero != 0 or reply > 1:
                raise ValueError("no frame of the Nanonis protocol")
            if len(self.data) < 40 + size:
                return
            name = self.data[:32].rstrip(b"\0").decode("ascii")
            whole, self.data = self.data[:40 + size], self.data[40 + size:]
            yield name, whole[40:], whole


# ---- files

def read_key(path):
    try:
        if os.name == "posix" and stat.S_IMODE(os.stat(path).st_mode) & 0o077:
            raise ConfigError(f"{path}: holds a secret but others can read it; run: chmod 600 {path}")
        with open(path, encoding="ascii") as file:
            text = file.read(200).strip()
        key = bytes.fromhex(text)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}; make a key with: deadman.py new-key {path}") from None
    except ValueError:
        key = b""
    if len(key) != 32:
        raise ConfigError(f"{path}: expected 64 hexadecimal digits, as deadman.py new-key makes them")
    return key


def read_place(path):
    """Where the tip stood withdrawn, and the range along Z, in m; None, None where no whole line says so."""
    try:
        with open(path, encoding="ascii") as file:
            top, range_, end = file.read(200).split(" ", 2)
        top_m, range_m = float(top), float(range_)
    except (OSError, ValueError):
        return None, None
    return (top_m, range_m) if end == PLACE_END and 0 < abs(top_m) <= range_m < 1 else (None, None)


def address(config, path, key, default_port):
    text = config.pop(key, None)
    host, _, port = text.rpartition(":") if isinstance(text, str) else ("", "", "")
    if not host or not port.isdecimal() or not 0 <= int(port) <= 65535:
        raise ConfigError(f"{path}: {key}: expected \"HOST:PORT\", e.g. \"{default_port}\"")
    return host.strip("[]"), int(port)


class Config:
    def __init__(self, path):
        try:
            import tomllib
        except ImportError:
            raise ConfigError("this needs Python 3.11 or newer (tomllib)") from None
        try:
            with open(path, "rb") as file:
                config = tomllib.load(file)
        except OSError as error:
            raise ConfigError(f"{path}: {error.strerror}; expected a file like deploy/afm/deadman.toml") from None
        except tomllib.TOMLDecodeError as error:
            raise ConfigError(f"{path}: {error}") from None
        folder = os.path.dirname(os.path.abspath(path))

        def file_of(key, default=None):
            name = config.pop(key, default)
            if not isinstance(name, str) or not name:
                raise ConfigError(f"{path}: {key}: expected the name of a file")
            return os.path.join(folder, name)

        self.listen = address(config, path, "listen", "0.0.0.0:6514")
        self.controller = address(config, path, "controller", "127.0.0.1:6504")
        self.key = read_key(file_of("key"))
        self.latch = file_of("latch", "deadman.latch")
        self.place = self.latch + ".place"
        self.log = file_of("log") if "log" in config else None
        silence = config.pop("silence_ms", 500)
        if isinstance(silence, bool) or not isinstance(silence, (int, float)) or not 200 <= silence <= 900:
            raise ConfigError(f"{path}: silence_ms: expected 200 to 900 (ms): the tip is to be on its way up within a second")
        self.silence_s = 1e-3 * silence
        if config:
            raise ConfigError(f"{path}: {sorted(config)[0]}: no such key; there are listen, controller, key, silence_ms, latch, log")


# ---- connections

def plain_socket(connection):
    connection.setblocking(False)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


class Client:
    """Who has connected to the deadman: a stranger until a beat has proved the key."""

    def __init__(self, connection, peer, now):
        self.socket, self.peer, self.since = connection, f"{peer[0]}:{peer[1]}", now
        self.frames = Frames(4096)
        self.nonce = secrets.token_bytes(16)
        self.guard, self.number, self.heard, self.watched = None, 0, now, False

    def send(self, data):
        try:
            return self.socket.send(data) == len(data)
        except OSError:
            return False


class Controller:
    """The connection to the emergency port. One request is under way at a time, except that a withdrawal does not wait long."""

    def __init__(self, where, selector, say):
        self.where, self.selector, self.report = where, selector, say
        self.socket, self.up, self.told = None, False, False
        self.again, self.since, self.quiet_until = 0.0, 0.0, float("-inf")
        self.frames, self.asked = None, collections.deque()

    def connect(self, now):
        if self.socket or now < self.again:
            return
        self.again = now + RECONNECT_S
        try:
            family = socket.getaddrinfo(*self.where, type=socket.SOCK_STREAM)[0][0]
            self.socket = plain_socket(socket.socket(family, socket.SOCK_STREAM))
            self.socket.connect_ex(self.where)
            self.selector.register(self.socket, selectors.EVENT_WRITE, self)
        except OSError as error:
            self.lost(now, str(error))

    def connected(self, now):
        error = self.socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if error:
            return self.lost(now, os.strerror(error))
        self.up, self.told, self.since = True, False, now
        self.frames = Frames(1 << 18)
        self.selector.modify(self.socket, selectors.EVENT_READ, self)
        if now >= self.quiet_until:
            self.report(f"connected to the controller at {self.where[0]}:{self.where[1]}")

    def lost(self, now, why):
        if self.socket:
            try:
                self.selector.unregister(self.socket)
            except (KeyError, ValueError):
                pass
            self.socket.close()
        # A port that another program uses closes each connection at once: not two lines each time.
        if not self.told and now >= self.quiet_until:
            self.report(f"no connection to the controller at {self.where[0]}:{self.where[1]}: {why}; trying on")
        if self.up and now - self.since < 1:
            self.quiet_until = now + 60
        self.socket, self.up, self.told, self.again = None, False, True, now + RECONNECT_S
        self.asked.clear()

    def ask(self, now, owner, name, data):
        """False if it cannot be sent."""
        if not self.up:
            return False
        try:
            if self.socket.send(data) == len(data):
                self.asked.append((owner, name, now))
                return True
        except OSError:
            pass
        self.lost(now, "it takes nothing more")
        return False

    def waits_s(self, now):
        return now - self.asked[-1][2] if self.asked else 0.0


class Withdrawal:
    """Floor of the Z limits up, Withdraw, until it is over, the height; and again until two leave the tip at its place: where it
    stood withdrawn at the start. Then it looks on, and begins anew if the tip comes down. The floor holds back a command that was
    on its way when the server died."""

    def __init__(self, deadman, now):
        self.deadman, self.begun, self.at, self.asked = deadman, now, 0, False
        self.next, self.height, self.up, self.floor_tried = now, None, None, False
        self.off, self.gone, self.say = True, False, now

    def steps(self):
        d = self.deadman
        if self.up is not None:
            return [("ZCtrl.ZPosGet", b"")]
        steps = [("ZCtrl.Withdraw", struct.pack(">Ii", 0, -1)), ("ZCtrl.StatusGet", b""), ("ZCtrl.ZPosGet", b"")]
        floor = d.floor()
        if floor and not self.floor_tried:
            steps[:0] = [("ZCtrl.LimitsEnabledSet", struct.pack(">I", 1)), ("ZCtrl.LimitsSet", struct.pack(">ff", *floor))]
        return steps

    def tick(self, now):
        controller = self.deadman.controller
        if self.up is None and now > self.say + 3 * REPLY_S:
            self.say = now + NOT_UP_S
            self.deadman.report("the controller has not said yet that the tip is up; going on until it has")
        if not controller.up:
            self.at, self.asked, self.height = 0, False, None
            return
        steps = self.steps()
        name = steps[self.at][0]
        if self.asked:
            if name.startswith("ZCtrl.Limits") and controller.waits_s(now) > LIMITS_S:
                self.step(steps)        # at once: what is late is heard and passed over
            elif controller.waits_s(now) > REPLY_S:
                controller.lost(now, "it does not answer")
            return
        if now < self.next or (controller.asked and controller.waits_s(now) <= LIMITS_S):
            return
        name, body = steps[self.at]
        self.asked = controller.ask(now, self, name, frame(name, body, 1))

    def step(self, steps):
        self.asked = False
        if steps[self.at][0] == "ZCtrl.LimitsSet":
            self.floor_tried, self.at = True, 0     # steps() goes on without them
        else:
            self.at += 1

    def answered(self, name, body, now):
        steps = self.steps()
        if not self.asked or name != steps[self.at][0]:
            return
        good = len(body) >= 8 and struct.unpack(">Ii", body[-8:]) == (0, 0)
        if name.startswith("ZCtrl.Limits"):
            return self.step(steps)
        if not good:
            self.at, self.asked, self.next = 0, False, now + LOOK_S
            return
        if name == "ZCtrl.Withdraw":
            return self.step(steps)
        if name == "ZCtrl.StatusGet":
            self.off = struct.unpack(">H", body[:2])[0] in (1, 5)
            if self.off or now > self.begun + 2:
                return self.step(steps)
            self.asked, self.next = False, now + 0.01
            return
        height = struct.unpack(">f", body[:4])[0]
        self.at, self.asked, self.next = 0, False, now + LOOK_S
        if self.up is not None:
            if abs(height - self.up) > SAME_M:
                self.deadman.report(f"the tip was moved to Z = {1e9 * height:.1f} nm; withdrawing again until it is cleared")
                self.up, self.height, self.begun, self.next, self.floor_tried = None, None, now, now, False
                self.say = now
            return
        self.begun, self.floor_tried = now, False
        if not self.off or not self.deadman.at_place(height):
            self.height = None
            return self.not_up(height, now)
        if not self.gone:
            self.gone = True
            self.deadman.report(f"the tip has gone to Z = {1e9 * height:.1f} nm, "
                                f"{1e3 * (now - self.deadman.heard):.0f} ms after the last heartbeat")
        if self.height is not None and abs(height - self.height) <= SAME_M:
            self.up = height
            self.deadman.report(f"the tip is withdrawn, at Z = {1e9 * height:.1f} nm")
        self.height = height

    def not_up(self, height, now):
        if now < self.say:
            return
        self.say = now + NOT_UP_S
        d = self.deadman
        place = f"up is {1e9 * d.top_m:.1f} nm" if d.place_known else "and where up is was not heard"
        status = "" if self.off else ", and the Z controller is not off"
        d.report(f"the tip is NOT up: Z = {1e9 * height:.1f} nm, {place}{status}; withdrawing it again; "
                 "press Withdraw at the controller")


# ---- the deadman

class Deadman:
    def __init__(self, config, clock=time.monotonic):
        self.config, self.clock = config, clock
        self.selector = selectors.DefaultSelector()
        self.log = open(config.log, "a", encoding="utf-8") if config.log else None
        self.controller = Controller(config.controller, self.selector, self.report)
        self.strangers, self.holder = [], None
        self.armed, self.heard = False, clock()
        self.top_m, self.range_m = read_place(config.place)
        self.withdrawal = None
        self.latch_looked = 0.0
        self.listener = socket.create_server(config.listen, family=socket.AF_INET6 if ":" in config.listen[0]
                                             else socket.AF_INET, backlog=16, reuse_port=False)
        self.listener.setblocking(False)
        self.selector.register(self.listener, selectors.EVENT_READ, self)
        if os.path.exists(config.latch):
            self.report(f"latched by an earlier withdrawal: keeping the tip up until it is cleared ({config.latch})")
            self.withdrawal = Withdrawal(self, clock())

    def report(self, text):
        line = f"{datetime.datetime.now().isoformat(timespec='milliseconds')} deadman: {text}"
        print(line, file=sys.stderr, flush=True)
        if self.log:
            self.log.write(line + "\n")
            self.log.flush()

    @property
    def latched(self):
        return self.withdrawal is not None

    @property
    def place_known(self):
        return self.top_m is not None and bool(self.range_m)

    def at_place(self, height_m):
        """As far up as it stood withdrawn at the start; never where that was not overheard. As guard.cpp reckons."""
        if not self.place_known:
            return False
        return (height_m if self.top_m > 0 else -height_m) >= abs(self.top_m) - UP_PART * self.range_m - SAME_M

    def floor(self):
        """High and low limit that leave the tip no room below where it stood withdrawn; None if that was not overheard. As
        nve_server/afm/guard.cpp reckons."""
        if not self.place_known:
            return None
        end = 0.5 * self.range_m
        up = min(abs(self.top_m), 0.9 * end) - SAME_M
        return (end, up) if self.top_m > 0 else (-up, -end)

    # -- the guard's side

    def accept(self, now):
        try:
            connection, peer = self.listener.accept()
        except OSError:
            return
        client = Client(plain_socket(connection), peer, now)
        if len(self.strangers) >= STRANGERS:
            self.drop(self.strangers[0])
        self.strangers.append(client)
        self.selector.register(connection, selectors.EVENT_READ, client)
        greeting = struct.pack(">HH16s", VERSION, round(1e3 * self.config.silence_s), client.nonce)
        if not client.send(frame(GREETING, greeting)):
            self.drop(client)

    def drop(self, client):
        if client in self.strangers:
            self.strangers.remove(client)
        if client is self.holder:
            self.holder = None
        try:
            self.selector.unregister(client.socket)
        except (KeyError, ValueError):
            pass
        client.socket.close()

    def refuse(self, client, why):
        self.report(f"refused {client.peer}: {why}")
        self.drop(client)

    def receive(self, client, now):
        try:
            data = client.socket.recv(4096)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            return self.drop(client)
        try:
            for name, body, whole in client.frames.feed(data):
                if name == BEAT:
                    if not self.beat(client, body, now):
                        return
                elif client is not self.holder:
                    return self.refuse(client, f"{name} from somebody who has not proved to know the key")
                else:
                    self.pass_on(client, name, whole, now)
        except (ValueError, UnicodeDecodeError) as error:
            self.refuse(client, str(error))

    def beat(self, client, body, now):
        if len(body) != BEAT_BODY.size:
            return self.refuse(client, "a heartbeat of the wrong size")
        guard, number, state, mac = BEAT_BODY.unpack(body)
        wanted = beat_proof(self.config.key, client.nonce, guard, number, state)
        if not hmac.compare_digest(mac, wanted) or state > DONE:
            return self.refuse(client, "a heartbeat that is forged, replayed, or made with another key")
        if number <= client.number or client.guard not in (None, guard):
            return self.refuse(client, "a heartbeat that is replayed")
        client.number, client.guard = number, guard
        answer_code = READY if self.controller.up else NO_CONTROLLER
        if client is not self.holder:
            before = self.holder
            if before and before.guard != guard and now - before.heard <= self.config.silence_s:
                answer_code = IN_USE
            else:
                if before:
                    self.drop(before)
                self.strangers.remove(client)
                self.holder = client
        if self.latched:
            answer_code = LATCHED
        client.heard = now
        if client is self.holder:
            self.listen_to(client, state, now)
        answer = ANSWER_BODY.pack(number, answer_code, answer_proof(self.config.key, client.nonce, guard, number, answer_code))
        if not client.send(frame(BEAT, answer)) or answer_code == IN_USE:
            self.drop(client)
            return False
        return True

    def listen_to(self, client, state, now):
        client.watched = client.watched or state == WATCH
        if state == WATCH:
            self.heard = now
            if not self.armed and not self.latched:
                self.armed = True
                self.report(f"watching over the server at {client.peer}")
                self.keep_place()
        elif state == DONE and self.armed:
            self.armed = False
            self.report("the server says that the tip is up and stays up: watching no longer")

    def pass_on(self, client, name, whole, now):
        if name not in PASSED_ON:
            reply = error_reply(name, "the deadman does not pass that on: it has the emergency port only")
        elif self.latched and name == "ZCtrl.StatusGet":
            reply = error_reply(name, "the deadman has withdrawn the tip: look at it, then run deadman.py clear")
        else:
            self.controller.ask(now, client, name, whole)   # if it cannot be sent, the silence tells the server
            return
        if not client.send(reply):
            self.drop(client)

    # -- the controller's side

    def read_controller(self, now):
        controller = self.controller
        try:
            data = controller.socket.recv(65536)
        except BlockingIOError:
            return
        except OSError as error:
            return controller.lost(now, str(error))
        if not data:
            return controller.lost(now, "it closed the connection; is its port in use by another program?")
        try:
            for name, body, whole in controller.frames.feed(data):
                if not controller.asked or controller.asked[0][1] != name:
                    raise ValueError("an answer to nothing that was asked")
                owner = controller.asked.popleft()[0]
                if isinstance(owner, Withdrawal):
                    owner.answered(name, body, now)
                elif owner is self.holder:
                    self.note_reply(owner, name, body)
                    if not owner.send(whole):
                        self.drop(owner)
        except (ValueError, UnicodeDecodeError) as error:
            controller.lost(now, str(error))

    def note_reply(self, client, name, body):
        """Before the tip moves the server asks where it stands withdrawn, and for the range."""
        if client.watched or self.armed or self.latched or len(body) < 12 or struct.unpack(">Ii", body[-8:]) != (0, 0):
            return
        if name == "ZCtrl.ZPosGet":
            self.top_m = struct.unpack(">f", body[:4])[0]
        elif name == "Piezo.RangeGet" and len(body) == 20:
            self.range_m = struct.unpack(">f", body[8:12])[0]

    def keep_place(self):
        """For a deadman that is started again while the tip is out, or after it was withdrawn."""
        if not self.place_known:
            return
        try:
            with open(self.config.place, "w", encoding="ascii") as file:
                file.write(f"{self.top_m!r} {self.range_m!r} {PLACE_END}")
        except OSError as error:
            self.report(f"{self.config.place}: {error.strerror}: a deadman that is started again will not know where up is")

    # -- time

    def trigger(self, now):
        self.armed = False
        self.withdrawal = Withdrawal(self, now)
        self.withdrawal.tick(now)       # before the disk
        self.report(f"no heartbeat for {1e3 * (now - self.heard):.0f} ms: withdrawing the tip")
        try:
            with open(self.config.latch, "w", encoding="ascii") as file:
                file.write(datetime.datetime.now().isoformat() + " no heartbeat\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            self.report(f"{self.config.latch}: {error.strerror}: latched until the deadman is stopped")
            self.latch_looked = float("inf")

    def tick(self, now):
        self.controller.connect(now)
        for client in [c for c in self.strangers if now - c.since > STRANGER_S]:
            self.refuse(client, "no heartbeat from it")
        if self.withdrawal:
            if now > self.latch_looked + 0.2:
                self.latch_looked = now
                if not os.path.exists(self.config.latch):
                    self.withdrawal = None
                    return self.report("cleared")
            self.withdrawal.tick(now)

    def turn(self, patience_s):
        self.look(patience_s)
        # A busy machine may keep this program waiting anywhere, also between the sockets and the clock. So the silence is
        # judged only by a look into the sockets that has itself taken no time.
        for _ in range(100):
            if not self.silent(begun := self.clock()):
                break
            self.look(0)
            if self.silent(begun) and self.clock() - begun < 0.05:
                self.trigger(self.clock())
        self.tick(self.clock())

    def silent(self, now):
        return self.armed and now - self.heard > self.config.silence_s

    def look(self, patience_s):
        events = self.selector.select(patience_s)
        now = self.clock()
        for entry, mask in events:
            if entry.data is self:
                self.accept(now)
            elif entry.data is self.controller:
                if mask & selectors.EVENT_WRITE:
                    self.controller.connected(now)
                elif self.controller.socket is entry.fileobj:
                    self.read_controller(now)
            elif entry.data is self.holder or entry.data in self.strangers:
                self.receive(entry.data, now)

    def run(self, stop):
        host, port = self.listener.getsockname()[:2]
        self.report(f"listening on {host}:{port}, silence {1e3 * self.config.silence_s:.0f} ms")
        while not stop:
            self.turn(0.01 if self.armed or self.latched else 0.05)
        if self.armed:
            self.report("stopped while it watches: the server will find that, and withdraw the tip")

    def close(self):
        for client in self.strangers + ([self.holder] if self.holder else []):
            self.drop(client)
        self.controller.told = True
        self.controller.lost(0.0, "")
        self.listener.close()
        self.selector.close()
        if self.log:
            self.log.close()


# ---- commands

def new_key(path):
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}; expected the name of a new file") from None
    with os.fdopen(handle, "w", encoding="ascii") as file:
        file.write(secrets.token_hex(32) + "\n")
    print(f"deadman: {path} made: the server needs a copy; nobody else does", file=sys.stderr)


def clear(config):
    try:
        os.unlink(config.latch)
    except FileNotFoundError:
        raise ConfigError("nothing to clear: the tip was not withdrawn by the deadman") from None
    except OSError as error:
        raise ConfigError(f"{config.latch}: {error.strerror}") from None
    print("deadman: cleared: the tip may be used again", file=sys.stderr)


def run(config):
    stop = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.append(True))
    try:
        deadman = Deadman(config)
    except OSError as error:
        raise ConfigError(f"listen = \"{config.listen[0]}:{config.listen[1]}\": {error.strerror}") from None
    deadman.run(stop)
    deadman.close()


def main(arguments):
    parser = argparse.ArgumentParser(prog="deadman.py", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    commands.add_parser("new-key", help="make a key").add_argument("file", metavar="FILE")
    for name, text in (("run", "watch until Ctrl-C"), ("clear", "after a withdrawal: the tip may be used again")):
        commands.add_parser(name, help=text).add_argument("--config", metavar="FILE", required=True,
                                                          help="as deploy/afm/deadman.toml explains it")
    options = parser.parse_args(arguments)
    try:
        if options.command == "new-key":
            new_key(options.file)
        elif options.command == "clear":
            clear(Config(options.config))
        else:
            run(Config(options.config))
    except ConfigError as error:
        print(f"deadman: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
