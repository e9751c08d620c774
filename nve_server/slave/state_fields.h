#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/equilibrium/level_equilibrium.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/particle/particle_equilibrium.h"
#include "telenano/nve_server/slave/state_bytes.h"

/// What of a slave's state later steps depend on, field by field, in one list for three uses: the hash that
/// two ends compare, the bytes of a snapshot, and reading them again. Whatever is left out here is left out
/// of all three, and a replay after a restore shows it.
///
/// Warm starts are part of it: a search that begins elsewhere ends in other last bits. What is a pure
/// function of the rest (the curve at a radius, springs) is not: it is made again.
namespace telenano::slave {

/// Mixes one word: a multiplication and a fold of its halves (after Wang's wyhash), about a nanosecond.
inline std::uint64_t mix_words(std::uint64_t a, std::uint64_t b) noexcept {
  __extension__ using Wide = unsigned __int128;
  const Wide product = static_cast<Wide>(a ^ 0x9e3779b97f4a7c15ull) * (b ^ 0xd1b54a32d192ed03ull);
  return static_cast<std::uint64_t>(product) ^ static_cast<std::uint64_t>(product >> 64);
}

/// 64 bits over the fields, in order. Not cryptographic: it finds what differs by mistake.
class StateHash {
 public:
  static constexpr bool kReads = false;
  void word(std::uint64_t bits) noexcept { hash_ = mix_words(hash_ + 1, bits); }
  void operator()(const double& x) noexcept { word(std::bit_cast<std::uint64_t>(x)); }
  void operator()(const bool& x) noexcept { word(x ? 1 : 2); }
  void operator()(const int& x) noexcept { word(static_cast<std::uint32_t>(x)); }
  void operator()(const std::uint64_t& x) noexcept { word(x); }
  bool ok() const noexcept { return true; }
  std::uint64_t value() const noexcept { return hash_; }

