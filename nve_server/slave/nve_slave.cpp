#include "telenano/nve_server/slave/nve_slave.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"
#include "telenano/common/base/renew.h"
#include "telenano/nve_server/slave/state_fields.h"

namespace telenano::slave {
namespace {

using physics::SolveStatus;

constexpr double kSettle_s = 1.0;  // the first balance: longer than any damper or mode remembers
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
constexpr int kForceLimitTrials = 12;
constexpr double kForceLimitSlack = 1e-3;  // the tip is held between (1 − slack) and 1 of the limit

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

// The hardest wall that the port can show. On a flat sample without friction the force is along W z whatever
// the springs do sideways; a curved sample, a particle's side and a contact that sticks face anywhere, and
// the stiffest direction of the springs counts: 1/λ_min of their compliance. A mode below the sample rate has
// not yielded yet when the next sample asks.
double shown_stiffness(const scene::Scene& scene) {
  const physics::Probe& probe = scene.cantilever;
  const bool sluggish = probe.mode() && probe.mode()->frequency_hz() < scene.limits.rate_max_hz;
  const physics::Compliance springs = Mat3::Identity() / scene.coupling.stiffness_n_m +
                                      (sluggish ? probe.rest_compliance_nm_nn() : probe.compliance_nm_nn());
  const bool upwards_only = scene.surface->is_flat() && !scene.friction && !scene.particle;
  if (upwards_only) return 1.0 / springs(2, 2);
  return 1.0 / Eigen::SelfAdjointEigenSolver<Mat3>(springs, Eigen::EigenvaluesOnly).eigenvalues().minCoeff();
}

SlaveLimits limits_of(const scene::Scene& scene) {
  SlaveLimits limits;
  limits.workspace_min_w_nm = scene.limits.workspace_min_w_nm;
  limits.workspace_max_w_nm = scene.limits.workspace_max_w_nm;
  limits.start_pos_w_nm = scene.start_apex_w_nm;
  limits.surface_z_w_nm = scene.start_touch_w_nm;
  limits.force_max_nn = scene.limits.force_max_nn;
  limits.coupling_stiffness_n_m = shown_stiffness(scene);
  limits.coupling_damping_n_s_m = scene.coupling.damping_n_s_m;
  limits.rate_max_hz = scene.limits.rate_max_hz;
  limits.has_particle = scene.particle.has_value();
  limits.keeps_marks = scene.marks.has_value() && !scene.particle;
  // A mode that is resolved takes ω0 dt balances a step (probe_mode.h), whatever the rate.
  if (const auto& mode = scene.cantilever.mode()) limits.balances_per_s = 2.0 * kPi * mode->frequency_hz();
  return limits;
}

// The contact's stiffness as the mode feels it: through the other springs, along its shape.
double felt_stiffness(const physics::TipSolution& solution, const physics::Compliance& springs,
                      const Vec3& shape) noexcept {
  const double k = std::max(0.0, solution.stiffness_n_m);
  const double along = solution.normal_w.dot(shape);
  return k * along * along / (1.0 + k * solution.normal_w.dot(springs * solution.normal_w));
}

/// A mode's step on one potential by a discrete gradient (Gonzalez, J. Nonlinear Sci. 6:449, 1996): the force
/// Φ̄ that is held over the step is the one that gives the mode just what all else has set free,
///
///   Φ̄ (q₁ − q₀) = −ΔV,   V the energy of tip, ground and the other springs, less the port's work,
///
/// and not the mean of its ends, whose work differs from −ΔV by the bend of the force. The motion under a
/// held force is exact (probe_mode.h), so that nothing of the mode's energy is the method's. q₁ is found by
/// Newton's method on f = q₁ − q_free − g Φ̄(q₁), f' = 1 − g (Φ₁ − Φ̄)/(q₁ − q₀), since Φ₁ = −dV/dq₁: the
/// balance is told by how much the mode lies elsewhere (the shift), 1 + cK times what q₁ shall move.
class MeanForce {
 public:
  /// `now`: the step as the balance has just seen it, `first` as ProbeMode::begin made it with θ = ½, whose
  /// compliance is g/2.
  MeanForce(const physics::ProbeMode& mode, const physics::ModeStep& now, const physics::ModeStep& first,
            double force_nn, double given_aj) noexcept
      : mode_(mode), now_(now), force_nn_(force_nn), given_aj_(given_aj) {
    free_nm_ = first.shift_nm - first.compliance_nm_nn * first.from.force_nn;
    held_nm_nn_ = 2.0 * first.compliance_nm_nn;
    deflection_nm_ = now.shift_nm + now.compliance_nm_nn * force_nn;
    moved_nm_ = deflection_nm_ - now.from.deflection_nm;
  }

