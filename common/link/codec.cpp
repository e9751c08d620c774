#include "telenano/common/link/codec.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

#include "proto/telenano.pb.h"
#include "telenano/common/link/flat_fields.h"
#include "telenano/common/link/wire_scan.h"

namespace telenano::link {

namespace {
constexpr std::uint32_t kSnapshotDataField = 8;
}

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
  w.set_version_min(m.version_min);
  w.set_version_max(m.version_max);
  w.set_feature_bits(m.feature_bits);
  w.set_nonce(m.nonce);
  w.set_cookie(m.cookie);
  w.set_resume_token(m.resume_token);
  w.set_rate_hz(m.rate_hz);
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
  w.set_nonce(m.nonce);
  w.set_cookie(m.cookie);
  return write(MessageType::kChallenge, w, out);
}

std::size_t Codec::encode(const Welcome& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->welcome;
  w.set_version(m.version);
  w.set_feature_bits(m.feature_bits);
  w.set_nonce(m.nonce);
  w.set_session_id(m.session_id);
  w.set_resume_token(m.resume_token);
  w.set_epoch(m.epoch);
  w.set_timeout_ms(m.timeout_ms);
  w.set_slave_rate_max_hz(m.slave_rate_max_hz);
  const auto& text = m.scene_name.text;
  w.mutable_scene_name()->assign(
      text.data(), static_cast<std::size_t>(std::find(text.begin(), text.end(), '\0') - text.begin()));
  w.set_scene_hash(m.scene_hash);
  w.set_workspace_min_w_x_nm(m.workspace_min_w_nm.x());
  w.set_workspace_min_w_y_nm(m.workspace_min_w_nm.y());
  w.set_workspace_min_w_z_nm(m.workspace_min_w_nm.z());
  w.set_workspace_max_w_x_nm(m.workspace_max_w_nm.x());
  w.set_workspace_max_w_y_nm(m.workspace_max_w_nm.y());
  w.set_workspace_max_w_z_nm(m.workspace_max_w_nm.z());
  w.set_start_pos_w_x_nm(m.start_pos_w_nm.x());
  w.set_start_pos_w_y_nm(m.start_pos_w_nm.y());
  w.set_start_pos_w_z_nm(m.start_pos_w_nm.z());
  w.set_surface_z_w_nm(m.surface_z_w_nm);
  w.set_force_max_nn(m.force_max_nn);
  w.set_coupling_stiffness_n_m(m.coupling_stiffness_n_m);
  w.set_coupling_damping_n_s_m(m.coupling_damping_n_s_m);
  w.set_stiffness_min_n_m(m.stiffness_min_n_m);
  w.set_well_aj(m.well_aj);
  w.set_steps_executed(m.steps.executed);
  w.set_state_hash(m.steps.state_hash);
  w.set_steps_breaks(m.steps.breaks);
  w.set_scene_sha256_0(m.scene.hash[0]);
  w.set_scene_sha256_1(m.scene.hash[1]);
  w.set_scene_sha256_2(m.scene.hash[2]);
  w.set_scene_sha256_3(m.scene.hash[3]);
  w.set_scene_bytes(m.scene.bytes);
  w.set_canonical_motion(m.scene.canonical_motion);
  return write(MessageType::kWelcome, w, out);
}

std::size_t Codec::encode(const Refuse& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->refuse;
  w.set_nonce(m.nonce);
  w.set_reason(static_cast<std::uint32_t>(m.reason));
  w.set_version_min(m.version_min);
  w.set_version_max(m.version_max);
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
  constexpr std::uint32_t kTag = (kRecentField << 3) | 2u;
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
  constexpr std::uint32_t kTag = (kStepsField << 3) | 2u;
  put(at, (kTag & 0x7fu) | 0x80u, 1);
  put(at, kTag >> 7, 1);
  put(at, steps.size() < 0x80 ? steps.size() : (steps.size() & 0x7fu) | 0x80u, 1);
  if (steps.size() >= 0x80) put(at, steps.size() >> 7, 1);
  std::memcpy(at, steps.data(), steps.size());
}

