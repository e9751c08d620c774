"""The server's end, written from PROTOCOL.md: bytes, addresses and times in, bytes out. Its slave is a spring wall, one
for each session."""
import collections
import hashlib
import hmac
import secrets
import struct

import telenano_pb2 as pb
from rules import Received, ReplyDeadband, SequenceWindow
from wire import (BYE_IDLE, BYE_SHUTTING_DOWN, BYE_UNKNOWN_SESSION, CLUTCH, DEADMAN, FAULT_RETRACTED,
                  FEATURE_PARTICLE, FEATURE_REPLY_DEADBAND, FEATURE_SCENE, FEATURE_SHARING, FEATURE_STEP_HISTORY, FEATURE_WELL, KNOWN_FEATURES,
                  REFUSE_FULL, REFUSE_RATE, REFUSE_SHUTTING_DOWN, REFUSE_VERSION, SCENE_CHUNK_BYTES, STOP, VERSION, Drop, decode, encode,
                  features_used, need, recent_commands, set_vector, vector)

SECOND = 1_000_000_000
FIRST_COMMAND_MS = 2000


class SpringWall:
    """A floor at z = 0 under a massless tip that is where it is commanded: force −k z, energy k z²/2."""

    START = (0.0, 0.0, 20.0)
    LOW, HIGH = (-500.0, -500.0, -60.0), (500.0, 500.0, 100.0)
    RETRACT_NM_S = 1000.0

    def __init__(self, stiffness_n_m=1.0):
        self.k = stiffness_n_m
        self.position = self.START
        self.energy_in_aj = self.energy_out_aj = 0.0
        self.faults = 0

    def force_nn(self):
        return max(0.0, -self.k * self.position[2])

    def step(self, target, dt_s, follow, retract):
        before = self.force_nn() ** 2 / (2 * self.k)
        self.faults = 0
        if retract:
            x, y, z = self.position
            self.position = (x, y, min(z + self.RETRACT_NM_S * dt_s, self.HIGH[2]))
            self.faults |= FAULT_RETRACTED
        elif follow:
            self.position = tuple(min(max(v, low), high) for v, low, high in zip(target, self.LOW, self.HIGH))
            self.faults |= 2 if self.position != tuple(target) else 0
        change = self.force_nn() ** 2 / (2 * self.k) - before
        self.energy_in_aj += max(0.0, change)
        self.energy_out_aj += max(0.0, -change)


class Session:
    """One slot: what belongs to the slave stays over a resume, the rest starts anew with each session id."""

    def __init__(self, epoch):
        self.slave, self.epoch, self.token = SpringWall(), epoch, secrets.randbits(64) | 1
        self.nonces = []
        self.used = False
        self.state, self.awaits_first = "active", True

    def begin(self, hello, address, features, now_ns):
        self.session_id = secrets.randbits(64) | 1
        self.nonces.append(hello.nonce)
        self.address, self.rate_hz, self.features = address, hello.rate_hz, features
        self.deadband = ReplyDeadband()
        self.stepped = []  # numbers of the newest 64 commands accepted
        self.commands, self.replies, self.last_send_ns = SequenceWindow(hello.rate_hz, now_ns), 0, None
        self.energy_in_j, self.energy_out_j = Received(), Received()
        self.awaits_first = self.awaits_first or self.state != "active"
        self.state, self.heard_ns, self.since_ns = "active", now_ns, now_ns

    def set_state(self, state, now_ns):
        self.state, self.since_ns = state, now_ns


