#include "telenano/nve_server/physics/particle/particle_asleep.h"

#include <cmath>

namespace telenano::physics {
namespace {

constexpr double kPartOfGap = 0.5;

// The tip's friction in ParticleBalance is that of its area alone.
std::optional<FrictionParameters> friction_of(const ContactFriction& friction) {
  if (!(friction.shear_strength_gpa > 0.0)) return {};
  return FrictionParameters{friction.shear_strength_gpa, friction.shear_modulus_gpa, 0.0, 1.0};
}

}  // namespace

TipBesideSleeper::TipBesideSleeper(const ParticleModel& model, double little_pull_nn)
    : equilibrium_(model.ground[kTipSample]->shared_fields(), model.ground[kTipSample]->shared_potential(),
                   friction_of(model.friction[kTipSample])),
      law_(model.laws[kTipParticle]),
      tip_radius_nm_(model.parameters.tip_radius_nm),
      reach_nm_(model.parameters.tip_radius_nm + model.parameters.particle_radius_nm),
      radius_nm_(model.nominal_radius_nm[kTipParticle]),
      little_pull_nn_(little_pull_nn) {}

void TipBesideSleeper::begin(const ParticleState& from, const ParticleSolution& solution,
                             const Compliance& springs, PotentialState& tip) const noexcept {
  tip = PotentialState{};
  const ParticleContactMemory& memory = from.contacts[kTipSample];
  tip.started = true;
  tip.branch = memory.place;
  tip.hint = memory.hint;
  tip.apex_w_nm = from.tip_centre_w_nm - Vec3(0.0, 0.0, tip_radius_nm_);
  const Vec3 drawn = -solution.contacts[kTipParticle].force_w_nn;
  tip.free_end_w_nm = tip.apex_w_nm - springs * (from.tip_force_w_nn - drawn);
  tip.bristle = {memory.slide_nm, memory.normal_w, memory.slide_stiffness};
}

// How the particle draws the tip where that is foreseen to be. False: it may wake.
bool TipBesideSleeper::draw(const Vec3& from_apex, const Vec3& foreseen, const Vec3& move,
                            const ParticleState& lies, Pull& pull) const noexcept {
  const auto gap_at = [&](const Vec3& apex, Vec3& away) {
    away = apex + Vec3(0.0, 0.0, tip_radius_nm_) - lies.particle_centre_w_nm;
    return away.norm() - reach_nm_;
  };
  Vec3 away;
  const double gap_before = gap_at(from_apex, away);
  const double gap = gap_at(foreseen, away);
  if (!(gap > 0.0) || !(move.squaredNorm() < kPartOfGap * kPartOfGap * gap_before * gap_before)) return false;
  pull.law = law_.advance(-gap, 0.0, radius_nm_, pull.memory);
  const Equilibrium& drawn = pull.law;
  const bool outside = drawn.branch == Branch::kFree || drawn.branch == Branch::kVanDerWaals;
  if (drawn.status != SolveStatus::kOk || !outside || !(std::abs(drawn.force_nn) <= little_pull_nn_)) {
    return false;
  }
  pull.force_w_nn = away * (drawn.force_nn / (gap + reach_nm_));
  return true;
}

bool TipBesideSleeper::advance(const Vec3& free_end, const Compliance& springs, const ParticleState& lies,
                               Pull& pull, PotentialState& tip, TipSolution& solution) const noexcept {
  const Vec3 move = free_end - tip.free_end_w_nm;
  const Vec3 foreseen = tip.apex_w_nm + tip.follow * move;
  if (!draw(tip.apex_w_nm, foreseen, move, lies, pull)) return false;
  solution = equilibrium_.advance(free_end + springs * pull.force_w_nn, springs, tip);
  if (solution.status != SolveStatus::kOk) return false;
  solution.force_w_nn += pull.force_w_nn;
  solution.potential_aj +=
      pull.law.potential_aj - pull.force_w_nn.dot(solution.apex_w_nm - foreseen) + lies.sleep.potential_aj;
  return true;
}

void TipBesideSleeper::describe(const TipSolution& solution, const Pull& pull,
                                ParticleSolution& out) const noexcept {
  out.tip = solution;
  ParticleContactReport& sample = out.contacts[kTipSample];
  sample.branch = solution.branch;
  sample.overlap_nm = solution.overlap_nm;
  sample.radius_nm = solution.radius_nm;
  sample.contact_radius_nm = solution.contact_radius_nm;
  sample.normal_w = solution.normal_w;
  sample.normal_force_nn = solution.normal_force_nn;
  sample.stiffness_n_m = solution.stiffness_n_m;
  sample.force_w_nn = solution.force_w_nn - pull.force_w_nn;
  sample.friction_w_nn = solution.friction_w_nn;
  sample.slides = solution.sliding;
  ParticleContactReport& particle = out.contacts[kTipParticle];
  particle.branch = pull.law.branch;
  particle.overlap_nm = pull.law.overlap_nm;
  particle.radius_nm = radius_nm_;
  particle.contact_radius_nm = 0;
  particle.normal_force_nn = pull.law.force_nn;
  particle.stiffness_n_m = pull.law.stiffness_n_m;
  particle.force_w_nn = -pull.force_w_nn;
  out.held_by_tip = false;
  out.substeps = out.iterations = 0;  // of what moves the particle: none
  out.friction_loss_aj = out.drag_loss_aj = out.jump_loss_aj = out.dissipated_aj = 0;
  out.turned_w_rad.setZero();
}

void TipBesideSleeper::end(const PotentialState& tip, const TipSolution& solution, const Pull& pull,
                           ParticleState& state) const noexcept {
  ParticleContactMemory& memory = state.contacts[kTipSample];
  memory.law.branch = solution.branch;
  memory.law.overlap_nm = solution.overlap_nm;
  memory.place = tip.branch;
  memory.hint = tip.hint;
  memory.normal_w = tip.bristle.stiffness_n_m > 0.0 ? tip.bristle.normal_w : Vec3(Vec3::UnitZ());
  memory.slide_nm = tip.bristle.extension_w_nm;
  memory.slide_stiffness = tip.bristle.stiffness_n_m;
  memory.contact_radius_nm = solution.contact_radius_nm;
  state.contacts[kTipParticle].law = pull.memory;
  state.contacts[kTipParticle].law.branch = pull.law.branch;
  state.contacts[kTipParticle].law.overlap_nm = pull.law.overlap_nm;
  state.tip_centre_w_nm = tip.apex_w_nm + Vec3(0.0, 0.0, tip_radius_nm_);
  state.tip_force_w_nn = solution.force_w_nn;
  state.potential_aj = solution.potential_aj + solution.friction_stored_aj;
}

}  // namespace telenano::physics
