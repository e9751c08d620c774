"""Rules that both ends share, written from PROTOCOL.md sections 4, 5 and 7."""
import collections
import math

from wire import need, vector


class SequenceWindow:
    """Newest wins: accepts only what is higher than all before, but no further than the rate explains, and says what
    the others are."""

    def __init__(self, rate_hz, now_ns):
        self.rate_hz = rate_hz
        self.accepted_ns = now_ns
        self.newest = 0
        self.seen = set()

    def max_leap(self, now_ns):
        since_s = min(max(now_ns - self.accepted_ns, 0) * 1e-9, 86400)
        return 64 + int(1.25 * self.rate_hz * (since_s + 1))

    def accept(self, sequence, now_ns):
        need(0 < sequence <= self.newest + self.max_leap(now_ns), "out_of_range")
        if sequence <= self.newest:
            known = sequence in self.seen or self.newest - sequence >= 64
            self.seen.add(sequence)
            need(not known, "duplicate")
            need(False, "stale")
        self.newest = sequence
        self.accepted_ns = now_ns
        self.seen.add(sequence)


class ReplyDeadband:
    """Which replies a server leaves out (section 4, Reply deadband)."""

    LONGEST_NS, LONGEST_OF_TWO_NS, MOST_IN_A_ROW = 6_000_000, 10_000_000, 32
    OF_COMMAND = ("flags", "method", "energy_scale_aj_j", "tip_hold", "reply_floor_pn", "reply_relative_permille")
    OF_REPLY = ("epoch", "contact_state", "fault_bits", "tip_hold", "model_version", "particle_state", "energy_sent_aj",
                "wave_sum_w_x_sqrt_aj_s", "wave_sum_w_y_sqrt_aj_s", "wave_sum_w_z_sqrt_aj_s", "wave_energy_aj")

    def __init__(self):
        self.last = None  # (command, reply) that was sent last
        self.left_out = self.in_row = 0

    @staticmethod
    def says(command, reply):
        return ([getattr(command, name) for name in ReplyDeadband.OF_COMMAND]
                + [getattr(reply, name) for name in ReplyDeadband.OF_REPLY] + [reply.measurement_age_ns == 2 ** 64 - 1])

    def leaves_out(self, command, reply, spacing_ns):
        """Of a reply that would be sent; False: it is."""
        if self.last is None or not self.allows(command, reply, spacing_ns):
            self.last, self.in_row = (command, reply), 0
            return False
        self.left_out += 1
        self.in_row += 1
        return True

    def allows(self, command, reply, spacing_ns):
        before, last = self.last
        since_ns = command.send_time_ns - before.send_time_ns
        asked = command.reply_floor_pn or command.reply_relative_permille
        if not asked or command.method == 4 or self.in_row >= self.MOST_IN_A_ROW or since_ns < 0:
            return False
        longest_ns = self.LONGEST_NS if self.in_row else self.LONGEST_OF_TWO_NS
        if since_ns + spacing_ns > longest_ns or self.says(command, reply) != self.says(before, last):
            return False
        force, shown = vector(reply, "force_w_{}_nn"), vector(last, "force_w_{}_nn")
        most_nn = max(1e-3 * command.reply_floor_pn, 1e-3 * command.reply_relative_permille * math.hypot(*shown))
        return math.dist(force, shown) <= most_nn


class Received:
    """A sum as the peer has it: the highest that came."""

    def __init__(self):
        self.value = 0.0

    def update(self, value):
        self.value = max(self.value, value)


class LinkTimes:
    """Round trip (RFC 6298) and the offset of the server's clock; times in ns, modulo 2^64."""

    WINDOW_NS = 10_000_000_000

    def __init__(self):
        self.srtt_ns = self.rttvar_ns = None
        self.last_ns = 0
        self.samples = 0
        self.best = collections.deque()  # (time, round trip, offset)

    @staticmethod
    def difference(a, b):
        d = (a - b) % (1 << 64)
        return d - (1 << 64) if d >= 1 << 63 else d

    def on_reply(self, reply, now_ns):
        t1, t3 = reply.command_send_time_ns, reply.server_time_ns
        whole = self.difference(now_ns, t1)
        round_trip = whole - reply.hold_time_ns
        if whole < 0 or round_trip < 0:
            return  # its hold time exceeds the whole: used, but not for these
        t2 = t3 - reply.hold_time_ns
        self.last_ns = round_trip
        if self.samples == 0:
            self.srtt_ns, self.rttvar_ns = round_trip, round_trip / 2
        else:
            self.rttvar_ns += (abs(self.srtt_ns - round_trip) - self.rttvar_ns) / 4
            self.srtt_ns += (round_trip - self.srtt_ns) / 8
        self.samples += 1
        offset = (self.difference(t2, t1) + self.difference(t3, now_ns)) / 2
        self.best.append((now_ns, round_trip, offset))
        while self.best[0][0] < now_ns - self.WINDOW_NS:
            self.best.popleft()

    def explained_ns(self):
        return max(self.srtt_ns + 4 * self.rttvar_ns, 1.5 * self.last_ns)

    def offset_ns(self):
        return min(self.best, key=lambda sample: sample[1])[2]