  /// False: the mode stands all but still, or what is given is not the mode's (a port that moves fast): the
  /// mean of a smooth force lies between its ends, or little beyond.
  bool found() const noexcept {
    constexpr double kStill_nm = 1e-7;
    if (!(std::abs(moved_nm_) > kStill_nm)) return false;
    const double trapezium = 0.5 * (now_.from.force_nn + force_nn_);
    return std::abs(mean_nn() - trapezium) <= std::abs(force_nn_ - now_.from.force_nn);
  }
  bool done(double stored_aj) const noexcept { return lost_below(2e-16, stored_aj); }  // rounding
  /// What Newton's method has come to, if not to its end; a soft lever above a snap may not be there by far.
  bool close(double stored_aj) const noexcept { return lost_below(1e-12, stored_aj); }
  double better_shift_nm(double stiffness_n_m) const noexcept {
    const double f = deflection_nm_ - free_nm_ - held_nm_nn_ * mean_nn();
    const double slope = 1.0 - held_nm_nn_ * (force_nn_ - mean_nn()) / moved_nm_;
    return now_.shift_nm - f / slope * (1.0 + now_.compliance_nm_nn * stiffness_n_m);
  }
  physics::ModeLoss finish(physics::ModeState& to) const noexcept {
    const physics::ModeState& from = now_.from;
    const double held = held_nn();
    to.force_nn = force_nn_;
    to.deflection_nm = deflection_nm_;
    to.velocity_nm_s =
        now_.over.keep_v * from.velocity_nm_s +
        now_.over.reach_s * (held - mode_.stiffness_n_m() * from.deflection_nm) / mode_.mass_kg();
    physics::ModeLoss loss;
    loss.damped_aj = std::max(0.0, held * moved_nm_ - (mode_.energy_aj(to) - mode_.energy_aj(from)));
    loss.numerical_aj = lost_aj();
    return loss;
  }

 private:
  double mean_nn() const noexcept { return given_aj_ / moved_nm_; }
  /// That leads to where the mode is.
  double held_nn() const noexcept { return (deflection_nm_ - free_nm_) / held_nm_nn_; }
  double lost_aj() const noexcept { return given_aj_ - held_nn() * moved_nm_; }
  bool lost_below(double part, double stored_aj) const noexcept {
    return std::abs(lost_aj()) <= part * (std::abs(stored_aj) + mode_.energy_aj(now_.from));
  }

