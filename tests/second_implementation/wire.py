"""Datagrams of the Telenano protocol, written from PROTOCOL.md sections 1, 2 and 8.

Header, check of every tag and the ranges are here; only the payload's values go through telenano_pb2, which protoc makes
from telenano.proto. A received datagram is a message or a Drop with its cause.
"""
import math
import re
import struct

import telenano_options_pb2 as schema
import telenano_pb2 as pb

MAGIC = b"TLNO"
VERSION = 1
MAX_BYTES = 512
HEADER = struct.Struct("<4sBBH")
TYPES = {1: pb.Hello, 2: pb.Challenge, 3: pb.Welcome, 4: pb.Refuse, 5: pb.Command, 6: pb.Reply, 7: pb.Bye,
         8: pb.SceneRequest, 9: pb.SceneChunk, 10: pb.SnapshotRequest, 11: pb.SnapshotPiece,
         12: pb.SceneListRequest, 13: pb.SceneListEntry, 14: pb.SceneSwitch}
NUMBER = {cls: number for number, cls in TYPES.items()}
ANY_VERSION = (pb.Hello, pb.Refuse)
SCENE_NAME_BYTES = 48
SCENE_CHUNK_BYTES = 464
SNAPSHOT_PIECE_BYTES = 432
STEPS_BYTES = range(10, 301)

globals().update({f"FEATURE_{name}": 1 << bit for name, bit in schema.Feature.items()})
#: station.py and server.py do not ask for the log of steps, for undo or for another scene by themselves, nor grant them.
KNOWN_FEATURES = sum(1 << bit for name, bit in schema.Feature.items() if name not in ("STEP_LOG", "SHARED_LOG", "UNDO", "SCENE_SWITCH"))


def feature_fields():
    """{message: {feature bit: field numbers}}, as the options of telenano.proto say. A vector's stand with its x."""
    table = {}
    for cls in TYPES.values():
        feature = None
        for field in sorted(cls.DESCRIPTOR.fields, key=lambda f: f.number):
            options = field.GetOptions()
            if not re.search("_[yz](_|$)", field.name):
                feature = options.Extensions[schema.feature] if options.HasExtension(schema.feature) else None
            if feature is not None:
                table.setdefault(cls, {}).setdefault(1 << feature, []).append(field.number)
    return table


FEATURE_FIELDS = feature_fields()

CLUTCH, DEADMAN, STOP, TAKE_OVER, HAND_OVER, UNDO = 1, 2, 4, 8, 16, 32
REFUSE_VERSION, REFUSE_FULL, REFUSE_RATE, REFUSE_SHUTTING_DOWN = 1, 2, 3, 4
BYE_DONE, BYE_IDLE, BYE_SHUTTING_DOWN, BYE_STOPPED, BYE_UNKNOWN_SESSION = 1, 2, 3, 4, 5
FAULT_RETRACTED = 1 << 3
FAULT_UNDO = 1 << 8

#: A record of Command.recent_commands: age_ns, flags, position, energy, wave's sum.
RECENT = struct.Struct("<II3dd3d")
MAX_RECENT = 4


class Drop(Exception):
    """A datagram that is not used, and under which cause of section 8 it counts."""

    def __init__(self, cause):
        super().__init__(cause)
        self.cause = cause


def need(condition, cause):
    if not condition:
        raise Drop(cause)


def features_used(message):
    """Bits of the features of which a field differs from zero."""
    used = 0
    for bit, numbers in FEATURE_FIELDS.get(type(message), {}).items():
        if any(getattr(message, message.DESCRIPTOR.fields_by_number[n].name) for n in numbers):
            used |= bit
    return used


def recent_commands(command):
    """[(age_ns, flags, position, energy, wave_sum)] of the commands that this one repeats, newest first."""
    return [(r[0], r[1], r[2:5], r[5], r[6:9]) for r in RECENT.iter_unpack(command.recent_commands)]


def vector(message, pattern):
    """The three components of e.g. "tip_pos_w_{}_nm"."""
    return tuple(getattr(message, pattern.format(axis)) for axis in "xyz")


def set_vector(message, pattern, values):
    for axis, value in zip("xyz", values):
        setattr(message, pattern.format(axis), value)


# Writing


def encode(message):
    payload = message.SerializeToString()
    if isinstance(message, pb.Hello):
        # Field 15, two bytes of length, zeros up to 512 bytes in all.
        zeros = MAX_BYTES - HEADER.size - len(payload) - 3
        payload += bytes([15 << 3 | 2, zeros & 0x7F | 0x80, zeros >> 7]) + bytes(zeros)
    datagram = HEADER.pack(MAGIC, VERSION, NUMBER[type(message)], len(payload)) + payload
    assert len(datagram) <= MAX_BYTES
    return datagram


# Reading


