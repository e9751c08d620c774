#include "telenano/nve_server/slave/nve_slave.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/det_math.h"
#include "telenano/common/base/renew.h"
#include "telenano/nve_server/slave/nve_limits.h"

namespace telenano::slave {
namespace {

constexpr double kShortestStep_s = 1e-6;
constexpr double kLongestStep_s = 0.1;
constexpr double kSubstepRadii = 0.25;  // on a curved surface: how far the end moves between two balances
constexpr int kMaxSubsteps = 256;
constexpr double kMarkRadii =
    0.06;  // of the contact: groove within 1 to 2 % of that of infinitely small steps
// What a unit of work is worth: about a microsecond on one core at 2.3 GHz. Measured on the project's scenes,
// 0.5 to 100 nm a step: an iteration of a tip alone 0.7 to 1.3 µs, one with a particle 3 to 5; a mark in the
// fields of one potential 0.8 ms where a* is 20 nm on a grid of 1 nm, in proportion to the nodes that it
// changes.
constexpr std::uint32_t kWorkOfParticleIteration = 4;
constexpr double kWorkOfFieldNode = 1.5;
constexpr double kMarkPiece = 1.1;  // of a*, in which a wide flow is pressed (marked_potential.h)
// Of a particle's way, in which its own steps are an eighth of the smaller radius (particle_equilibrium.cpp):
// some ten iterations each where it is pushed.
constexpr double kParticleStepRadii = 0.125;
constexpr double kWorkOfParticleStep = 40;

link::ContactState contact_state(physics::Branch branch) noexcept {
  switch (branch) {
    case physics::Branch::kVanDerWaals:
      return link::ContactState::kVanDerWaals;
    case physics::Branch::kNonContact:
      return link::ContactState::kNonContact;
    case physics::Branch::kContact:
      return link::ContactState::kContact;
    case physics::Branch::kFree:
      break;
  }
  return link::ContactState::kFree;
}

link::ParticleStatus particle_status(const physics::ParticleSolution& particle) noexcept {
  if (particle.on_surface)
    return particle.held_by_tip ? link::ParticleStatus::kPushed : link::ParticleStatus::kRests;
  return particle.held_by_tip ? link::ParticleStatus::kHeld : link::ParticleStatus::kLost;
}

// By how much `charge` falls short of a range: 0 within it, negative above it.
double short_of(double least, double most, double charge) noexcept {
  return charge < least ? least - charge : std::min(0.0, most - charge);
}

}  // namespace

NveSlave::NveSlave(std::shared_ptr<const scene::Scene> scene) : NveSlave(scene, PortGround(*scene)) {}

NveSlave::NveSlave(std::shared_ptr<const scene::Scene> scene, const PortGround& ground)
    : scene_(std::move(scene)),
      limits_(limits_of(*scene_)),
      flat_(scene_->surface->is_flat()),
      scalar_(flat_ && !scene_->friction && !scene_->particle),
      sample_(scene_),
      model_(scene_, ground) {
  limits_.well_aj = ground.well_aj();
  port().commanded_w_nm = limits_.start_pos_w_nm;
  if (solve(port().commanded_w_nm, piece_of(kSettle_s), port(), trial_port()) != nullptr) accept_trial();
  port().mode.velocity_nm_s = 0;
  SlaveOutput unused;
  publish(0, unused);
  at_first_.resize(kSnapshotBytes);
  at_first_.resize(save(at_first_));
}

void NveSlave::count_work(const physics::TipSolution& solution) noexcept {
  const std::uint32_t each = sample_.balances_particle() ? kWorkOfParticleIteration : 1;
  work_ += 1 + each * static_cast<std::uint32_t>(std::max(solution.iterations, 0));
}

void NveSlave::accept_trial() noexcept {
  now_ = 1 - now_;
  const physics::TipSolution& accepted = port().solution;
  const std::uint64_t marks = sample_.marks();
  sample_.accept(accepted);
  if (sample_.marks() == marks) return;
  const physics::TipFlow& yielded = accepted.yielded;
  const double across = 2.0 * yielded.flow.contact_radius_nm / scene_->ground.spacing_nm;
  const double pieces =
      1.0 + det_log(std::max(1.0, yielded.flow.radius_nm / yielded.from_radius_nm)) / det_log(kMarkPiece);
  const double work = kWorkOfFieldNode * std::floor(pieces) * across * across;
  if (work > 0.0) work_ += static_cast<std::uint32_t>(std::min(work, 1e6));
}

NveSlave::Piece NveSlave::piece_of(double dt_s) const noexcept {
  Piece piece;
  piece.dt_s = dt_s;
  if (const auto& mode = scene_->cantilever.mode()) piece.mode = mode->over(dt_s);
  return piece;
}

int NveSlave::pieces(double dt_s, double distance_nm) const noexcept {
  int count = 1;
  if (!flat_) {
    double longest = kSubstepRadii * scene_->probe.tip_radius_nm;
    if (scene_->marks && port().solution.contact_radius_nm > 0.0) {
      longest = std::min(longest, kMarkRadii * port().solution.contact_radius_nm);
    }
    const double pieces = std::ceil(distance_nm / longest);
    count = std::clamp(static_cast<int>(std::min(pieces, 1.0 * kMaxSubsteps)), 1, kMaxSubsteps);
  }
  if (const auto& mode = scene_->cantilever.mode()) count = std::max(count, mode->pieces(dt_s));
  return count;
}

void NveSlave::account_for(const Port& before, const Piece& piece, Port& after) noexcept {
  const auto& mode = scene_->cantilever.mode();
  const bool moving = mode && piece.mode.integrator != physics::ModeIntegrator::kBackwardEuler;
  const double dissipated =
      after.solution.dissipated_aj + after.solution.friction_dissipated_aj + after.damped_aj;
  double charge = after.stored_aj - before.stored_aj + dissipated;
  trace_.dissipated_aj += dissipated;
  trace_.mode_damped_aj += after.mode_loss.damped_aj;
  const Vec3 moved = after.commanded_w_nm - before.commanded_w_nm;
  const double first = -before.solution.force_w_nn.dot(moved);
  const double last = -after.solution.force_w_nn.dot(moved);
  if (moving) {
    double lost =
        flat_ ? short_of(std::min(first, last), std::max(first, last), charge) : after.mode_loss.numerical_aj;
    if (lost < 0.0) {
      const double taken = mode->slow_down(-lost, after.mode);
      after.stored_aj -= taken;
      charge -= taken;
      trace_.mode_slowed_aj += taken;
      trace_.mode_unpaid_aj -= lost + taken;
      lost = 0.0;
    }
    charge += lost;
    trace_.dissipated_aj += lost;
    trace_.mode_numerical_aj += lost;
  }
  const double work = 0.5 * (first + last);
  double least = charge;
  if (after.solution.under_way) ++trace_.under_way_steps;
  if (!flat_) {
    least = std::max(least, work - paid_ahead_aj_);
    paid_ahead_aj_ += std::max(charge, least) - work;
  }
  if (charge < least) {
    trace_.dissipated_aj += least - charge;
    trace_.uncounted_aj += least - charge;
    charge = least;
  }
  if (charge > 0.0) {
    energy_in_aj_ += charge;
  } else {
    energy_out_aj_ -= charge;
  }
}

void NveSlave::step(const SlaveInput& input, double dt_s, SlaveOutput& output) noexcept {
  work_ = 0;
  if (!is_finite(input.tip_target_pos_w_nm) || !std::isfinite(dt_s)) {
    publish(link::kFaultNonFinite, output);
    output.force_w_nn.setZero();
    return;
  }
  dt_s = std::clamp(dt_s, kShortestStep_s, kLongestStep_s);
  sample_.set_maker(input.opening);
  std::uint32_t faults = 0;
  Vec3 goal = port().commanded_w_nm;
  double speed = scene_->limits.speed_max_nm_s;
  if (input.retract) {
    goal.z() = limits_.workspace_max_w_nm.z();
    speed = scene_->limits.retract_speed_nm_s;
    faults |= link::kFaultRetracted;
  } else if (input.follow) {
    goal =
        input.tip_target_pos_w_nm.cwiseMax(limits_.workspace_min_w_nm).cwiseMin(limits_.workspace_max_w_nm);
    if (goal != input.tip_target_pos_w_nm) faults |= link::kFaultWorkspace;
  }
  Vec3 move = goal - port().commanded_w_nm;
  double distance = move.norm();
  if (distance > speed * dt_s) {
    move *= speed * dt_s / distance;
    distance = speed * dt_s;
    if (!input.retract) faults |= link::kFaultStepLimit;
  }
  if (scene_->particle) {
    const double smaller_nm =
        std::min(scene_->probe.tip_radius_nm, scene_->particle->parameters.particle_radius_nm);
    const double paid_nm =
        kParticleStepRadii * smaller_nm * std::max(1.0, input.work_most / kWorkOfParticleStep);
    if (distance > paid_nm) {
      move *= paid_nm / distance;
      distance = paid_nm;
      faults |= link::kFaultShare;
    }
  }

  const int count = pieces(dt_s, distance);
  const Piece piece = piece_of(dt_s / count);
  const Vec3 target = port().commanded_w_nm + move;
  for (int left = count; left > 0; --left) {
    const Vec3 next =
        left == 1 ? target : Vec3(port().commanded_w_nm + (target - port().commanded_w_nm) / left);
    Port& after = trial_port();
    bool held_back = false;
    if (!solve_within_force_limit(next, piece, port(), after, held_back)) {
      faults |= link::kFaultNoEquilibrium;
      break;
    }
    if (held_back) faults |= link::kFaultForceLimit;
    account_for(port(), piece, after);
    accept_trial();
    // A slide takes its time; what is left of the way is gone when the tip has come down.
    if (left > 1 && port().solution.under_way) {
      faults |= link::kFaultStepLimit;
      break;
    }
    if (left > 1 && work_ >= input.work_most) {
      faults |= link::kFaultShare;
      break;
    }
  }
  publish(faults, output);
  if (input.wants_model) {
    output.model = model_.of(port().solution, port().commanded_w_nm);
  } else {
    renew(output.model);
  }
}

void NveSlave::publish(std::uint32_t fault_bits, SlaveOutput& output) noexcept {
  const physics::Probe& probe = scene_->cantilever;
  last_faults_ = fault_bits;
  output.force_w_nn = port().solution.force_w_nn;
  output.tip_pos_w_nm = port().solution.apex_w_nm;
  output.commanded_pos_w_nm = port().commanded_w_nm;
  output.deflection_nm = port().solution.force_w_nn.z() * probe.rest_compliance_nm_nn()(2, 2) +
                         probe.mode_shape_w().z() * port().mode.deflection_nm;
  output.contact_state = contact_state(port().solution.branch);
  output.fault_bits = fault_bits;
  output.energy_in_aj = energy_in_aj_;
  output.energy_out_aj = energy_out_aj_;
  output.measurement_age_ns = 0;
  output.work = work_;
  if (const physics::ParticleSolution* const particle = sample_.particle())
    output.particle = {particle->particle_centre_w_nm, scene_->particle->parameters.particle_radius_nm,
                       particle_status(*particle)};
}

NveSlave::Trace NveSlave::trace() const noexcept {
  Trace trace = trace_;
  trace.commanded_end_w_nm = port().commanded_w_nm;
  trace.coupling_extension_w_nm = port().extension_w_nm;
  trace.tip = port().solution;
  trace.mode = port().mode;
  trace.stored_aj = port().stored_aj;
  return trace;
}

std::function<std::unique_ptr<NveSlave>()> nve_slaves(std::shared_ptr<const scene::Scene> scene) {
  const PortGround ground(*scene);
  return [scene = std::move(scene), ground] { return std::make_unique<NveSlave>(scene, ground); };
}

}  // namespace telenano::slave