  const physics::ProbeMode& mode_;
  const physics::ModeStep& now_;
  double force_nn_;
  double given_aj_;
  double free_nm_ = 0;
  double held_nm_nn_ = 0;
  double deflection_nm_ = 0;
  double moved_nm_ = 0;
};
constexpr int kMostMeanForces = 5;

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

const physics::Compliance& NveSlave::springs_without_mode(double k_total) noexcept {
  if (k_total != springs_k_total_n_m_) {
    springs_k_total_n_m_ = k_total;
    springs_ = Mat3::Identity() / k_total + scene_->cantilever.rest_compliance_nm_nn();
  }
  return springs_;
}

const physics::Compliance* NveSlave::solve(const Vec3& commanded, const Piece& piece, const Port& from,
                                           Port& to) noexcept {
  const physics::Probe& probe = scene_->cantilever;
  const auto& mode = probe.mode();
  const double k_c = scene_->coupling.stiffness_n_m;
  const double b_over_dt = scene_->coupling.damping_n_s_m / piece.dt_s;
  const double k_total = k_c + b_over_dt;
  to.mode = from.mode;
  to.commanded_w_nm = commanded;
  Vec3 free_end = commanded - from.extension_w_nm * (b_over_dt / k_total);
  const physics::Compliance* springs = &springs_without_mode(k_total);
  physics::ModeStep mode_step;
  if (mode) {
    const Vec3& shape = probe.mode_shape_w();
    mode_step = mode->begin(piece.mode, from.mode, felt_stiffness(from.solution, *springs, shape));
    free_end += mode_step.shift_nm * shape;
    mode_springs_ = *springs;
    mode_springs_ += mode_step.compliance_nm_nn * shape * shape.transpose();
    springs = &mode_springs_;
  }
  if (scalar_) {
    // Whole states are never copied here, which would take longer than the balance.
    to.level.law.go_on_from(from.level.law);
    scene_->level->advance_without_friction(free_end, *springs, to.level.law, to.solution);
  } else if (scene_->potential) {
    to.potential = from.potential;
    to.solution = sample_.advance(free_end, *springs, piece.dt_s, to.potential);
  } else {
    to.level.law.go_on_from(from.level.law);
    to.level.apex_w_nm = from.level.apex_w_nm;
    to.level.friction = from.level.friction;
    to.solution = scene_->level->advance(free_end, *springs, to.level);
  }
  const auto settle = [&] {
    count_work(to.solution);
    if (to.solution.status != SolveStatus::kOk) return false;
    const Vec3& force = to.solution.force_w_nn;
    to.extension_w_nm = (b_over_dt * from.extension_w_nm - force) / k_total;
    to.stored_aj = to.solution.potential_aj + to.solution.friction_stored_aj +
                   0.5 * k_c * to.extension_w_nm.squaredNorm() +
                   0.5 * force.dot(probe.rest_compliance_nm_nn() * force);
    to.damped_aj = b_over_dt * (to.extension_w_nm - from.extension_w_nm).squaredNorm();
    return true;
  };
  if (!settle()) return nullptr;
  to.mode_loss = {};
  if (!mode) return springs;
  const Vec3& shape = probe.mode_shape_w();
  if (scene_->potential && !scene_->marks && !scene_->particle &&
      piece.mode.integrator == physics::ModeIntegrator::kMeanForce && mode_step.blend == 0.0) {
    // What the mode's mean force must have given, for none of it to be the method's: what the port brought,
    // less what the rest stores and loses.
    const auto given = [&] {
      const Vec3 moved = to.commanded_w_nm - from.commanded_w_nm;
      const double work = -0.5 * (from.solution.force_w_nn + to.solution.force_w_nn).dot(moved);
      const double stored_before = from.stored_aj - mode->energy_aj(from.mode);
      return work - (to.stored_aj - stored_before) - to.solution.dissipated_aj -
             to.solution.friction_dissipated_aj - to.damped_aj;
    };
    const auto smooth = [&] { return to.solution.jumps == 0 && !to.solution.under_way; };
    physics::ModeStep next = mode_step;
    for (int i = 0; smooth(); ++i) {
      const double force = shape.dot(to.solution.force_w_nn);
      MeanForce mean(*mode, next, mode_step, force, given());
      if (!mean.found()) break;
      const bool last = i == kMostMeanForces;
      if (last && !mean.close(to.stored_aj)) break;
      if (last || mean.done(to.stored_aj)) {
        to.mode_loss = mean.finish(to.mode);
        to.stored_aj += mode->energy_aj(to.mode);
        to.damped_aj += to.mode_loss.damped_aj;
        return springs;
      }
      next.shift_nm = mean.better_shift_nm(felt_stiffness(to.solution, springs_without_mode(k_total), shape));
      to.potential = from.potential;
      to.solution = sample_.advance(free_end + (next.shift_nm - mode_step.shift_nm) * shape, *springs,
                                    piece.dt_s, to.potential);
      if (!settle()) return nullptr;
    }
    if (next.shift_nm != mode_step.shift_nm) {  // no mean force there: as without
      to.potential = from.potential;
      to.solution = sample_.advance(free_end, *springs, piece.dt_s, to.potential);
      if (!settle()) return nullptr;
    }
  }
  to.mode_loss = mode->finish(mode_step, shape.dot(to.solution.force_w_nn), to.mode);
  to.stored_aj += mode->energy_aj(to.mode);
  to.damped_aj += to.mode_loss.damped_aj;
  return springs;
}

bool NveSlave::solve_within_force_limit(const Vec3& commanded, const Piece& piece, const Port& from, Port& to,
                                        bool& held_back) noexcept {
  const double limit = scene_->limits.force_max_nn;
  const physics::Compliance* springs = solve(commanded, piece, from, to);
  if (springs == nullptr) return false;
  // The end goes back along the normal to where the force is the limit, and is free to follow the target
  // sideways. Springs and contact in series say how far; the law is close to a line there, so a few trials
  // do. With a lateral part the whole force is the larger.
  Vec3 end = commanded;
  for (int trial = 0;; ++trial) {
    const double force = std::max(to.solution.normal_force_nn, to.solution.force_w_nn.norm());
    if (!(force > limit)) return true;
    held_back = true;
    if (trial == kForceLimitTrials) return false;
    const Vec3 n = to.solution.normal_w;
    const double contact = to.solution.stiffness_n_m > 0.0 ? 1.0 / to.solution.stiffness_n_m : 0.0;
    const double excess = force - (1.0 - 0.5 * kForceLimitSlack) * limit;
    end += n * (excess * (n.dot(*springs * n) + contact));
    springs = solve(end, piece, from, to);
    if (springs == nullptr) return false;
  }
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

namespace {
/// Lifted off: nothing holds tip and ground together, and nothing is under way.
bool is_off(const physics::TipSolution& solution, const physics::PotentialState& state) noexcept {
  const bool apart =
      solution.branch == physics::Branch::kFree || solution.branch == physics::Branch::kVanDerWaals;
  return apart && !state.branch.bridge.present && !solution.under_way && !(solution.contact_radius_nm > 0.0);
}
}  // namespace

/// The tip is balanced anew where its commanded end is, as if it had come from far away; where it would then touch,
/// all is as it was. What is stored there may be another energy than before: more is charged though the port did not
/// bring it, less is lost, so that the sum of the charges is at least what is stored, as ever.
UndoResult NveSlave::undo_marks(std::uint64_t of, SlaveOutput& output) noexcept {
  if (!limits_.keeps_marks) return UndoResult::kNothing;
  const std::uint64_t maker = sample_.stroke_maker();
  if (of != 0 && maker != 0 && maker != of) return UndoResult::kAnothers;
  if (!is_off(port().solution, port().potential)) return UndoResult::kTouches;
  if (!sample_.exchange_stroke()) return UndoResult::kNothing;
  Port from = port();
  from.potential = {};
  from.solution = {};
  Port& after = trial_port();
  work_ = 0;
  const bool balanced = solve(from.commanded_w_nm, piece_of(kSettle_s), from, after) != nullptr;
  if (!balanced || !is_off(after.solution, after.potential)) {
    sample_.exchange_stroke();
    after = port();
    return UndoResult::kTouches;
  }
  sample_.keep_undone();
  after.mode.velocity_nm_s = 0;
  const double charge = after.stored_aj - port().stored_aj;
  if (charge > 0.0) {
    energy_in_aj_ += charge;
    paid_ahead_aj_ += charge;
    trace_.mode_unpaid_aj += charge;
  } else {
    trace_.dissipated_aj -= charge;
  }
  accept_trial();
  publish(last_faults_, output);
  return UndoResult::kDone;
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

template <class Visit, class Of>
void NveSlave::visit_port(Visit& visit, Of& port) const noexcept {
  fields(visit, port.commanded_w_nm);
  fields(visit, port.extension_w_nm);
  if (scene_->potential) {
    fields(visit, port.potential);
  } else {
    // A level sample's two ports find the one table's handover each for itself, with the same result.
    const bool one_table = scalar_ && port.level.law.cache.tabulated;
    bool of_one_radius = one_table;
    visit(of_one_radius);
    law_fields(visit, port.level.law, of_one_radius);
    if (!scalar_) fields(visit, port.level);
  }
  fields(visit, port.solution);
  fields(visit, port.mode);
  visit(port.stored_aj);
}

template <class Visit>
void NveSlave::write_state(Visit& visit) const noexcept {
  sample_.write(visit);
  visit_port(visit, port());
  visit(energy_in_aj_);
  visit(energy_out_aj_);
  visit(paid_ahead_aj_);
  visit(std::uint64_t{last_faults_});
}

std::uint64_t NveSlave::state_hash() const noexcept {
  StateHash hash;
  write_state(hash);
  return hash.value();
}

std::size_t NveSlave::save(std::span<std::uint8_t> out) const noexcept {
  StateWriter writer(out);
  write_state(writer);
  return writer.ok() ? writer.size() : 0;
}

std::size_t NveSlave::snapshot_bytes_max() const noexcept {
  return kSnapshotBytes + sample_.mark_bytes_max();
}

void NveSlave::reset() noexcept {
  if (at_first_.empty() || !load(at_first_)) sample_.reset();
}

bool NveSlave::load(std::span<const std::uint8_t> bytes) noexcept {
  StateReader reader(bytes);
  bool good = sample_.read(reader);
  Port& to = ports_[now_];
  to = {};
  visit_port(reader, to);
  reader(energy_in_aj_);
  reader(energy_out_aj_);
  reader(paid_ahead_aj_);
  std::uint64_t faults = 0;
  reader(faults);
  last_faults_ = static_cast<std::uint32_t>(faults);
  good = good && faults <= UINT32_MAX && reader.ok() && reader.at_end() && energy_in_aj_ >= 0 &&
         energy_out_aj_ >= 0;
  if (good) {
    scene_->law().derive(to.level.law.cache);
    ports_[1 - now_] = to;
    return true;
  }
  if (bytes.data() != at_first_.data()) reset();
  return false;
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