def decode(datagram):
    """The message of a datagram, or Drop."""
    need(len(datagram) <= MAX_BYTES, "oversize")
    need(len(datagram) >= HEADER.size, "truncated")
    magic, version, number, length = HEADER.unpack_from(datagram)
    need(magic == MAGIC, "bad_magic")
    cls = TYPES.get(number)
    need(version == VERSION or cls in ANY_VERSION, "wrong_version")
    need(cls is not None, "unknown_type")
    payload = bytes(datagram[HEADER.size:])
    need(len(payload) >= length, "truncated")
    need(len(payload) == length, "bad_length")
    need(cls is not pb.Hello or len(datagram) == MAX_BYTES, "bad_length")
    scan(payload, cls)
    message = cls()
    try:
        message.ParseFromString(payload)
    except Exception:  # pylint: disable=broad-except
        raise Drop("malformed_field") from None
    check(message)
    if cls is pb.Welcome:
        message.scene_name = message.scene_name.split(b"\0")[0]
    return message


WIRE_TYPE = {"TYPE_FIXED32": 5, "TYPE_FIXED64": 1, "TYPE_DOUBLE": 1, "TYPE_BYTES": 2}
SIZE = {5: 4, 1: 8}


def wire_types(cls):
    kinds = {getattr(type(cls.DESCRIPTOR.fields[0]), name): wire for name, wire in WIRE_TYPE.items()}
    return {field.number: kinds[field.type] for field in cls.DESCRIPTOR.fields}


FIELDS = {cls: wire_types(cls) for cls in NUMBER}


def varint(payload, at):
    """Value and place behind it; in its shortest form, which for all that fits a datagram has two bytes at most."""
    need(at < len(payload), "malformed_field")
    value = payload[at]
    if value < 0x80:
        return value, at + 1
    need(at + 1 < len(payload) and 0 < payload[at + 1] < 0x80, "malformed_field")
    return value & 0x7F | payload[at + 1] << 7, at + 2


IN_ORDER = (pb.SnapshotRequest, pb.SnapshotPiece, pb.SceneListRequest, pb.SceneListEntry, pb.SceneSwitch)


def steps(data):
    """[(number, target, length_ns, flags)] of Command.steps (section 15), or None."""
    first, count = struct.unpack_from("<QB", data)
    at, found, target, length = 9, [], [0, 0, 0], 0

    def number():
        nonlocal at
        value = shift = 0
        while True:
            if at >= len(data) or shift >= 56:
                raise ValueError
            byte = data[at]
            at += 1
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                if byte == 0 and shift:
                    raise ValueError
                return value >> 1 ^ -(value & 1)
            shift += 7

    try:
        while at < len(data):
            head = data[at]
            at += 1
            if not head & 8:
                target = [t + number() for t in target]
                if any(abs(t) > 1 << 46 for t in target):
                    return None
            if not head & 16:
                length += number()
            if not 1000 <= length <= 100_000_000:
                return None
            for _ in range(1 + (head >> 5)):
                found.append((first + len(found), tuple(target), length, head & 7))
    except ValueError:
        return None
    good = 1 <= first <= (1 << 63) - 1 and 1 <= count <= 64 and len(found) == count
    return found if good else None


def pack_steps(first, made):
    """Command.steps of as many of `made`, [(target, length_ns, flags)] from number `first` on, as fit; and how many."""
    def varint_of(value):
        value = value << 1 if value >= 0 else (-value << 1) - 1
        out = bytearray()
        while value >= 0x80:
            out.append(value & 0x7F | 0x80)
            value >>= 7
        return bytes(out) + bytes([value])

    records, target, length, count = b"", (0, 0, 0), 0, 0
    for new_target, new_length, flags in made[:64]:
        head, body = flags & 7, b""
        if new_target == target:
            head |= 8
        else:
            body += b"".join(varint_of(b - a) for a, b in zip(target, new_target))
        if new_length == length:
            head |= 16
        else:
            body += varint_of(new_length - length)
        if 9 + len(records) + 1 + len(body) > STEPS_BYTES[-1]:
            break
        records += bytes([head]) + body
        target, length, count = new_target, new_length, count + 1
    return struct.pack("<QB", first, count) + records, count


