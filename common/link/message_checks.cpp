#include "telenano/common/link/message_checks.h"

#include <cmath>

#include "telenano/common/link/flat_fields.h"

namespace telenano::link {
namespace {

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

}  // namespace

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

DropCause check_features(const Command& m) noexcept {
  if (!feature_fields_are_finite(m)) return DropCause::kNonFinite;
  return in_range(is_in_range(m.control) &&
                  m.reply_deadband.relative_permille <= ReplyDeadband::kPermilleMost);
}

DropCause check_features(const Reply& m) noexcept {
  if (!feature_fields_are_finite(m)) return DropCause::kNonFinite;
  return in_range(is_in_range(m.port) && is_in_range(m.model) && is_in_range(m.particle));
}

}  // namespace telenano::link
