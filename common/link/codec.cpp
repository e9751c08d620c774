#include "telenano/common/link/codec.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

#include "proto/telenano.pb.h"
#include "proto/wire_messages.h"
#include "telenano/common/link/flat_fields.h"
#include "telenano/common/link/wire_scan.h"

namespace telenano::link {

struct Codec::Messages {
  wire::Hello hello;
  wire::Challenge challenge;
  wire::Welcome welcome;
  wire::Refuse refuse;
  wire::Command command;
  wire::Reply reply;
  wire::Bye bye;
  wire::SceneRequest scene_request;
  wire::SceneChunk scene_chunk;
};

Codec::Codec() : messages_(std::make_unique<Messages>()) {
  // The one field that lives on the heap: take its memory now; Clear() keeps it.
  messages_->welcome.set_scene_name(std::string(kSceneNameBytes, ' '));
  messages_->welcome.Clear();
}

Codec::~Codec() = default;

namespace {

template <class Wire>
std::size_t write(MessageType type, const Wire& wire, std::span<std::uint8_t> out) noexcept {
  const std::size_t payload_bytes = wire.ByteSizeLong();
  const std::size_t total = kHeaderBytes + payload_bytes;
  if (out.size() < total) return 0;
  write_header(out.first<kHeaderBytes>(), type, payload_bytes);
  wire.SerializeWithCachedSizesToArray(out.data() + kHeaderBytes);
  return total;
}

/// Sum of the differences x - x: 0 if every one is finite, NaN otherwise. One branch for the whole message.
template <class... Doubles>
bool all_finite(Doubles... values) noexcept {
  return ((values - values) + ... + 0.0) == 0.0;
}

bool all_finite(const Vec3& v) noexcept {
  return all_finite(v.x(), v.y(), v.z());
}

}  // namespace

std::size_t Codec::encode(const Hello& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->hello;
  to_wire(m, w);
  if (out.size() < kMaxDatagramBytes) return 0;
  const std::size_t fields = w.ByteSizeLong();
  write_header(out.first<kHeaderBytes>(), MessageType::kHello, kMaxPayloadBytes);
  w.SerializeWithCachedSizesToArray(out.data() + kHeaderBytes);
  // Padding by hand (field 15, length in two bytes, zeros), so that no string is needed for it.
  std::uint8_t* const tail = out.data() + kHeaderBytes + fields;
  const std::size_t zeros = kMaxPayloadBytes - fields - 3;
  tail[0] = (15u << 3) | 2u;
  tail[1] = static_cast<std::uint8_t>((zeros & 0x7fu) | 0x80u);
  tail[2] = static_cast<std::uint8_t>(zeros >> 7);
  std::memset(tail + 3, 0, zeros);
  return kMaxDatagramBytes;
}

std::size_t Codec::encode(const Challenge& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->challenge;
  to_wire(m, w);
  return write(MessageType::kChallenge, w, out);
}

std::size_t Codec::encode(const Welcome& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->welcome;
  to_wire(m, w);
  const auto& text = m.scene_name.text;
  w.mutable_scene_name()->assign(
      text.data(), static_cast<std::size_t>(std::find(text.begin(), text.end(), '\0') - text.begin()));
  return write(MessageType::kWelcome, w, out);
}

std::size_t Codec::encode(const Refuse& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->refuse;
  to_wire(m, w);
  return write(MessageType::kRefuse, w, out);
}

namespace {

// The repeated commands by hand, behind the other fields: to Protobuf a nested message or a byte string there
// would cost an allocation each.

void put(std::uint8_t*& at, std::uint64_t bits, int bytes) noexcept {
  for (int i = 0; i < bytes; ++i) *at++ = static_cast<std::uint8_t>(bits >> (8 * i));
}
void put(std::uint8_t*& at, double value) noexcept {
  put(at, std::bit_cast<std::uint64_t>(value), 8);
}
std::uint64_t take(const std::uint8_t*& at, int bytes) noexcept {
  std::uint64_t bits = 0;
  for (int i = 0; i < bytes; ++i) bits |= std::uint64_t{*at++} << (8 * i);
  return bits;
}
double take(const std::uint8_t*& at) noexcept {
  return std::bit_cast<double>(take(at, 8));
}

std::size_t recent_field_bytes(std::size_t count) noexcept {
  const std::size_t length = count * kRecentBytes;
  return count == 0 ? 0 : kRecentTagBytes + (length < 0x80 ? 1 : 2) + length;
}

void write_recent(const RecentCommands& recent, std::uint8_t* at) noexcept {
  constexpr std::uint32_t kTag = (kCommandRecentCommands << 3) | 2u;
  const std::size_t length = recent.count * kRecentBytes;
  put(at, (kTag & 0x7fu) | 0x80u, 1);
  put(at, kTag >> 7, 1);
  put(at, length < 0x80 ? length : (length & 0x7fu) | 0x80u, 1);
  if (length >= 0x80) put(at, length >> 7, 1);
  for (std::size_t i = 0; i < recent.count; ++i) {
    const RecentCommand& r = recent.record[i];
    put(at, r.age_ns, 4);
    put(at, r.flags, 4);
    for (int axis = 0; axis < 3; ++axis) put(at, r.tip_pos_w_nm[axis]);
    put(at, r.energy);
    for (int axis = 0; axis < 3; ++axis) put(at, r.wave_sum[axis]);
  }
}

DropCause read_recent(std::span<const std::uint8_t> bytes, std::uint64_t sequence,
                      RecentCommands& recent) noexcept {
  recent.count = bytes.size() / kRecentBytes;
  const std::uint8_t* at = bytes.data();
  bool finite = true, good = recent.count < sequence;
  std::uint32_t last_age_ns = 0;
  for (std::size_t i = 0; i < recent.count; ++i) {
    RecentCommand& r = recent.record[i];
    r.age_ns = static_cast<std::uint32_t>(take(at, 4));
    r.flags = static_cast<std::uint32_t>(take(at, 4));
    for (int axis = 0; axis < 3; ++axis) r.tip_pos_w_nm[axis] = take(at);
    r.energy = take(at);
    for (int axis = 0; axis < 3; ++axis) r.wave_sum[axis] = take(at);
    finite = finite && all_finite(r.tip_pos_w_nm) && all_finite(r.wave_sum) && all_finite(r.energy);
    good = good && r.age_ns >= last_age_ns && r.energy >= 0;
    last_age_ns = r.age_ns;
  }
  return !finite ? DropCause::kNonFinite : good ? DropCause::kNone : DropCause::kOutOfRange;
}

const RecentCommands kNoRecent;

std::size_t steps_field_bytes(std::size_t length) noexcept {
  return length == 0 ? 0 : kRecentTagBytes + (length < 0x80 ? 1 : 2) + length;
}

void write_steps(std::span<const std::uint8_t> steps, std::uint8_t* at) noexcept {
  constexpr std::uint32_t kTag = (kCommandSteps << 3) | 2u;
  put(at, (kTag & 0x7fu) | 0x80u, 1);
  put(at, kTag >> 7, 1);
  put(at, steps.size() < 0x80 ? steps.size() : (steps.size() & 0x7fu) | 0x80u, 1);
  if (steps.size() >= 0x80) put(at, steps.size() >> 7, 1);
  std::memcpy(at, steps.data(), steps.size());
}

template <class Message>
std::size_t write_flat(MessageType type, const Message& message, const RecentCommands& recent,
                       std::span<std::uint8_t> out, std::span<const std::uint8_t> steps = {}) noexcept {
  // Where `out` might be too short; and with steps, where fields that no session has together would come to more than
  // a datagram holds.
  std::array<std::uint8_t, kMaxDatagramBytes + 64> apart;
  const bool fits = steps.empty() && out.size() >= kMaxDatagramBytes;
  std::uint8_t* const begin = fits ? out.data() : apart.data();
  FlatWriter writer{begin + kHeaderBytes};
  visit_fields(message, writer);
  AnyBits features;
  visit_feature_fields(message, features);
  if (features.bits != 0) visit_feature_fields(message, writer);
  if (recent.count > 0) write_recent(recent, writer.at);
  if (!steps.empty()) write_steps(steps, writer.at);
  const std::size_t total = static_cast<std::size_t>(writer.at - begin) + recent_field_bytes(recent.count) +
                            steps_field_bytes(steps.size());
  if (total > kMaxDatagramBytes || out.size() < total) return 0;
  write_header(std::span<std::uint8_t, kHeaderBytes>(begin, kHeaderBytes), type, total - kHeaderBytes);
  if (fits) return total;
  std::memcpy(out.data(), begin, total);
  return total;
}

}  // namespace

std::size_t Codec::encode(const Command& m, std::span<std::uint8_t> out) noexcept {
  return write_flat(MessageType::kCommand, m, kNoRecent, out);
}

std::size_t Codec::encode(const Command& m, const RecentCommands& recent,
                          std::span<std::uint8_t> out) noexcept {
  return write_flat(MessageType::kCommand, m, recent, out);
}

std::size_t Codec::encode(const Command& m, std::span<const std::uint8_t> steps,
                          std::span<std::uint8_t> out) noexcept {
  if (steps.size() > kStepsBytesMost) return 0;
  return write_flat(MessageType::kCommand, m, kNoRecent, out, steps);
}

std::size_t Codec::encode(const Reply& m, std::span<std::uint8_t> out) noexcept {
  return write_flat(MessageType::kReply, m, kNoRecent, out);
}

std::size_t Codec::encode(const Bye& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->bye;
  to_wire(m, w);
  return write(MessageType::kBye, w, out);
}

namespace {

/// Of a message that comes in the usual form only; `data` is its last field, or none.
template <class Message>
std::size_t write_in_order(MessageType type, const Message& m, std::span<std::uint8_t> out,
                           std::uint32_t data_field = 0, std::span<const std::uint8_t> data = {}) noexcept {
  if (out.size() < kMaxDatagramBytes) return 0;
  FlatWriter writer{out.data() + kHeaderBytes};
  visit_fields(m, writer);
  if (!data.empty()) {
    put(writer.at, (data_field << 3) | 2u, 1);
    put(writer.at, data.size() < 0x80 ? data.size() : (data.size() & 0x7fu) | 0x80u, 1);
    if (data.size() >= 0x80) put(writer.at, data.size() >> 7, 1);
    std::memcpy(writer.at, data.data(), data.size());
  }
  const std::size_t total = static_cast<std::size_t>(writer.at - out.data()) + data.size();
  write_header(out.first<kHeaderBytes>(), type, total - kHeaderBytes);
  return total;
}

/// The bytes of a name, up to its end.
std::span<const std::uint8_t> bytes_of(const SceneName& name) noexcept {
  const auto end = std::find(name.text.begin(), name.text.end(), '\0');
  return {reinterpret_cast<const std::uint8_t*>(name.text.data()),
          static_cast<std::size_t>(end - name.text.begin())};
}

}  // namespace

std::size_t Codec::encode(const SnapshotRequest& m, std::span<std::uint8_t> out) noexcept {
  return write_in_order(MessageType::kSnapshotRequest, m, out);
}

std::size_t Codec::encode(const SnapshotPiece& m, std::span<std::uint8_t> out) noexcept {
  if (m.size > kSnapshotPieceBytes) return 0;
  return write_in_order(MessageType::kSnapshotPiece, m, out, kSnapshotPieceData,
                        std::span<const std::uint8_t>(m.data).first(m.size));
}

std::size_t Codec::encode(const SceneListRequest& m, std::span<std::uint8_t> out) noexcept {
  return write_in_order(MessageType::kSceneListRequest, m, out);
}

std::size_t Codec::encode(const SceneListEntry& m, std::span<std::uint8_t> out) noexcept {
  return write_in_order(MessageType::kSceneListEntry, m, out, kSceneListEntrySceneName,
                        bytes_of(m.scene_name));
}

std::size_t Codec::encode(const SceneSwitch& m, std::span<std::uint8_t> out) noexcept {
  return write_in_order(MessageType::kSceneSwitch, m, out);
}

std::size_t Codec::encode(const SceneRequest& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->scene_request;
  to_wire(m, w);
  return write(MessageType::kSceneRequest, w, out);
}

/// Its bytes by hand behind the other fields, as with a Hello's padding.
std::size_t Codec::encode(const SceneChunk& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->scene_chunk;
  to_wire(m, w);
  const std::size_t size = std::min<std::size_t>(m.size, kSceneChunkBytes);
  const std::size_t fields = w.ByteSizeLong();
  const std::size_t length_bytes = size < 0x80 ? 1 : 2;
  const std::size_t total = kHeaderBytes + fields + 1 + length_bytes + size;
  if (size == 0 || out.size() < total) return 0;
  write_header(out.first<kHeaderBytes>(), MessageType::kSceneChunk, total - kHeaderBytes);
  w.SerializeWithCachedSizesToArray(out.data() + kHeaderBytes);
  std::uint8_t* at = out.data() + kHeaderBytes + fields;
  put(at, (kSceneChunkData << 3) | 2u, 1);
  put(at, size < 0x80 ? size : (size & 0x7fu) | 0x80u, 1);
  if (length_bytes == 2) put(at, size >> 7, 1);
  std::memcpy(at, m.data.data(), size);
  return total;
}

namespace {

// What a message may say beyond its form. Monotony and sessions are the business of the state machines. A number
// that is none goes before a value out of range, wherever the two are (PROTOCOL.md, section 8).

constexpr DropCause in_range(bool good) noexcept {
  return good ? DropCause::kNone : DropCause::kOutOfRange;
}

DropCause first_cause(DropCause a, DropCause b) noexcept {
  return a == DropCause::kNone || b == DropCause::kNonFinite ? b : a;
}

DropCause check(const Hello& m) noexcept {
  return in_range(m.version_min != 0 && m.version_min <= m.version_max && m.nonce != 0);
}

DropCause check(const Challenge& m) noexcept {
  return in_range(m.nonce != 0 && m.cookie != 0);
}

DropCause check(const Welcome& m) noexcept {
  if (!all_finite(m.workspace_min_w_nm) || !all_finite(m.workspace_max_w_nm) ||
      !all_finite(m.start_pos_w_nm) ||
      !all_finite(m.surface_z_w_nm, m.force_max_nn, m.coupling_stiffness_n_m, m.coupling_damping_n_s_m,
                  m.stiffness_min_n_m, m.well_aj)) {
    return DropCause::kNonFinite;
  }
  const bool box = (m.workspace_min_w_nm.array() <= m.workspace_max_w_nm.array()).all();
  const bool limits =
      m.force_max_nn >= 0 && m.coupling_stiffness_n_m >= 0 && m.coupling_damping_n_s_m >= 0 && m.well_aj >= 0;
  const bool ids = m.version != 0 && m.nonce != 0 && m.session_id != 0 && m.epoch != 0 && m.timeout_ms != 0;
  const bool scene = m.scene.empty() || (m.scene.bytes != 0 && m.scene.name() != 0);
  return in_range(box && limits && ids && scene);
}

DropCause check(const Refuse& m) noexcept {
  const bool reason = m.reason >= RefuseReason::kVersion && m.reason <= RefuseReason::kScene;
  return in_range(reason && m.version_min != 0 && m.version_min <= m.version_max && m.nonce != 0);
}

DropCause check(const Bye& m) noexcept {
  return in_range(m.reason >= ByeReason::kDone && m.reason <= ByeReason::kUnknownSession &&
                  m.session_id != 0);
}

DropCause check(const SceneRequest& m) noexcept {
  return in_range(m.session_id != 0 && m.bundle != 0);
}

DropCause check(const SceneChunk& m) noexcept {
  return in_range(m.session_id != 0 && m.bundle != 0);
}

template <class Message>
bool fields_are_finite(const Message& m) noexcept {
  AllFinite finite;
  visit_fields(m, finite);
  return finite.is();
}

template <class Message>
bool feature_fields_are_finite(const Message& m) noexcept {
  AllFinite finite;
  visit_feature_fields(m, finite);
  return finite.is();
}

DropCause check(const Command& m) noexcept {
  if (!fields_are_finite(m)) return DropCause::kNonFinite;
  return in_range(m.sequence != 0 && m.energy_in_j >= 0 && m.energy_out_j >= 0);
}

DropCause check(const Reply& m) noexcept {
  if (!fields_are_finite(m)) return DropCause::kNonFinite;
  const bool contact = m.contact_state <= ContactState::kContact;
  const bool energies = m.energy_in_aj >= 0 && m.energy_out_aj >= 0;
  return in_range(m.sequence != 0 && m.command_sequence != 0 && contact && energies);
}

// Fields behind feature bits.

bool is_in_range(const PortControl& m) noexcept {
  const bool scale = m.energy_scale_aj_j > 0 || (m.energy_scale_aj_j == 0 && !needs_energy_scale(m.method));
  const bool impedance =
      m.wave_impedance_n_s_m > 0 || (m.wave_impedance_n_s_m == 0 && m.method != kMethodWave);
  return m.method <= kMethodTwin && scale && impedance && m.energy_sent_j >= 0 && m.wave_energy_aj >= 0;
}

bool is_in_range(const PortAnswer& m) noexcept {
  return m.energy_sent_aj >= 0 && m.wave_energy_aj >= 0;
}

bool is_in_range(const LocalModel& m) noexcept {
  const bool normal = std::fabs(m.normal_w.norm() - 1) <= 1e-6 || (m.version == 0 && m.normal_w.isZero(0));
  return normal && m.stiffness_n_m >= 0 && m.adhesion_nn >= 0 && m.shear_stiffness_n_m >= 0 &&
         m.friction_nn >= 0;
}

bool is_in_range(const Particle& m) noexcept {
  return m.status <= ParticleStatus::kLost && m.radius_nm >= 0;
}

template <class Message>
DropCause check_features(const Message&) noexcept {
  return DropCause::kNone;
}

DropCause check_features(const Command& m) noexcept {
  if (!feature_fields_are_finite(m)) return DropCause::kNonFinite;
  return in_range(is_in_range(m.control) &&
                  m.reply_deadband.relative_permille <= ReplyDeadband::kPermilleMost);
}

DropCause check_features(const Reply& m) noexcept {
  if (!feature_fields_are_finite(m)) return DropCause::kNonFinite;
  return in_range(is_in_range(m.port) && is_in_range(m.model) && is_in_range(m.particle));
}

// What lies in a message and not in its fields alone.
template <class Wire, class Message>
void complete(const Wire&, Message&) noexcept {}

void complete(const wire::Welcome& w, Welcome& m) noexcept {
  m.scene_name = {};
  std::copy_n(w.scene_name().data(), std::min(w.scene_name().size(), kSceneNameBytes),
              m.scene_name.text.begin());
  m.steps.newest = m.steps.executed;
  m.steps.break_reason = 0;
  m.steps.break_step = 0;
}

template <class Wire, class Message>
DropCause parse(const WireFrame& frame, Wire& wire, Message& message) noexcept {
  if (!wire.ParseFromArray(frame.payload.data(), static_cast<int>(frame.payload.size()))) {
    return DropCause::kMalformedField;
  }
  from_wire(wire, message);
  complete(wire, message);
  return first_cause(check(message), check_features(message));
}

/// The usual form of the stream's messages (flat_fields.h). Where `used` is less than all of the payload,
/// what is behind came in another form.
template <class Message>
DropCause read_flat(std::span<const std::uint8_t> payload, Message& message, std::size_t& used) noexcept {
  FlatReader reader{payload.data(), payload.data() + payload.size()};
  visit_fields(message, reader);
  if (reader.at == reader.end) {  // most sessions: all of the others zero, which is in order
    used = payload.size();
    Clearing clearing;
    visit_feature_fields(message, clearing);
    return check(message);
  }
  visit_feature_fields(message, reader);
  used = static_cast<std::size_t>(reader.at - payload.data());
  return first_cause(check(message), check_features(message));
}

// These come in the usual form only: rising order, zeros left out, the bytes last.

/// Where the fields before the bytes end.
template <class Message>
const std::uint8_t* read_in_order(std::span<const std::uint8_t> payload, Message& m) noexcept {
  FlatReader reader{payload.data(), payload.data() + payload.size()};
  visit_fields(m, reader);
  return reader.at;
}

/// The bytes of this field, from `at` to the payload's end, 1 to `most`. False: they are something else.
bool read_last_bytes(std::span<const std::uint8_t> payload, const std::uint8_t* at, std::uint32_t field,
                     std::size_t most, std::span<const std::uint8_t>& data) noexcept {
  const std::uint8_t* const end = payload.data() + payload.size();
  data = {};
  if (at == end) return true;
  if (*at++ != ((field << 3) | 2u) || at == end) return false;
  std::size_t length = *at++;
  if (length >= 0x80) {
    if (at == end || *at == 0 || *at >= 0x80) return false;
    length = (length & 0x7fu) | (static_cast<std::size_t>(*at++) << 7);
  }
  if (length == 0 || length > most || static_cast<std::size_t>(end - at) != length) return false;
  data = {at, length};
  return true;
}

DropCause read_ordered(std::span<const std::uint8_t> payload, SnapshotRequest& m) noexcept {
  if (read_in_order(payload, m) != payload.data() + payload.size()) return DropCause::kMalformedField;
  return in_range(m.session_id != 0 && m.snapshot != 0);
}

DropCause read_ordered(std::span<const std::uint8_t> payload, SnapshotPiece& m) noexcept {
  std::span<const std::uint8_t> data;
  const std::uint8_t* const at = read_in_order(payload, m);
  if (!read_last_bytes(payload, at, kSnapshotPieceData, kSnapshotPieceBytes, data))
    return DropCause::kMalformedField;
  m.size = static_cast<std::uint32_t>(data.size());
  std::copy(data.begin(), data.end(), m.data.begin());
  return in_range(m.session_id != 0 && m.snapshot != 0);
}

DropCause read_ordered(std::span<const std::uint8_t> payload, SceneListRequest& m) noexcept {
  if (read_in_order(payload, m) != payload.data() + payload.size()) return DropCause::kMalformedField;
  return in_range(m.session_id != 0);
}

DropCause read_ordered(std::span<const std::uint8_t> payload, SceneListEntry& m) noexcept {
  std::span<const std::uint8_t> name;
  const std::uint8_t* const at = read_in_order(payload, m);
  if (!read_last_bytes(payload, at, kSceneListEntrySceneName, kSceneNameBytes, name))
    return DropCause::kMalformedField;
  m.scene_name = {};
  std::copy(name.begin(), name.end(), m.scene_name.text.begin());
  const bool named = !name.empty() && std::find(name.begin(), name.end(), 0) == name.end();
  return in_range(m.session_id != 0 && m.scene_hash != 0 && m.index < m.count && named);
}

DropCause read_ordered(std::span<const std::uint8_t> payload, SceneSwitch& m) noexcept {
  if (read_in_order(payload, m) != payload.data() + payload.size()) return DropCause::kMalformedField;
  return in_range(m.session_id != 0 && m.nonce != 0 && m.scene_hash != 0);
}

/// `is_one` false: it is none of these.
DropCause read_ordered(const WireFrame& frame, Incoming& in, bool& is_one) noexcept {
  is_one = true;
  switch (frame.type) {
    case MessageType::kSnapshotRequest:
      return read_ordered(frame.payload, in.snapshot_request);
    case MessageType::kSnapshotPiece:
      return read_ordered(frame.payload, in.snapshot_piece);
    case MessageType::kSceneListRequest:
      return read_ordered(frame.payload, in.scene_list_request);
    case MessageType::kSceneListEntry:
      return read_ordered(frame.payload, in.scene_list_entry);
    case MessageType::kSceneSwitch:
      return read_ordered(frame.payload, in.scene_switch);
    default:
      is_one = false;
      return DropCause::kNone;
  }
}

/// What stands behind a Command's fields.
DropCause read_tail(const WireFrame& frame, Incoming& incoming) noexcept {
  incoming.steps.count = 0;
  if (!frame.steps.empty() && !read_steps(frame.steps, incoming.steps)) return DropCause::kOutOfRange;
  return read_recent(frame.recent, incoming.command.sequence, incoming.recent);
}

}  // namespace

DropCause Codec::decode(std::span<const std::uint8_t> datagram, Incoming& incoming) noexcept {
  incoming.type = MessageType::kNone;
  WireFrame frame;
  DropCause cause = scan_header(datagram, frame);
  if (cause != DropCause::kNone) return cause;
  std::size_t used = 0;
  if (frame.type == MessageType::kCommand) {
    cause = read_flat(frame.payload, incoming.command, used);
    if (used == frame.payload.size() || take_tail(frame.payload, used, frame)) {
      cause = first_cause(cause, read_tail(frame, incoming));
      if (cause == DropCause::kNone) incoming.type = frame.type;
      return cause;
    }
  } else if (frame.type == MessageType::kReply) {
    cause = read_flat(frame.payload, incoming.reply, used);
    if (used == frame.payload.size()) {
      if (cause == DropCause::kNone) incoming.type = frame.type;
      return cause;
    }
  }
  bool ordered = false;
  cause = read_ordered(frame, incoming, ordered);
  if (ordered) {
    if (cause == DropCause::kNone) incoming.type = frame.type;
    return cause;
  }
  cause = scan_payload(frame);
  if (cause != DropCause::kNone) return cause;
  switch (frame.type) {
    case MessageType::kSnapshotRequest:
    case MessageType::kSnapshotPiece:
    case MessageType::kSceneListRequest:
    case MessageType::kSceneListEntry:
    case MessageType::kSceneSwitch:
      break;
    case MessageType::kHello:
      cause = parse(frame, messages_->hello, incoming.hello);
      break;
    case MessageType::kChallenge:
      cause = parse(frame, messages_->challenge, incoming.challenge);
      break;
    case MessageType::kWelcome:
      cause = parse(frame, messages_->welcome, incoming.welcome);
      break;
    case MessageType::kRefuse:
      cause = parse(frame, messages_->refuse, incoming.refuse);
      break;
    case MessageType::kCommand:
      cause = parse(frame, messages_->command, incoming.command);
      cause = first_cause(cause, read_tail(frame, incoming));
      break;
    case MessageType::kReply:
      cause = parse(frame, messages_->reply, incoming.reply);
      break;
    case MessageType::kBye:
      cause = parse(frame, messages_->bye, incoming.bye);
      break;
    case MessageType::kSceneRequest:
      cause = parse(frame, messages_->scene_request, incoming.scene_request);
      break;
    case MessageType::kSceneChunk:
      cause = parse(frame, messages_->scene_chunk, incoming.scene_chunk);
      incoming.scene_chunk.size = static_cast<std::uint32_t>(frame.data.size());
      std::copy(frame.data.begin(), frame.data.end(), incoming.scene_chunk.data.begin());
      if (frame.data.empty()) cause = first_cause(cause, DropCause::kOutOfRange);
      break;
    case MessageType::kNone:
      cause = DropCause::kUnknownType;
      break;
  }
  if (cause == DropCause::kNone) incoming.type = frame.type;
  return cause;
}

}  // namespace telenano::link