def scan(payload, cls):
    """Every field on the list, with its wire type, once, and whole."""
    at, seen = 0, set()
    while at < len(payload):
        tag, at = varint(payload, at)
        field, wire = tag >> 3, tag & 7
        need(FIELDS[cls].get(field) == wire and field not in seen, "malformed_field")
        need(cls not in IN_ORDER or not seen or field > max(seen), "malformed_field")
        seen.add(field)
        if wire == 2:
            size, at = varint(payload, at)
            need(cls is not pb.Welcome or size <= SCENE_NAME_BYTES, "malformed_field")
            need(cls is pb.Welcome or at + size == len(payload), "malformed_field")
            need(cls is not pb.SceneChunk or 1 <= size <= SCENE_CHUNK_BYTES, "malformed_field")
            whole = size > 0 and size % RECENT.size == 0 and size <= MAX_RECENT * RECENT.size
            whole = size in STEPS_BYTES if field == 41 else whole
            need(cls is not pb.Command or whole, "malformed_field")
            need(cls is not pb.SceneListEntry or 1 <= size <= SCENE_NAME_BYTES, "malformed_field")
            need(cls is not pb.SnapshotPiece or 1 <= size <= SNAPSHOT_PIECE_BYTES, "malformed_field")
        else:
            size = SIZE[wire]
        at += size
        need(at <= len(payload), "malformed_field")


def check(m):
    """Ranges of section 2."""
    for field in m.DESCRIPTOR.fields:
        value = getattr(m, field.name)
        need(not isinstance(value, float) or math.isfinite(value), "non_finite")
    if isinstance(m, pb.Command) and m.recent_commands:
        for _, _, position, energy, wave_sum in recent_commands(m):
            need(all(math.isfinite(x) for x in (*position, energy, *wave_sum)), "non_finite")
    good = CHECKS[type(m)](m)
    need(good, "out_of_range")


def scene_offer(welcome):
    """(SHA-256, bytes, canonical motion) of the scene that can be fetched, or None."""
    words = [getattr(welcome, f"scene_sha256_{k}") for k in range(4)]
    if not any(words) and welcome.scene_bytes == 0 and welcome.canonical_motion == 0:
        return None
    return struct.pack("<4Q", *words), welcome.scene_bytes, welcome.canonical_motion


def check_welcome(m):
    low, high = vector(m, "workspace_min_w_{}_nm"), vector(m, "workspace_max_w_{}_nm")
    return (m.version and m.nonce and m.session_id and m.epoch and m.timeout_ms and
            all(a <= b for a, b in zip(low, high)) and
            (scene_offer(m) is None or m.scene_sha256_0 != 0 and m.scene_bytes != 0) and
            min(m.force_max_nn, m.coupling_stiffness_n_m, m.coupling_damping_n_s_m, m.well_aj) >= 0)


def check_command(m):
    not_negative = min(m.energy_in_j, m.energy_out_j, m.energy_scale_aj_j, m.energy_sent_j, m.wave_energy_aj,
                       m.wave_impedance_n_s_m) >= 0
    scale = m.energy_scale_aj_j > 0 or m.method not in (3, 4, 5)
    impedance = m.wave_impedance_n_s_m > 0 or m.method != 4
    repeated = True
    if m.recent_commands:
        recent = recent_commands(m)
        ages = [record[0] for record in recent]
        repeated = len(recent) < m.sequence and ages == sorted(ages) and all(record[3] >= 0 for record in recent)
    return m.sequence and m.method <= 7 and (not m.steps or steps(m.steps) is not None) and not_negative and scale and impedance and repeated \
        and m.reply_relative_permille <= 1000


def check_reply(m):
    not_negative = min(m.energy_in_aj, m.energy_out_aj, m.energy_sent_aj, m.wave_energy_aj, m.model_stiffness_n_m,
                       m.model_adhesion_nn, m.model_shear_stiffness_n_m, m.model_friction_nn, m.particle_radius_nm) >= 0
    normal = vector(m, "model_normal_w_{}")
    unit = abs(math.hypot(*normal) - 1) <= 1e-6 or (m.model_version == 0 and not any(normal))
    states = m.contact_state <= 3 and m.particle_state <= 3
    return m.sequence and m.command_sequence and states and not_negative and unit


CHECKS = {
    pb.Hello: lambda m: 1 <= m.version_min <= m.version_max and m.nonce,
    pb.Challenge: lambda m: m.nonce and m.cookie,
    pb.Welcome: check_welcome,
    pb.Refuse: lambda m: m.nonce and 1 <= m.reason <= 5 and 1 <= m.version_min <= m.version_max,
    pb.Command: check_command,
    pb.Reply: check_reply,
    pb.Bye: lambda m: m.session_id and 1 <= m.reason <= 5,
    pb.SnapshotRequest: lambda m: m.session_id and m.snapshot,
    pb.SnapshotPiece: lambda m: m.session_id and m.snapshot,
    pb.SceneRequest: lambda m: m.session_id and m.bundle,
    pb.SceneChunk: lambda m: m.session_id and m.bundle and m.data,
    pb.SceneListRequest: lambda m: m.session_id,
    pb.SceneListEntry: lambda m: m.session_id and m.scene_hash and m.index < m.count and 0 not in m.scene_name and m.scene_name,
    pb.SceneSwitch: lambda m: m.session_id and m.nonce and m.scene_hash,
}
