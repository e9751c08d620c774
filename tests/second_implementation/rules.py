"""Rules that both ends share, written from PROTOCOL.md sections 4, 5 and 7."""
import collections

from wire import need


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
