#pragma once

#include <bit>
#include <cmath>

#include "proto/wire_fields.h"
#include "telenano/common/base/random.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/link/recent_commands.h"

namespace telenano::link {

/// Any finite double: half of the draws from all bit patterns (subnormals, both zeros, huge), half of
/// ordinary size.
inline double any_finite(Random& random) {
  if (random.chance(0.1)) return random.chance(0.5) ? 0.0 : -0.0;
  if (random.chance(0.5)) return random.normal() * 1000;
  for (;;) {
    const double x = std::bit_cast<double>(random.bits());
    if (std::isfinite(x)) return x;
  }
}

inline Vec3 any_vec(Random& random) {
  return {any_finite(random), any_finite(random), any_finite(random)};
}
/// Any word; often 0, which proto3 leaves out, or all ones.
inline std::uint64_t any_u64(Random& random) {
  const double u = random.uniform();
  return u < 0.1 ? 0 : u < 0.2 ? UINT64_MAX : random.bits() >> random.below(64);
}
inline std::uint32_t any_u32(Random& random) {
  return static_cast<std::uint32_t>(any_u64(random));
}
inline std::uint64_t some_u64(Random& random) {
  return any_u64(random) | 1;
}  // not 0

inline Hello any_hello(Random& random) {
  Hello m;
  m.version_min = 1 + static_cast<std::uint32_t>(random.below(100));
  m.version_max = m.version_min + static_cast<std::uint32_t>(random.below(100));
  m.feature_bits = any_u64(random);
  m.nonce = some_u64(random);
  m.cookie = any_u64(random);
  m.resume_token = any_u64(random);
  m.rate_hz = any_u32(random);
  return m;
}

inline Challenge any_challenge(Random& random) {
  return {some_u64(random), some_u64(random)};
}

inline Welcome any_welcome(Random& random) {
  Welcome m;
  m.version = any_u32(random) | 1;
  m.feature_bits = any_u64(random);
  m.nonce = some_u64(random);
  m.session_id = some_u64(random);
  m.resume_token = any_u64(random);
  m.epoch = any_u32(random) | 1;
  m.timeout_ms = any_u32(random) | 1;
  m.slave_rate_max_hz = any_u32(random);
  const std::uint64_t n = random.below(kSceneNameBytes + 1);
  for (std::size_t i = 0; i < n; ++i) m.scene_name.text[i] = static_cast<char>('a' + random.below(26));
  m.scene_hash = any_u64(random);
  const Vec3 a = any_vec(random);
  const Vec3 b = any_vec(random);
  m.workspace_min_w_nm = a.cwiseMin(b);
  m.workspace_max_w_nm = a.cwiseMax(b);
  m.start_pos_w_nm = any_vec(random);
  m.surface_z_w_nm = any_finite(random);
  m.force_max_nn = std::fabs(any_finite(random));
  m.coupling_stiffness_n_m = std::fabs(any_finite(random));
  m.coupling_damping_n_s_m = std::fabs(any_finite(random));
  m.stiffness_min_n_m = any_finite(random);
  m.well_aj = std::fabs(any_finite(random));
  if (random.chance(0.5)) {
    for (std::uint64_t& word : m.scene.hash) word = any_u64(random);
    m.scene.hash[0] |= 1;
    m.scene.bytes = any_u32(random) | 1;
    m.scene.canonical_motion = any_u64(random);
  }
  return m;
}

inline SceneRequest any_scene_request(Random& random) {
  return {some_u64(random), some_u64(random), any_u32(random)};
}

inline SceneChunk any_scene_chunk(Random& random) {
  SceneChunk m;
  m.session_id = some_u64(random);
  m.bundle = some_u64(random);
  m.chunk = any_u32(random);
  m.size = 1 + static_cast<std::uint32_t>(random.below(kSceneChunkBytes));
  for (std::uint32_t i = 0; i < m.size; ++i) m.data[i] = static_cast<std::uint8_t>(random.bits());
  return m;
}

inline SceneListRequest any_scene_list_request(Random& random) {
  return {some_u64(random), any_u32(random)};
}

inline SceneListEntry any_scene_list_entry(Random& random) {
  SceneListEntry m;
  m.session_id = some_u64(random);
  m.count = any_u32(random) | 1;
  m.index = static_cast<std::uint32_t>(random.below(m.count));
  m.scene_hash = some_u64(random);
  const std::uint64_t n = 1 + random.below(kSceneNameBytes);
  for (std::size_t i = 0; i < n; ++i) m.scene_name.text[i] = static_cast<char>('a' + random.below(26));
  return m;
}

inline SceneSwitch any_scene_switch(Random& random) {
  return {some_u64(random), some_u64(random), some_u64(random)};
}

inline Refuse any_refuse(Random& random) {
  Refuse m;
  m.nonce = some_u64(random);
  m.reason = static_cast<RefuseReason>(1 + random.below(5));
  m.version_min = 1 + static_cast<std::uint32_t>(random.below(100));
  m.version_max = m.version_min + static_cast<std::uint32_t>(random.below(100));
  return m;
}

/// A direction whose length is 1 but for rounding.
inline Vec3 any_direction(Random& random) {
  for (;;) {
    const Vec3 v(random.normal(), random.normal(), random.normal());
    if (v.norm() > 1e-3) return v / v.norm();
  }
}

inline PortControl any_control(Random& random) {
  PortControl m;
  if (random.chance(0.3)) return m;
  m.method = static_cast<std::uint32_t>(random.below(7));
  m.energy_scale_aj_j = std::fabs(any_finite(random)) + (needs_energy_scale(m.method) ? 1e-9 : 0);
  m.energy_sent_j = std::fabs(any_finite(random));
  m.wave_sum = any_vec(random);
  m.wave_energy_aj = std::fabs(any_finite(random));
  m.wave_impedance_n_s_m = std::fabs(any_finite(random)) + (m.method == kMethodWave ? 1e-9 : 0);
  return m;
}

inline PortAnswer any_answer(Random& random) {
  PortAnswer m;
  if (random.chance(0.3)) return m;
  m.energy_sent_aj = std::fabs(any_finite(random));
  m.wave_sum = any_vec(random);
  m.wave_energy_aj = std::fabs(any_finite(random));
  return m;
}

inline LocalModel any_model(Random& random) {
  LocalModel m;
  if (random.chance(0.3)) return m;
  m.version = any_u32(random);
  m.point_w_nm = any_vec(random);
  if (m.version != 0 || random.chance(0.5)) m.normal_w = any_direction(random);
  m.stiffness_n_m = std::fabs(any_finite(random));
  m.adhesion_nn = std::fabs(any_finite(random));
  m.shear_stiffness_n_m = std::fabs(any_finite(random));
  m.friction_nn = std::fabs(any_finite(random));
  return m;
}

/// For visit_feature_fields: fields of higher numbers than those that are drawn by name get any value.
struct DrawLater {
  Random& random;
  std::uint32_t last;  ///< number of the last one drawn by name

