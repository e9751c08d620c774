"""The station's end of a session, written from PROTOCOL.md: bytes and times in, bytes out."""
import collections
import hashlib
import secrets

import telenano_pb2 as pb
from rules import LinkTimes, Received, SequenceWindow
from wire import (BYE_DONE, BYE_IDLE, BYE_SHUTTING_DOWN, BYE_STOPPED, BYE_UNKNOWN_SESSION, FEATURE_REDUNDANCY,
                  FEATURE_SCENE, FEATURE_SCENE_SWITCH, FEATURE_SHARING, FEATURE_STEP_LOG, KNOWN_FEATURES, RECENT, REFUSE_FULL, REFUSE_SHUTTING_DOWN, SCENE_CHUNK_BYTES, VERSION, Drop, decode, encode, features_used, need, pack_steps,
                  scene_offer, set_vector)

MS = 1_000_000
#: Sums of a command that count from the session's Welcome.
RUNNING_SUMS = ("energy_in_j", "energy_out_j", "energy_sent_j", "wave_energy_aj", "wave_sum_w_x_sqrt_aj_s",
                "wave_sum_w_y_sqrt_aj_s", "wave_sum_w_z_sqrt_aj_s")


class Station:
    """A shared tip (section 13): `tip_hold` is that of the newest reply. Who calls command() takes up its position at the
    reply's hold_pos when that changes, and shows no force while it is 0.

    States idle, hello_sent, challenged, established, lost, closed, refused, as in section 3.

    Every tick: on_datagram(bytes, now) for what came, then send what poll(now) returns (a Hello, or None), then what
    command(now, ...) returns (None while there is no session).
    """

    def __init__(self, rate_hz=1000, features=KNOWN_FEATURES, token=0, versions=(VERSION, VERSION), redundancy=0):
        self.redundancy, self.last_sent = redundancy, collections.deque(maxlen=4)
        self.rate_hz, self.asked, self.token, self.versions = rate_hz, features, token, versions
        self.state = "idle"
        self.alive = False  # may commands be sent?
        self.nonce = self.cookie = 0
        self.next_hello_ns = self.backoff_ns = self.attempt_ns = 0
        self.welcome = None
        self.welcomes = []
        self.reply = None
        self.refuse = self.bye = None
        self.replies = None
        self.sent = 0
        self.tip_hold = 0  # of a shared tip: the newest reply's
        self.resumed_account = False  # one that an earlier station has begun
        self.first_sums = None
        self.news_ns = self.handshake_ns = 0
        self.waits = False  # for a reply to a command; then news_ns is the last reply, or the first command after it
        self.energy_in_aj, self.energy_out_aj = Received(), Received()
        self.times = LinkTimes()
        self.drops = collections.Counter()
        self.pieces = {}  # of the scene, by number
        self.asked_for = {}  # piece: when
        self.log = {}  # number: (holding, (target, length_ns, flags)), of steps that the server has not executed
        self.executed = self.made = self.told = self.again_ns = 0
        self.switch = None  # (nonce, scene_hash) that was asked for
        self.next_switch_ns = self.switch_backoff_ns = 0
        self.scenes = {}  # (name, hash) by place

    # Handshake

    def start(self, now_ns):
        self.alive = False
        self.new_attempt(now_ns)
        self.state = "hello_sent"

    def new_attempt(self, now_ns):
        self.nonce, self.cookie = secrets.randbits(64) | 1, 0
        self.attempt_ns = self.next_hello_ns = now_ns
        self.backoff_ns = 100 * MS

    def silence_limit_ns(self):
        explained = self.times.explained_ns() if self.times.samples else self.handshake_ns
        return max(200 * MS, 2 * explained)

    def poll(self, now_ns):
        if self.state == "established" and self.waits and now_ns - self.news_ns > self.silence_limit_ns():
            self.new_attempt(now_ns)
            self.state = "lost"
        if self.state == "established" and self.switch and now_ns >= self.next_switch_ns:
            self.next_switch_ns = now_ns + self.switch_backoff_ns
            self.switch_backoff_ns = min(2 * self.switch_backoff_ns, 1000 * MS)
            return encode(pb.SceneSwitch(session_id=self.welcome.session_id, nonce=self.switch[0], scene_hash=self.switch[1]))
        if self.state not in ("hello_sent", "challenged", "lost") or now_ns < self.next_hello_ns:
            return None
        self.next_hello_ns = now_ns + self.backoff_ns
        self.backoff_ns = min(2 * self.backoff_ns, 1000 * MS)
        return encode(pb.Hello(version_min=self.versions[0], version_max=self.versions[1], feature_bits=self.asked,
                               nonce=self.nonce, cookie=self.cookie, resume_token=self.token, rate_hz=self.rate_hz))

    def on_datagram(self, datagram, now_ns):
        """The message, if it was accepted."""
        try:
            message = decode(datagram)
            handler = {pb.Challenge: self.on_challenge, pb.Welcome: self.on_welcome, pb.Refuse: self.on_refuse,
                       pb.Reply: self.on_reply, pb.Bye: self.on_bye, pb.SceneChunk: self.on_scene_chunk,
                       pb.SceneListEntry: self.on_scene_entry}.get(type(message))
            need(handler is not None, "unknown_type")
            handler(message, now_ns)
            return message
        except Drop as drop:
            self.drops[drop.cause] += 1
            return None

    # Another scene

    def ask_scene(self, scene_hash, now_ns):
        self.switch = secrets.randbits(64) | 1, scene_hash
        self.next_switch_ns, self.switch_backoff_ns = now_ns, 100 * MS

    def list_request(self, index):
        return encode(pb.SceneListRequest(session_id=self.welcome.session_id, index=index))

    def on_scene_entry(self, m, _now_ns):
        need(self.alive, "unexpected")
        need(m.session_id == self.welcome.session_id, "unknown_session")
        need(self.welcome.feature_bits & FEATURE_SCENE_SWITCH, "unexpected")
        self.scenes[m.index] = m.scene_name, m.scene_hash

    def on_challenge(self, m, now_ns):
        need(self.state in ("hello_sent", "challenged", "lost"), "unexpected")
        need(m.nonce == self.nonce, "unauthenticated")
        need(m.cookie != self.cookie, "duplicate")
        if self.cookie == 0:  # the first of this attempt at once, later ones with the back-off
            self.next_hello_ns = now_ns
            self.backoff_ns = 100 * MS
        self.cookie = m.cookie
        if self.state == "hello_sent":
            self.state = "challenged"

    def on_welcome(self, m, now_ns):
        need(self.welcome is None or m.session_id != self.welcome.session_id, "duplicate")
        switched = self.switch is not None and m.nonce == self.switch[0]
        need(self.state in ("hello_sent", "challenged", "lost", "established") and (self.nonce or self.switch), "unexpected")
        need(switched or self.nonce and m.nonce == self.nonce, "unauthenticated")
        need(not switched or m.scene_hash == self.switch[1], "out_of_range")
        if self.switch and m.scene_hash == self.switch[1]:
            self.switch = None
        need(self.versions[0] <= m.version <= self.versions[1], "wrong_version")
        need(m.feature_bits & ~self.asked == 0, "out_of_range")
        need(features_used(m) & ~m.feature_bits == 0, "unexpected")
        if self.welcome is None or m.epoch != self.welcome.epoch:
            self.energy_in_aj, self.energy_out_aj = Received(), Received()
            self.times = LinkTimes()
        self.resumed_account = not self.welcomes and self.token != 0 and m.resume_token == self.token
        if self.welcome is None or scene_offer(m) != scene_offer(self.welcome):
            self.pieces, self.asked_for = {}, {}
        self.goes_on = self.welcome is not None and m.epoch == self.welcome.epoch
        self.welcome = m
        self.welcomes.append(m)
        self.token = m.resume_token
        self.alive, self.state, self.nonce = True, "established", 0
        self.handshake_ns = now_ns - self.attempt_ns
        self.replies, self.reply, self.sent, self.first_sums = SequenceWindow(self.rate_hz, now_ns), None, 0, None
        self.tip_hold = 0
        if not self.log_goes_on(m):
            self.log, self.made = {}, m.steps_executed
        self.executed, self.told, self.again_ns = m.steps_executed, m.steps_executed, now_ns
        self.last_sent.clear()
        self.news_ns, self.waits = now_ns, False

    def on_refuse(self, m, now_ns):
        if self.switch and m.nonce == self.switch[0]:
            self.switch, self.refuse = None, m
            return
        need(self.state in ("hello_sent", "challenged", "lost"), "unexpected")
        need(m.nonce == self.nonce, "unauthenticated")
        self.refuse = m
        if self.state == "lost" and m.reason in (REFUSE_FULL, REFUSE_SHUTTING_DOWN):
            self.backoff_ns = 1000 * MS
            self.next_hello_ns = now_ns + self.backoff_ns
        else:
            self.alive, self.state = False, "refused"

    # Exchange

    def command(self, now_ns, position_w_nm, velocity_w_nm_s=(0, 0, 0), flags=3, **more):
        """Datagram of the next command; `more` are running sums and other fields by their names."""
        if not self.alive:
            return None
        m = pb.Command(session_id=self.welcome.session_id, send_time_ns=now_ns % (1 << 64),
                       newest_reply=self.replies.newest, epoch=self.welcome.epoch, flags=flags, tip_hold=self.tip_hold,
                       **more)
        if self.first_sums is None:
            self.first_sums = {name: getattr(m, name) for name in RUNNING_SUMS}
        for name, first in self.first_sums.items():
            setattr(m, name, getattr(m, name) - first)
        if not self.waits:
            self.news_ns, self.waits = now_ns, True
        self.sent += 1
        m.sequence = self.sent
        set_vector(m, "tip_pos_w_{}_nm", position_w_nm)
        set_vector(m, "tip_vel_w_{}_nm_s", velocity_w_nm_s)
        if self.logs():
            self.add_steps(m, now_ns)
        elif self.redundancy and self.welcome.feature_bits & FEATURE_REDUNDANCY:
            self.repeat(m)
        assert features_used(m) & ~self.welcome.feature_bits == 0, "a field of a feature that was not agreed"
        return encode(m)

    def commands_not_accepted(self):
        """When the server sent the newest reply."""
        return self.reply.command_sequence - self.reply.sequence - self.reply.replies_left_out

    def repeat(self, m):
        """The last commands with this one, and this one kept for those that come."""
        wave = m.method == 4
        for kind, time_ns, record in list(self.last_sent)[:self.redundancy]:
            if kind != (m.method, m.energy_scale_aj_j, m.tip_hold) or m.send_time_ns - time_ns >= 1 << 32:
                break
            m.recent_commands += RECENT.pack(m.send_time_ns - time_ns, *record)
        energy = m.wave_energy_aj if wave else m.energy_sent_j
        sums = [getattr(m, f"wave_sum_w_{axis}_sqrt_aj_s") if wave else 0.0 for axis in "xyz"]
        kind = (m.method, m.energy_scale_aj_j, m.tip_hold)
        self.last_sent.appendleft((kind, m.send_time_ns, (m.flags, m.tip_pos_w_x_nm, m.tip_pos_w_y_nm, m.tip_pos_w_z_nm,
                                                          energy, *sums)))

    def on_reply(self, m, now_ns):
        need(self.alive, "unexpected")
        need(m.session_id == self.welcome.session_id, "unknown_session")
        need(m.epoch == self.welcome.epoch, "wrong_epoch")
        need(m.command_sequence <= self.sent, "out_of_range")
        need(features_used(m) & ~self.welcome.feature_bits == 0, "unexpected")
        need(m.sequence + m.replies_left_out <= m.command_sequence, "out_of_range")
        self.replies.accept(m.sequence, now_ns)
        self.tip_hold = m.tip_hold
        self.hear_log(m, now_ns)
        self.reply, self.news_ns, self.waits = m, now_ns, m.command_sequence < self.sent
        self.energy_in_aj.update(m.energy_in_aj)
        self.energy_out_aj.update(m.energy_out_aj)
        self.times.on_reply(m, now_ns)
        if self.state == "lost":
            self.state = "established"

    # The log of steps (section 15): state_hash is only kept, for who has something to compare it with

    def logs(self):
        return bool(self.welcome.feature_bits & FEATURE_STEP_LOG)

    def log_goes_on(self, m):
        return self.goes_on and self.made >= m.steps_executed

    def step(self, position_w_nm, flags=3, length_ns=1_000_000):
        """The step of this tick; its target is the nearest on the grid."""
        self.made += 1
        target = tuple(round(x * 16384) for x in position_w_nm)
        self.log[self.made] = (self.tip_hold, (target, length_ns, flags))

    def add_steps(self, m, now_ns):
        """Those that are new, and what was new in the last one; after a round trip and more all that is open."""
        if self.told > self.executed and now_ns - self.again_ns > self.silence_limit_ns():
            self.told, self.again_ns = self.executed, now_ns
        # A step that was told twice may be executed by the first datagram while the second is on its way.
        self.told = max(self.told, self.executed)
        if self.executed == self.made:
            return
        # One holding a datagram: that of the next new step, or of the newest, lest a stop wait.
        hold = self.log[self.made if m.flags & 4 else min(self.told + 1, self.made)][0]
        first = max(self.executed + 1, self.told - 8)
        while self.log[first][0] != hold:
            first += 1
        made = []
        for number in range(first, self.made + 1):
            if self.log[number][0] != hold:
                break
            made.append(self.log[number][1])
        m.steps, count = pack_steps(first, made)
        self.told = max(self.told, first + count - 1)
        if self.welcome.feature_bits & FEATURE_SHARING:
            m.tip_hold = hold
        set_vector(m, "tip_pos_w_{}_nm", (0, 0, 0))
        set_vector(m, "tip_vel_w_{}_nm_s", (0, 0, 0))

    def hear_log(self, m, now_ns):
        if not self.logs():
            return
        need(m.steps_executed <= self.made and m.steps_executed <= m.steps_newest, "out_of_range")
        if m.steps_executed > self.executed:
            for number in range(self.executed + 1, m.steps_executed + 1):
                self.log.pop(number, None)
            self.executed, self.again_ns = m.steps_executed, now_ns
        if m.steps_newest > m.steps_executed and now_ns - self.again_ns > 20 * MS:  # a gap
            self.told, self.again_ns = self.executed, now_ns
        # A step that was told twice may be executed by the first datagram while the second is on its way.
        self.told = max(self.told, self.executed)

    # The scene (section 14)

    def scene(self):
        """Its bundle, once all of it is here and has the hash that the Welcome names; else None."""
        offer = self.welcome and scene_offer(self.welcome)
        if not offer or len(self.pieces) < -(-offer[1] // SCENE_CHUNK_BYTES):
            return None
        bundle = b"".join(self.pieces[k] for k in sorted(self.pieces))
        assert hashlib.sha256(bundle).digest() == offer[0], "another bundle than the Welcome names"
        return bundle

    def scene_requests(self, now_ns, most=2, again_ms=100):
        """Datagrams to send now, beside the command."""
        offer = self.welcome and scene_offer(self.welcome)
        if not self.alive or not offer:
            return []
        wanted = [k for k in range(-(-offer[1] // SCENE_CHUNK_BYTES))
                  if k not in self.pieces and now_ns - self.asked_for.get(k, -MS * 10 ** 6) > again_ms * MS][:most]
        self.asked_for.update(dict.fromkeys(wanted, now_ns))
        return [encode(pb.SceneRequest(session_id=self.welcome.session_id, bundle=self.welcome.scene_sha256_0, chunk=k))
                for k in wanted]

    def on_scene_chunk(self, m, now_ns):
        need(self.alive, "unexpected")
        need(m.session_id == self.welcome.session_id, "unknown_session")
        need(self.welcome.feature_bits & FEATURE_SCENE, "unexpected")
        left = self.welcome.scene_bytes - m.chunk * SCENE_CHUNK_BYTES
        need(m.bundle == self.welcome.scene_sha256_0 and len(m.data) == min(max(left, 0), SCENE_CHUNK_BYTES), "out_of_range")
        if m.chunk in self.asked_for:
            self.pieces.setdefault(m.chunk, m.data)

    # End

    def on_bye(self, m, now_ns):
        need(self.alive, "unexpected")
        need(m.session_id == self.welcome.session_id, "unknown_session")
        self.bye = m
        self.alive = False
        if m.reason in (BYE_DONE, BYE_STOPPED):
            self.state = "closed"
            return
        assert m.reason in (BYE_IDLE, BYE_SHUTTING_DOWN, BYE_UNKNOWN_SESSION)
        if self.state != "lost":
            if self.nonce == 0:
                self.new_attempt(now_ns)
            self.next_hello_ns = now_ns + (100 * MS if m.reason == BYE_SHUTTING_DOWN else 0)
            self.state = "lost"

    def end(self, reason=BYE_DONE):
        self.alive, self.state = False, "closed"
        return encode(pb.Bye(session_id=self.welcome.session_id, reason=reason))
