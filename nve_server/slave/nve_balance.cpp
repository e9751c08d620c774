#include <algorithm>
#include <cmath>

#include "telenano/nve_server/slave/mean_force.h"
#include "telenano/nve_server/slave/nve_slave.h"

namespace telenano::slave {
namespace {

using physics::SolveStatus;

constexpr int kForceLimitTrials = 12;
constexpr double kForceLimitSlack = 1e-3;  // the tip is held between (1 − slack) and 1 of the limit

// The contact's stiffness as the mode feels it: through the other springs, along its shape.
double felt_stiffness(const physics::TipSolution& solution, const physics::Compliance& springs,
                      const Vec3& shape) noexcept {
  const double k = std::max(0.0, solution.stiffness_n_m);
  const double along = solution.normal_w.dot(shape);
  return k * along * along / (1.0 + k * solution.normal_w.dot(springs * solution.normal_w));
}

}  // namespace

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
  if (!settle(k_total, b_over_dt, from, to)) return nullptr;
  to.mode_loss = {};
  if (!mode) return springs;
  if (scene_->potential && !scene_->marks && !scene_->particle &&
      piece.mode.integrator == physics::ModeIntegrator::kMeanForce && mode_step.blend == 0.0) {
    const MovingProbe moving{mode_step, *springs, free_end, k_total, b_over_dt, piece.dt_s};
    const MeanForceResult result = hold_mean_force(moving, from, to);
    if (result == MeanForceResult::kHeld) return springs;
    if (result == MeanForceResult::kNoBalance) return nullptr;
  }
  to.mode_loss = mode->finish(mode_step, probe.mode_shape_w().dot(to.solution.force_w_nn), to.mode);
  to.stored_aj += mode->energy_aj(to.mode);
  to.damped_aj += to.mode_loss.damped_aj;
  return springs;
}

/// What a balance leaves in coupling and probe, but for the mode. False: there is no balance.
bool NveSlave::settle(double k_total, double b_over_dt, const Port& from, Port& to) noexcept {
  count_work(to.solution);
  if (to.solution.status != SolveStatus::kOk) return false;
  const Vec3& force = to.solution.force_w_nn;
  to.extension_w_nm = (b_over_dt * from.extension_w_nm - force) / k_total;
  to.stored_aj = to.solution.potential_aj + to.solution.friction_stored_aj +
                 0.5 * scene_->coupling.stiffness_n_m * to.extension_w_nm.squaredNorm() +
                 0.5 * force.dot(scene_->cantilever.rest_compliance_nm_nn() * force);
  to.damped_aj = b_over_dt * (to.extension_w_nm - from.extension_w_nm).squaredNorm();
  return true;
}

/// What the mode's mean force must have given, for none of it to be the method's: what the port brought, less
/// what the rest stores and loses.
double NveSlave::given_to_mode_aj(const Port& from, const Port& to) const noexcept {
  const Vec3 moved = to.commanded_w_nm - from.commanded_w_nm;
  const double work = -0.5 * (from.solution.force_w_nn + to.solution.force_w_nn).dot(moved);
  const double stored_before = from.stored_aj - scene_->cantilever.mode()->energy_aj(from.mode);
  return work - (to.stored_aj - stored_before) - to.solution.dissipated_aj -
         to.solution.friction_dissipated_aj - to.damped_aj;
}

/// From the balance in `to` on to that of a mode which the mean force has moved. kNone: `to` is as without one.
NveSlave::MeanForceResult NveSlave::hold_mean_force(const MovingProbe& probe, const Port& from,
                                                    Port& to) noexcept {
  const physics::ProbeMode& mode = *scene_->cantilever.mode();
  const Vec3& shape = scene_->cantilever.mode_shape_w();
  const auto balance = [&](const Vec3& free_end) {
    to.potential = from.potential;
    to.solution = sample_.advance(free_end, probe.springs, probe.dt_s, to.potential);
    return settle(probe.k_total_n_m, probe.b_over_dt_n_m, from, to);
  };
  physics::ModeStep next = probe.step;
  for (int i = 0; to.solution.jumps == 0 && !to.solution.under_way; ++i) {
    const double force = shape.dot(to.solution.force_w_nn);
    const MeanForce mean(mode, next, probe.step, force, given_to_mode_aj(from, to));
    if (!mean.found()) break;
    const bool last = i == MeanForce::kMostTrials;
    if (last && !mean.close(to.stored_aj)) break;
    if (last || mean.done(to.stored_aj)) {
      to.mode_loss = mean.finish(to.mode);
      to.stored_aj += mode.energy_aj(to.mode);
      to.damped_aj += to.mode_loss.damped_aj;
      return MeanForceResult::kHeld;
    }
    next.shift_nm =
        mean.better_shift_nm(felt_stiffness(to.solution, springs_without_mode(probe.k_total_n_m), shape));
    if (!balance(probe.free_end_w_nm + (next.shift_nm - probe.step.shift_nm) * shape))
      return MeanForceResult::kNoBalance;
  }
  if (next.shift_nm != probe.step.shift_nm && !balance(probe.free_end_w_nm))
    return MeanForceResult::kNoBalance;
  return MeanForceResult::kNone;
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

}  // namespace telenano::slave