  template <std::uint32_t number, class Value>
  void operator()(Value& value) {
    if (number <= last || random.chance(0.5)) return;
    if constexpr (std::is_floating_point_v<Value>)
      value = any_finite(random);
    else
      value = static_cast<Value>(any_u64(random));
  }
  template <class Fields>
  void run(const Fields& fields) {
    fields(*this);
  }
};

inline Command any_command(Random& random) {
  Command m;
  m.session_id = any_u64(random);
  m.sequence = some_u64(random);
  m.send_time_ns = any_u64(random);
  m.newest_reply = any_u64(random);
  m.epoch = any_u32(random);
  m.flags = any_u32(random);
  m.tip_vel_w_nm_s = any_vec(random);
  m.tip_pos_w_nm = any_vec(random);
  m.energy_in_j = std::fabs(any_finite(random));
  m.energy_out_j = std::fabs(any_finite(random));
  m.control = any_control(random);
  if (random.chance(0.5)) m.tip_hold = any_u32(random);
  DrawLater later{random, 31};
  visit_feature_fields(m, later);
  m.reply_deadband.relative_permille %= ReplyDeadband::kPermilleMost + 1;
  return m;
}

inline RecentCommands any_recent(Random& random, std::uint64_t sequence) {
  RecentCommands m;
  m.count = std::min<std::uint64_t>(random.below(kMaxRecent + 1), sequence - 1);
  std::uint32_t age_ns = 0;
  for (std::size_t i = 0; i < m.count; ++i) {
    RecentCommand& r = m.record[i];
    r.age_ns = age_ns += static_cast<std::uint32_t>(random.below(1u << 30));
    r.flags = any_u32(random);
    r.tip_pos_w_nm = any_vec(random);
    r.energy = std::fabs(any_finite(random));
    r.wave_sum = any_vec(random);
  }
  return m;
}

inline Reply any_reply(Random& random) {
  Reply m;
  m.session_id = any_u64(random);
  m.sequence = some_u64(random);
  m.command_sequence = some_u64(random);
  m.command_send_time_ns = any_u64(random);
  m.server_time_ns = any_u64(random);
  m.hold_time_ns = any_u64(random);
  m.measurement_age_ns = any_u64(random);
  m.epoch = any_u32(random);
  m.contact_state = static_cast<ContactState>(random.below(4));
  m.fault_bits = any_u32(random);
  m.force_w_nn = any_vec(random);
  m.tip_pos_w_nm = any_vec(random);
  m.deflection_nm = any_finite(random);
  m.energy_in_aj = std::fabs(any_finite(random));
  m.energy_out_aj = std::fabs(any_finite(random));
  m.port = any_answer(random);
  m.model = any_model(random);
  if (random.chance(0.5)) m.tip = {any_u32(random), any_vec(random)};
  if (random.chance(0.5)) m.steps_before = any_u64(random);
  if (random.chance(0.5)) {
    const auto status = static_cast<ParticleStatus>(random.below(4));
    m.particle = {any_vec(random), std::fabs(any_finite(random)), status};
  }
  DrawLater later{random, 45};
  visit_feature_fields(m, later);
  return m;
}

inline Bye any_bye(Random& random) {
  return {some_u64(random), static_cast<ByeReason>(1 + random.below(5))};
}

}  // namespace telenano::link