template <class Message>
std::size_t write_flat(MessageType type, const Message& message, const RecentCommands& recent,
                       std::span<std::uint8_t> out, std::span<const std::uint8_t> steps = {}) noexcept {
  std::array<std::uint8_t, kMaxDatagramBytes> apart;  // where `out` might be too short
  const bool fits = out.size() >= kMaxDatagramBytes;
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
  write_header(std::span<std::uint8_t, kHeaderBytes>(begin, kHeaderBytes), type, total - kHeaderBytes);
  if (fits) return total;
  if (out.size() < total) return 0;
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
  w.set_session_id(m.session_id);
  w.set_reason(static_cast<std::uint32_t>(m.reason));
  return write(MessageType::kBye, w, out);
}

std::size_t Codec::encode(const SnapshotRequest& m, std::span<std::uint8_t> out) noexcept {
  if (out.size() < kMaxDatagramBytes) return 0;
  FlatWriter writer{out.data() + kHeaderBytes};
  visit_fields(m, writer);
  const std::size_t total = static_cast<std::size_t>(writer.at - out.data());
  write_header(out.first<kHeaderBytes>(), MessageType::kSnapshotRequest, total - kHeaderBytes);
  return total;
}

std::size_t Codec::encode(const SnapshotPiece& m, std::span<std::uint8_t> out) noexcept {
  if (out.size() < kMaxDatagramBytes || m.size > kSnapshotPieceBytes) return 0;
  FlatWriter writer{out.data() + kHeaderBytes};
  visit_fields(m, writer);
  if (m.size > 0) {
    put(writer.at, (kSnapshotDataField << 3) | 2u, 1);
    put(writer.at, m.size < 0x80 ? m.size : (m.size & 0x7fu) | 0x80u, 1);
    if (m.size >= 0x80) put(writer.at, m.size >> 7, 1);
    std::memcpy(writer.at, m.data.data(), m.size);
  }
  const std::size_t total = static_cast<std::size_t>(writer.at - out.data()) + m.size;
  write_header(out.first<kHeaderBytes>(), MessageType::kSnapshotPiece, total - kHeaderBytes);
  return total;
}

std::size_t Codec::encode(const SceneRequest& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->scene_request;
  w.set_session_id(m.session_id);
  w.set_bundle(m.bundle);
  w.set_chunk(m.chunk);
  return write(MessageType::kSceneRequest, w, out);
}

/// Its bytes by hand behind the other fields, as with a Hello's padding.
std::size_t Codec::encode(const SceneChunk& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->scene_chunk;
  w.set_session_id(m.session_id);
  w.set_bundle(m.bundle);
  w.set_chunk(m.chunk);
  const std::size_t size = std::min<std::size_t>(m.size, kSceneChunkBytes);
  const std::size_t fields = w.ByteSizeLong();
  const std::size_t length_bytes = size < 0x80 ? 1 : 2;
  const std::size_t total = kHeaderBytes + fields + 1 + length_bytes + size;
  if (size == 0 || out.size() < total) return 0;
  write_header(out.first<kHeaderBytes>(), MessageType::kSceneChunk, total - kHeaderBytes);
  w.SerializeWithCachedSizesToArray(out.data() + kHeaderBytes);
  std::uint8_t* at = out.data() + kHeaderBytes + fields;
  put(at, (kSceneDataField << 3) | 2u, 1);
  put(at, size < 0x80 ? size : (size & 0x7fu) | 0x80u, 1);
  if (length_bytes == 2) put(at, size >> 7, 1);
  std::memcpy(at, m.data.data(), size);
  return total;
}