class Server:
    """on_datagram(bytes, address, now) returns the answer or None; poll(now) applies the time-outs."""

    def __init__(self, capacity=4, features=KNOWN_FEATURES, timeout_ms=500, rate_max_hz=8000, bundle=None):
        self.bundle = bundle  # of the scene, for stations to fetch; None: they cannot
        # There is nothing to share, no particle, and no well: nothing here attracts.
        features &= ~(FEATURE_SHARING | FEATURE_PARTICLE | FEATURE_WELL | (0 if bundle else FEATURE_SCENE))
        self.capacity, self.features, self.timeout_ms, self.rate_max_hz = capacity, features, timeout_ms, rate_max_hz
        self.shutting_down = False
        self.secret = secrets.token_bytes(32)
        self.epoch = secrets.randbits(31) + 1
        self.sessions = []
        self.drops = collections.Counter()
        self.challenges = 0
        self.accepted = []  # (session, command), for a test to look into
        self.told = []  # (target, dt, follow) of every step of a slave, likewise

    # Handshake

    def cookie(self, address, nonce, now_ns, age=0):
        slot = now_ns // (30 * SECOND) - age
        digest = hmac.new(self.secret, repr((address, nonce, slot)).encode(), hashlib.sha256).digest()
        return int.from_bytes(digest[:8], "little") | 1

    def on_datagram(self, datagram, address, now_ns):
        try:
            m = decode(datagram)
            handler = {pb.Hello: self.on_hello, pb.Command: self.on_command, pb.Bye: self.on_bye,
                       pb.SceneRequest: self.on_scene_request}.get(type(m))
            need(handler is not None, "unknown_type")
            answer = handler(m, address, now_ns)
        except Drop as drop:
            self.drops[drop.cause] += 1
            answer = getattr(drop, "answer", None)
        if answer is None:
            return None
        answer = encode(answer)
        assert isinstance(answer, bytes) and len(answer) <= max(len(datagram), 498)
        return answer

    def drop(self, cause, answer=None):
        drop = Drop(cause)
        drop.answer = answer
        raise drop

    def on_hello(self, m, address, now_ns):
        def refuse(reason, cause):
            self.drop(cause, pb.Refuse(nonce=m.nonce, reason=reason, version_min=VERSION, version_max=VERSION))

        if not m.version_min <= VERSION <= m.version_max:
            refuse(REFUSE_VERSION, "wrong_version")
        if self.shutting_down:
            refuse(REFUSE_SHUTTING_DOWN, "unexpected")
        if m.cookie not in (self.cookie(address, m.nonce, now_ns), self.cookie(address, m.nonce, now_ns, 1)):
            self.challenges += 1
            challenge = pb.Challenge(nonce=m.nonce, cookie=self.cookie(address, m.nonce, now_ns))
            if m.cookie != 0:
                self.drop("unauthenticated", challenge)
            return challenge
        if not 1 <= m.rate_hz <= self.rate_max_hz:
            refuse(REFUSE_RATE, "out_of_range")
        for session in self.sessions:
            if session.address == address and m.nonce in session.nonces:
                need(m.nonce == session.nonces[-1] and session.state != "ending", "duplicate")
                if session.state == "active":
                    return self.welcome(session, m.nonce)
        features = m.feature_bits & self.features
        for session in self.sessions:
            if m.resume_token and session.token == m.resume_token and session.state in ("active", "silent"):
                session.begin(m, address, features, now_ns)
                return self.welcome(session, m.nonce)
        if len(self.sessions) >= self.capacity:
            quiet = [s for s in self.sessions if s.state != "active"]
            if not quiet:
                refuse(REFUSE_FULL, "full")
            self.sessions.remove(min(quiet, key=lambda s: s.since_ns))
        session = Session(self.epoch)
        self.epoch = self.epoch % 0xFFFFFFFF + 1
        session.begin(m, address, features, now_ns)
        self.sessions.append(session)
        return self.welcome(session, m.nonce)

    def welcome(self, session, nonce):
        slave = session.slave
        w = pb.Welcome(version=VERSION, feature_bits=session.features, nonce=nonce, session_id=session.session_id,
                       resume_token=session.token, epoch=session.epoch, timeout_ms=self.timeout_ms,
                       slave_rate_max_hz=self.rate_max_hz, scene_name=b"spring wall", scene_hash=0x5157,
                       surface_z_w_nm=0.0, force_max_nn=60 * slave.k, coupling_stiffness_n_m=slave.k)
        set_vector(w, "workspace_min_w_{}_nm", slave.LOW)
        set_vector(w, "workspace_max_w_{}_nm", slave.HIGH)
        set_vector(w, "start_pos_w_{}_nm", slave.position)
        if session.features & FEATURE_SCENE:
            (w.scene_sha256_0, w.scene_sha256_1, w.scene_sha256_2, w.scene_sha256_3) = struct.unpack(
                "<4Q", hashlib.sha256(self.bundle).digest())
            w.scene_bytes, w.canonical_motion = len(self.bundle), 7
        return w

    def on_scene_request(self, m, address, now_ns):
        session = self.by_id(m.session_id)
        need(session is not None, "unknown_session")
        need(session.address == address, "unauthenticated")
        need(session.state == "active" and session.features & FEATURE_SCENE, "unexpected")
        data = self.bundle[m.chunk * SCENE_CHUNK_BYTES:(m.chunk + 1) * SCENE_CHUNK_BYTES]
        need(m.bundle == struct.unpack_from("<Q", hashlib.sha256(self.bundle).digest())[0] and data, "out_of_range")
        return pb.SceneChunk(session_id=m.session_id, bundle=m.bundle, chunk=m.chunk, data=data)

    # Exchange

    def by_id(self, session_id):
        return next((s for s in self.sessions if s.session_id == session_id), None)

    def on_command(self, m, address, now_ns):
        session = self.by_id(m.session_id)
        if session is None:
            self.drop("unknown_session", m.session_id and pb.Bye(session_id=m.session_id, reason=BYE_UNKNOWN_SESSION)
                      or None)
        need(session.address == address, "unauthenticated")
        if session.state != "active":
            idle = pb.Bye(session_id=m.session_id, reason=BYE_IDLE) if session.state == "silent" else None
            if self.shutting_down:
                idle = pb.Bye(session_id=m.session_id, reason=BYE_SHUTTING_DOWN)
            self.drop("unexpected", idle)
        need(m.epoch == session.epoch, "wrong_epoch")
        need(m.newest_reply <= session.replies, "out_of_range")
        need(features_used(m) & ~session.features == 0, "unexpected")
        before = session.commands.newest
        session.commands.accept(m.sequence, now_ns)
        steps_before = sum(1 << m.sequence - 1 - n for n in session.stepped if m.sequence - n <= 64)
        session.stepped = [n for n in session.stepped if m.sequence - n < 64] + [m.sequence]
        session.used, session.awaits_first, session.heard_ns = True, False, now_ns
        session.energy_in_j.update(m.energy_in_j)
        session.energy_out_j.update(m.energy_out_j)
        dt_s = (m.sequence - before) / session.rate_hz
        if session.last_send_ns is not None and 0 < m.send_time_ns - session.last_send_ns < 10 * SECOND:
            dt_s = (m.send_time_ns - session.last_send_ns) * 1e-9
        session.last_send_ns = m.send_time_ns
        # Commands that did not come and that this one repeats: oldest first, each once; then its own.
        slave, left_s = session.slave, dt_s
        missed = recent_commands(m)[:m.sequence - before - 1]
        for age_ns, flags, position, _, _ in reversed(missed):
            age_s = age_ns * 1e-9
            self.step(slave, position, left_s - age_s if left_s > age_s else 1 / session.rate_hz, flags)
            left_s = age_s if age_s > 0 else 1 / session.rate_hz
        self.step(slave, vector(m, "tip_pos_w_{}_nm"), left_s, m.flags)
        self.accepted.append((session.session_id, m))
        force = slave.force_nn()
        r = pb.Reply(session_id=session.session_id, command_sequence=m.sequence,
                     command_send_time_ns=m.send_time_ns, server_time_ns=now_ns % (1 << 64), epoch=session.epoch,
                     contact_state=3 if force > 0 else 0, fault_bits=slave.faults, energy_in_aj=slave.energy_in_aj,
                     energy_out_aj=slave.energy_out_aj)
        if session.features & FEATURE_STEP_HISTORY:
            r.steps_before = steps_before
        set_vector(r, "force_w_{}_nn", (0.0, 0.0, force))
        set_vector(r, "tip_pos_w_{}_nm", slave.position)
        if session.features & FEATURE_REPLY_DEADBAND:
            if session.deadband.leaves_out(m, r, round(dt_s * 1e9)):
                return None
            r.replies_left_out = session.deadband.left_out
        session.replies += 1
        r.sequence = session.replies
        return r

    def step(self, slave, target, dt_s, flags):
        stop = bool(flags & STOP)
        follow = not stop and flags & (CLUTCH | DEADMAN) == CLUTCH | DEADMAN
        slave.step(target, min(max(dt_s, 1e-6), 0.1), follow, stop)
        self.told.append((tuple(target), dt_s, follow))

    # Silence and end

    def on_bye(self, m, address, now_ns):
        session = self.by_id(m.session_id)
        need(session is not None, "unknown_session")
        need(session.address == address, "unauthenticated")
        need(session.state != "ending", "duplicate")
        session.set_state("ending", now_ns)

    def poll(self, now_ns):
        for session in list(self.sessions):
            age_ns = now_ns - session.since_ns
            patience_ms = max(self.timeout_ms, FIRST_COMMAND_MS) if session.awaits_first else self.timeout_ms
            if session.state == "active" and now_ns - session.heard_ns > patience_ms * 1_000_000:
                if session.used:
                    session.set_state("silent", now_ns)
                else:
                    self.sessions.remove(session)
            elif (session.state == "silent" and age_ns > 30 * SECOND) or (session.state == "ending" and age_ns > 2 * SECOND):
                self.sessions.remove(session)
            if session.state in ("silent", "ending"):
                session.slave.step(session.slave.position, 0.001, False, True)

    def byes(self):
        """Shutting down: datagrams and their addresses; every Hello is refused from now on."""
        self.shutting_down = True
        active = [s for s in self.sessions if s.state == "active"]
        for session in active:
            session.set_state("ending", session.heard_ns)
        return [(encode(pb.Bye(session_id=s.session_id, reason=BYE_SHUTTING_DOWN)), s.address) for s in active]