 private:
  std::uint64_t hash_ = 0x243f6a8885a308d3ull;
};

template <class V, class E>
void enumerator(V& v, E& e, int last) noexcept {
  int number = static_cast<int>(e);
  v(number);
  if constexpr (V::kReads) {
    if (number < 0 || number > last) v.fail();
    e = static_cast<E>(v.ok() ? number : 0);
  }
}
template <class V, class E>
void enumerator(V& v, const E& e, int /*last*/) noexcept {
  const int number = static_cast<int>(e);
  v(number);
}

/// A count of entries in use; false: out of range.
template <class V, class Count>
bool count(V& v, Count& n, int most) noexcept {
  v(n);
  if constexpr (V::kReads) {
    if (n < 0 || n > most) v.fail();
    if (!v.ok()) n = 0;
  }
  return v.ok();
}

// `T` is the type or the const type: one list for writing and reading.
#define TELENANO_FIELDS_OF(Type)                        \
  template <class V, class T>                           \
  requires std::is_same_v<std::remove_const_t<T>, Type> \
  void fields(V& v, T& s) noexcept

TELENANO_FIELDS_OF(Vec3) {
  v(s.x());
  v(s.y());
  v(s.z());
}

TELENANO_FIELDS_OF(Mat3) {
  for (int i = 0; i < 9; ++i) v(s(i / 3, i % 3));
}

TELENANO_FIELDS_OF(physics::CurvePoint) {
  v(s.contact);
  v(s.parameter);
  v(s.outer_radius);
  v(s.contact_radius);
  v(s.overlap);
  v(s.load);
  v(s.overlap_rate);
  v(s.load_rate);
  v(s.contact_radius_rate);
  v(s.overlap_bend);
  v(s.load_bend);
  v(s.overlap_by_lambda);
  v(s.load_by_lambda);
  v(s.contact_radius_by_lambda);
  v(s.energy);
}

/// Handover and parting are numbers found by a search whose start is the last ones': they are state. On the
/// one table of a level sample they are the same whenever they are found (`of_one_radius`), and each of a
/// slave's two ports finds them for itself: there they are not.
template <class V, class Cache>
void cache_fields(V& v, Cache& s, bool of_one_radius) noexcept {
  v(s.radius_nm);
  v(s.wet);
  v(s.lambda);
  v(s.u);
  v(s.has_last);
  if (s.has_last) fields(v, s.last);
  if (of_one_radius) return;
  v(s.has_handover);
  if (s.has_handover) {
    v(s.handover.reversible);
    fields(v, s.handover.inside);
    v(s.handover.gap);
  }
  v(s.has_parting);
  if (s.has_parting) {
    v(s.parting.reversible);
    fields(v, s.parting.end);
    v(s.parting.gap);
    v(s.parting.energy_offset);
  }
  for (int i = 0; i < 2; ++i) {
    v(s.handover_lambda[i]);
    v(s.handover_ratio[i]);
  }
  v(s.far_radius_nm);
  v(s.far_compliance);
  v(s.far_base_nm);
  v(s.far_base_rate);
  v(s.far_contact);
  v(s.far_parameter);
  v(s.fold_radius_nm);
  fields(v, s.rigid_fold);
}

/// The caller rebuilds what the law derives (TipSampleLaw::derive) after reading.
template <class V, class State>
void law_fields(V& v, State& s, bool of_one_radius) noexcept {
  enumerator(v, s.branch, static_cast<int>(physics::Branch::kContact));
  v(s.overlap_nm);
  v(s.warm);
  v(s.bridge.present);
  v(s.bridge.volume_nm3);
  v(s.bridge.rupture_gap_nm);
  cache_fields(v, s.cache, of_one_radius);
}

TELENANO_FIELDS_OF(physics::FrictionState) {
  fields(v, s.extension_w_nm);
  fields(v, s.normal_w);
  v(s.stiffness_n_m);
}

/// Without its law's part.
TELENANO_FIELDS_OF(physics::LevelState) {
  fields(v, s.apex_w_nm);
  fields(v, s.friction);
}

TELENANO_FIELDS_OF(physics::PotentialBranch) {
  v(s.inside);
  v(s.bridge.present);
  v(s.bridge.volume_nm3);
  v(s.bridge.rupture_gap_nm);
}

TELENANO_FIELDS_OF(physics::CurveHint) {
  v(s.overlap_nm);
  v(s.log_radius);
  v(s.parameter);
  v(s.by_overlap_per_nm);
  v(s.by_overlap_twice_per_nm2);
  v(s.by_log_radius);
}

/// Its springs are made again of the compliance.
TELENANO_FIELDS_OF(physics::PotentialState) {
  v(s.started);
  fields(v, s.branch);
  v(s.under_way);
  v(s.broken_away);
  fields(v, s.free_end_w_nm);
  fields(v, s.apex_w_nm);
  fields(v, s.hint);
  fields(v, s.follow);
  fields(v, s.trend.move_w_nm);
  fields(v, s.trend.forward_w_nm);
  fields(v, s.trend.backward_w_nm);
  enumerator(v, s.trend.order, static_cast<int>(physics::PathOrder::kCubic));
  v(s.convergence_per_nm);
  fields(v, s.bristle);
}

/// What of the last balance the next step, or the output of this one, looks at.
TELENANO_FIELDS_OF(physics::TipSolution) {
  enumerator(v, s.branch, static_cast<int>(physics::Branch::kContact));
  fields(v, s.apex_w_nm);
  fields(v, s.force_w_nn);
  fields(v, s.friction_w_nn);
  fields(v, s.normal_w);
  v(s.normal_force_nn);
  v(s.overlap_nm);
  v(s.radius_nm);
  v(s.contact_radius_nm);
  v(s.stiffness_n_m);
  v(s.potential_aj);
  v(s.friction_stored_aj);
  v(s.sliding);
  v(s.under_way);
}

TELENANO_FIELDS_OF(physics::ModeState) {
  v(s.deflection_nm);
  v(s.velocity_nm_s);
  v(s.force_nn);
}

TELENANO_FIELDS_OF(physics::Equilibrium) {
  enumerator(v, s.status, static_cast<int>(physics::SolveStatus::kNonFinite));
  enumerator(v, s.branch, static_cast<int>(physics::Branch::kContact));
  v(s.overlap_nm);
  v(s.force_nn);
  v(s.stiffness_n_m);
  v(s.contact_radius_nm);
  v(s.potential_aj);
  v(s.dissipated_aj);
  v(s.jumps);
  v(s.bridge);
}

TELENANO_FIELDS_OF(physics::ParticleState) {
  for (auto& contact : s.contacts) {
    law_fields(v, contact.law, false);
    v(contact.contact_radius_nm);
    fields(v, contact.normal_w);
    fields(v, contact.slide_nm);
    fields(v, contact.roll_rad);
    fields(v, contact.spin_rad);
    v(contact.slide_stiffness);
    v(contact.roll_stiffness);
    v(contact.spin_stiffness);
  }
  v(s.started);
  fields(v, s.tip_centre_w_nm);
  fields(v, s.tip_force_w_nn);
  fields(v, s.particle_centre_w_nm);
  fields(v, s.turned_w_rad);
  v(s.orientation_w.x());
  v(s.orientation_w.y());
  v(s.orientation_w.z());
  v(s.orientation_w.w());
  v(s.potential_aj);
  v(s.sleep.asleep);
  if (!s.sleep.asleep) return;
  fields(v, s.sleep.law);
  fields(v, s.sleep.normal_w);
  v(s.sleep.radius_nm);
  fields(v, s.sleep.slide_force_w_nn);
  fields(v, s.sleep.roll_torque_w_nn_nm);
  fields(v, s.sleep.spin_torque_w_nn_nm);
  v(s.sleep.potential_aj);
}

#undef TELENANO_FIELDS_OF

}  // namespace telenano::slave