namespace {

// What a message may say beyond its form. Monotony and sessions are the business of the state machines.

DropCause read(const wire::Hello& w, Hello& m) noexcept {
  m.version_min = w.version_min();
  m.version_max = w.version_max();
  m.feature_bits = w.feature_bits();
  m.nonce = w.nonce();
  m.cookie = w.cookie();
  m.resume_token = w.resume_token();
  m.rate_hz = w.rate_hz();
  if (m.version_min == 0 || m.version_min > m.version_max || m.nonce == 0) return DropCause::kOutOfRange;
  return DropCause::kNone;
}

DropCause read(const wire::Challenge& w, Challenge& m) noexcept {
  m.nonce = w.nonce();
  m.cookie = w.cookie();
  return m.nonce == 0 || m.cookie == 0 ? DropCause::kOutOfRange : DropCause::kNone;
}

DropCause read(const wire::Welcome& w, Welcome& m) noexcept {
  m.version = w.version();
  m.feature_bits = w.feature_bits();
  m.nonce = w.nonce();
  m.session_id = w.session_id();
  m.resume_token = w.resume_token();
  m.epoch = w.epoch();
  m.timeout_ms = w.timeout_ms();
  m.slave_rate_max_hz = w.slave_rate_max_hz();
  m.scene_name = {};
  std::copy_n(w.scene_name().data(), std::min(w.scene_name().size(), kSceneNameBytes),
              m.scene_name.text.begin());
  m.scene_hash = w.scene_hash();
  m.workspace_min_w_nm = {w.workspace_min_w_x_nm(), w.workspace_min_w_y_nm(), w.workspace_min_w_z_nm()};
  m.workspace_max_w_nm = {w.workspace_max_w_x_nm(), w.workspace_max_w_y_nm(), w.workspace_max_w_z_nm()};
  m.start_pos_w_nm = {w.start_pos_w_x_nm(), w.start_pos_w_y_nm(), w.start_pos_w_z_nm()};
  m.surface_z_w_nm = w.surface_z_w_nm();
  m.force_max_nn = w.force_max_nn();
  m.coupling_stiffness_n_m = w.coupling_stiffness_n_m();
  m.coupling_damping_n_s_m = w.coupling_damping_n_s_m();
  m.stiffness_min_n_m = w.stiffness_min_n_m();
  m.well_aj = w.well_aj();
  m.steps = {};
  m.steps.executed = m.steps.newest = w.steps_executed();
  m.steps.state_hash = w.state_hash();
  m.steps.breaks = w.steps_breaks();
  m.scene.hash = {w.scene_sha256_0(), w.scene_sha256_1(), w.scene_sha256_2(), w.scene_sha256_3()};
  m.scene.bytes = w.scene_bytes();
  m.scene.canonical_motion = w.canonical_motion();
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
  return box && limits && ids && scene ? DropCause::kNone : DropCause::kOutOfRange;
}

DropCause read(const wire::Refuse& w, Refuse& m) noexcept {
  m.nonce = w.nonce();
  m.reason = static_cast<RefuseReason>(w.reason());
  m.version_min = w.version_min();
  m.version_max = w.version_max();
  if (w.reason() < 1 || w.reason() > static_cast<std::uint32_t>(RefuseReason::kShuttingDown))
    return DropCause::kOutOfRange;
  if (m.version_min == 0 || m.version_min > m.version_max || m.nonce == 0) return DropCause::kOutOfRange;
  return DropCause::kNone;
}

DropCause check(const PortControl& m) noexcept {
  if (!all_finite(m.energy_scale_aj_j, m.energy_sent_j, m.wave_sum.x(), m.wave_sum.y(), m.wave_sum.z(),
                  m.wave_energy_aj, m.wave_impedance_n_s_m)) {
    return DropCause::kNonFinite;
  }
  const bool scale = m.energy_scale_aj_j > 0 || (m.energy_scale_aj_j == 0 && !needs_energy_scale(m.method));
  const bool impedance =
      m.wave_impedance_n_s_m > 0 || (m.wave_impedance_n_s_m == 0 && m.method != kMethodWave);
  const bool sums = m.energy_sent_j >= 0 && m.wave_energy_aj >= 0;
  return m.method <= kMethodTwin && scale && impedance && sums ? DropCause::kNone : DropCause::kOutOfRange;
}

DropCause read(const wire::Command& w, PortControl& m) noexcept {
  m.method = w.method();
  m.energy_scale_aj_j = w.energy_scale_aj_j();
  m.energy_sent_j = w.energy_sent_j();
  m.wave_sum = {w.wave_sum_w_x_sqrt_aj_s(), w.wave_sum_w_y_sqrt_aj_s(), w.wave_sum_w_z_sqrt_aj_s()};
  m.wave_energy_aj = w.wave_energy_aj();
  m.wave_impedance_n_s_m = w.wave_impedance_n_s_m();
  return check(m);
}

DropCause check(const PortAnswer& m) noexcept {
  if (!all_finite(m.energy_sent_aj, m.wave_sum.x(), m.wave_sum.y(), m.wave_sum.z(), m.wave_energy_aj)) {
    return DropCause::kNonFinite;
  }
  return m.energy_sent_aj >= 0 && m.wave_energy_aj >= 0 ? DropCause::kNone : DropCause::kOutOfRange;
}

DropCause read(const wire::Reply& w, PortAnswer& m) noexcept {
  m.energy_sent_aj = w.energy_sent_aj();
  m.wave_sum = {w.wave_sum_w_x_sqrt_aj_s(), w.wave_sum_w_y_sqrt_aj_s(), w.wave_sum_w_z_sqrt_aj_s()};
  m.wave_energy_aj = w.wave_energy_aj();
  return check(m);
}

DropCause check(const LocalModel& m) noexcept {
  if (!all_finite(m.point_w_nm) || !all_finite(m.normal_w) ||
      !all_finite(m.stiffness_n_m, m.adhesion_nn, m.shear_stiffness_n_m, m.friction_nn)) {
    return DropCause::kNonFinite;
  }
  const bool normal = std::fabs(m.normal_w.norm() - 1) <= 1e-6 || (m.version == 0 && m.normal_w.isZero(0));
  const bool contact =
      m.stiffness_n_m >= 0 && m.adhesion_nn >= 0 && m.shear_stiffness_n_m >= 0 && m.friction_nn >= 0;
  return normal && contact ? DropCause::kNone : DropCause::kOutOfRange;
}

DropCause read(const wire::Reply& w, LocalModel& m) noexcept {
  m.version = w.model_version();
  m.point_w_nm = {w.model_point_w_x_nm(), w.model_point_w_y_nm(), w.model_point_w_z_nm()};
  m.normal_w = {w.model_normal_w_x(), w.model_normal_w_y(), w.model_normal_w_z()};
  m.stiffness_n_m = w.model_stiffness_n_m();
  m.adhesion_nn = w.model_adhesion_nn();
  m.shear_stiffness_n_m = w.model_shear_stiffness_n_m();
  m.friction_nn = w.model_friction_nn();
  return check(m);
}

DropCause check(const Command& m) noexcept {
  if (!all_finite(m.tip_vel_w_nm_s.x(), m.tip_vel_w_nm_s.y(), m.tip_vel_w_nm_s.z(), m.tip_pos_w_nm.x(),
                  m.tip_pos_w_nm.y(), m.tip_pos_w_nm.z(), m.energy_in_j, m.energy_out_j)) {
    return DropCause::kNonFinite;
  }
  const bool energies = m.energy_in_j >= 0 && m.energy_out_j >= 0;
  return m.sequence != 0 && energies ? DropCause::kNone : DropCause::kOutOfRange;
}

DropCause check(const TipShare& m) noexcept {
  return all_finite(m.pos_w_nm) ? DropCause::kNone : DropCause::kNonFinite;
}

DropCause read(const wire::Reply& w, TipShare& m) noexcept {
  m.hold = w.tip_hold();
  m.pos_w_nm = {w.hold_pos_w_x_nm(), w.hold_pos_w_y_nm(), w.hold_pos_w_z_nm()};
  return check(m);
}

DropCause check(const Particle& m) noexcept {
  if (!all_finite(m.pos_w_nm) || !all_finite(m.radius_nm)) return DropCause::kNonFinite;
  const bool known = m.status <= ParticleStatus::kLost;
  return known && m.radius_nm >= 0 ? DropCause::kNone : DropCause::kOutOfRange;
}

DropCause read(const wire::Reply& w, Particle& m) noexcept {
  m.pos_w_nm = {w.particle_pos_w_x_nm(), w.particle_pos_w_y_nm(), w.particle_pos_w_z_nm()};
  m.radius_nm = w.particle_radius_nm();
  m.status = static_cast<ParticleStatus>(w.particle_state());
  return check(m);
}

DropCause read(const wire::Command& w, Command& m) noexcept {
  m.session_id = w.session_id();
  m.sequence = w.sequence();
  m.send_time_ns = w.send_time_ns();
  m.newest_reply = w.newest_reply();
  m.epoch = w.epoch();
  m.flags = w.flags();
  m.tip_vel_w_nm_s = {w.tip_vel_w_x_nm_s(), w.tip_vel_w_y_nm_s(), w.tip_vel_w_z_nm_s()};
  m.tip_pos_w_nm = {w.tip_pos_w_x_nm(), w.tip_pos_w_y_nm(), w.tip_pos_w_z_nm()};
  m.energy_in_j = w.energy_in_j();
  m.energy_out_j = w.energy_out_j();
  return check(m);
}

DropCause check(const Reply& m) noexcept {
  if (!all_finite(m.force_w_nn.x(), m.force_w_nn.y(), m.force_w_nn.z(), m.tip_pos_w_nm.x(),
                  m.tip_pos_w_nm.y(), m.tip_pos_w_nm.z(), m.deflection_nm, m.energy_in_aj, m.energy_out_aj)) {
    return DropCause::kNonFinite;
  }
  const bool contact = m.contact_state <= ContactState::kContact;
  const bool energies = m.energy_in_aj >= 0 && m.energy_out_aj >= 0;
  return m.sequence != 0 && m.command_sequence != 0 && contact && energies ? DropCause::kNone
                                                                           : DropCause::kOutOfRange;
}

DropCause read(const wire::Reply& w, Reply& m) noexcept {
  m.session_id = w.session_id();
  m.sequence = w.sequence();
  m.command_sequence = w.command_sequence();
  m.command_send_time_ns = w.command_send_time_ns();
  m.server_time_ns = w.server_time_ns();
  m.hold_time_ns = w.hold_time_ns();
  m.measurement_age_ns = w.measurement_age_ns();
  m.epoch = w.epoch();
  m.contact_state = static_cast<ContactState>(w.contact_state());
  m.fault_bits = w.fault_bits();
  m.force_w_nn = {w.force_w_x_nn(), w.force_w_y_nn(), w.force_w_z_nn()};
  m.tip_pos_w_nm = {w.tip_pos_w_x_nm(), w.tip_pos_w_y_nm(), w.tip_pos_w_z_nm()};
  m.deflection_nm = w.deflection_nm();
  m.energy_in_aj = w.energy_in_aj();
  m.energy_out_aj = w.energy_out_aj();
  return check(m);
}

DropCause read(const wire::Bye& w, Bye& m) noexcept {
  m.session_id = w.session_id();
  m.reason = static_cast<ByeReason>(w.reason());
  const bool known = w.reason() >= 1 && w.reason() <= static_cast<std::uint32_t>(ByeReason::kUnknownSession);
  return known && m.session_id != 0 ? DropCause::kNone : DropCause::kOutOfRange;
}

DropCause read(const wire::SceneRequest& w, SceneRequest& m) noexcept {
  m.session_id = w.session_id();
  m.bundle = w.bundle();
  m.chunk = w.chunk();
  return m.session_id != 0 && m.bundle != 0 ? DropCause::kNone : DropCause::kOutOfRange;
}

DropCause read(const wire::SceneChunk& w, SceneChunk& m) noexcept {
  m.session_id = w.session_id();
  m.bundle = w.bundle();
  m.chunk = w.chunk();
  return m.session_id != 0 && m.bundle != 0 ? DropCause::kNone : DropCause::kOutOfRange;
}

/// A number that is none goes before a value out of range, wherever the two are (PROTOCOL.md, section 8).
DropCause first_cause(DropCause a, DropCause b) noexcept {
  return a == DropCause::kNone || b == DropCause::kNonFinite ? b : a;
}

// Fields behind feature bits.

template <class Wire, class Message>
DropCause read_features(const Wire&, Message&) noexcept {
  return DropCause::kNone;
}

DropCause read_features(const wire::Command& wire, Command& message) noexcept {
  message.tip_hold = wire.tip_hold();
  return read(wire, message.control);
}

DropCause read_features(const wire::Reply& wire, Reply& message) noexcept {
  message.steps_before = wire.steps_before();
  message.steps = {wire.steps_executed(), wire.state_hash(),   wire.steps_newest(),
                   wire.steps_breaks(),   wire.break_reason(), wire.break_step()};
  const DropCause contact = first_cause(read(wire, message.port), read(wire, message.model));
  return first_cause(contact, first_cause(read(wire, message.tip), read(wire, message.particle)));
}

void clear_features(Command& m) noexcept {
  m.control = {};
  m.tip_hold = 0;
}

void clear_features(Reply& m) noexcept {
  m.port = {};
  m.model = {};
  m.steps_before = 0;
  m.tip = {};
  m.particle = {};
  m.steps = {};
}

DropCause check_features(const Command& m) noexcept {
  return check(m.control);
}

DropCause check_features(const Reply& m) noexcept {
  const DropCause contact = first_cause(check(m.port), check(m.model));
  return first_cause(contact, first_cause(check(m.tip), check(m.particle)));
}

template <class Wire, class Message>
DropCause parse(const WireFrame& frame, Wire& wire, Message& message) noexcept {
  if (!wire.ParseFromArray(frame.payload.data(), static_cast<int>(frame.payload.size()))) {
    return DropCause::kMalformedField;
  }
  const DropCause cause = read(wire, message);
  return first_cause(cause, read_features(wire, message));
}

/// The usual form of the stream's messages (flat_fields.h). Where `used` is less than all of the payload,
/// what is behind came in another form.
template <class Message>
DropCause read_flat(std::span<const std::uint8_t> payload, Message& message, std::size_t& used) noexcept {
  FlatReader reader{payload.data(), payload.data() + payload.size()};
  visit_fields(message, reader);
  if (reader.at == reader.end) {  // most sessions: all of the others zero, which is in order
    used = payload.size();
    clear_features(message);
    return check(message);
  }
  visit_feature_fields(message, reader);
  used = static_cast<std::size_t>(reader.at - payload.data());
  return first_cause(check(message), check_features(message));
}

/// Snapshots come in the usual form only: rising order, zeros left out, the bytes last.
DropCause read_snapshot(std::span<const std::uint8_t> payload, SnapshotRequest& m) noexcept {
  FlatReader reader{payload.data(), payload.data() + payload.size()};
  visit_fields(m, reader);
  if (reader.at != reader.end) return DropCause::kMalformedField;
  return m.session_id != 0 && m.snapshot != 0 ? DropCause::kNone : DropCause::kOutOfRange;
}

DropCause read_snapshot(std::span<const std::uint8_t> payload, SnapshotPiece& m) noexcept {
  FlatReader reader{payload.data(), payload.data() + payload.size()};
  visit_fields(m, reader);
  const std::uint8_t* at = reader.at;
  m.size = 0;
  if (at != reader.end) {
    if (*at++ != ((kSnapshotDataField << 3) | 2u) || at == reader.end) return DropCause::kMalformedField;
    std::size_t length = *at++;
    if (length >= 0x80) {
      if (at == reader.end || *at == 0 || *at >= 0x80) return DropCause::kMalformedField;
      length = (length & 0x7fu) | (static_cast<std::size_t>(*at++) << 7);
    }
    if (length == 0 || length > kSnapshotPieceBytes || static_cast<std::size_t>(reader.end - at) != length)
      return DropCause::kMalformedField;
    m.size = static_cast<std::uint32_t>(length);
    std::memcpy(m.data.data(), at, length);
  }
  return m.session_id != 0 && m.snapshot != 0 ? DropCause::kNone : DropCause::kOutOfRange;
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
  if (frame.type == MessageType::kSnapshotRequest || frame.type == MessageType::kSnapshotPiece) {
    cause = frame.type == MessageType::kSnapshotRequest
                ? read_snapshot(frame.payload, incoming.snapshot_request)
                : read_snapshot(frame.payload, incoming.snapshot_piece);
    if (cause == DropCause::kNone) incoming.type = frame.type;
    return cause;
  }
  cause = scan_payload(frame);
  if (cause != DropCause::kNone) return cause;
  switch (frame.type) {
    case MessageType::kSnapshotRequest:
    case MessageType::kSnapshotPiece:
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
