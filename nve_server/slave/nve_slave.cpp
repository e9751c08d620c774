#include "nve_server/slave/nve_slave.h"

#include <algorithm>
#include <cmath>

#include "common/base/error.h"

namespace telenano::slave {
namespace {

using physics::SolveStatus;

constexpr double kShortestStep_s = 1e-6;
constexpr double kLongestStep_s = 0.1;
constexpr double kSubstepRadii = 0.25;  // on a curved surface: how far the end moves between two balances
constexpr int kMaxSubsteps = 256;
constexpr double kMarkRadii =
    0.06;  // of the contact: groove within 1 to 2 % of that of infinitely small steps
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

SlaveLimits limits_of(const scene::Scene& scene) {
  SlaveLimits limits;
  limits.workspace_min_w_nm = scene.limits.workspace_min_w_nm;
  limits.workspace_max_w_nm = scene.limits.workspace_max_w_nm;
  limits.start_pos_w_nm = scene.start_apex_w_nm;
  limits.surface_z_w_nm = scene.start_touch_w_nm;
  limits.force_max_nn = scene.limits.force_max_nn;
  // A wall is felt along its normal. On a flat sample that is W z, coupling and cantilever in series; a steep
  // flank of a scan may face sideways, where the cantilever does not yield.
  limits.coupling_stiffness_n_m = scene.surface->is_flat() ? 1.0 / scene.port_compliance_nm_nn()(2, 2)
                                                           : 1.0 / scene.port_compliance_nm_nn()(0, 0);
  limits.coupling_damping_n_s_m = scene.coupling.damping_n_s_m;
  limits.rate_max_hz = scene.limits.rate_max_hz;
  return limits;
}

}  // namespace

NveSlave::NveSlave(std::shared_ptr<const scene::Scene> scene)
    : scene_(std::move(scene)), limits_(limits_of(*scene_)), flat_(scene_->surface->is_flat()) {
  if (scene_->marks) {
    const auto* heights = dynamic_cast<const physics::SplineSurface*>(scene_->surface.get());
    if (heights == nullptr) throw UserError(scene_->path + ": marks need a surface of heights");
    physics::EquilibriumOptions options = scene_->equilibrium->options();
    options.hardness_gpa = scene_->marks->hardness_gpa;
    marked_ = std::make_unique<physics::MarkedSample>(*heights, scene_->equilibrium->law(),
                                                      scene_->probe.tip_radius_nm, options);
  }
  port_.commanded_w_nm = limits_.start_pos_w_nm;
  Port settled;
  if (solve(port_.commanded_w_nm, 1.0, port_, settled)) {
    port_ = settled;
    if (marked_) marked_->press(port_.solution.yielded);
  }
  SlaveOutput unused;
  publish(0, unused);
}

bool NveSlave::solve(const Vec3& commanded, double dt_s, const Port& from, Port& to) const noexcept {
  const double k_c = scene_->coupling.stiffness_n_m;
  const double b_over_dt = scene_->coupling.damping_n_s_m / dt_s;
  const double k_total = k_c + b_over_dt;
  to = from;
  to.commanded_w_nm = commanded;
  const Vec3 free_end = commanded - from.extension_w_nm * (b_over_dt / k_total);
  const physics::Compliance compliance = Mat3::Identity() / k_total + scene_->probe_compliance_nm_nn();
  const physics::TipEquilibrium& equilibrium = marked_ ? marked_->equilibrium() : *scene_->equilibrium;
  to.solution = equilibrium.advance(free_end, compliance, to.tip);
  if (to.solution.status != SolveStatus::kOk) return false;
  to.extension_w_nm = (b_over_dt * from.extension_w_nm - to.solution.force_w_nn) / k_total;
  const double force_z = to.solution.force_w_nn.z();
  to.stored_aj = to.solution.potential_aj + to.solution.friction_stored_aj +
                 0.5 * k_c * to.extension_w_nm.squaredNorm() +
                 0.5 * force_z * force_z * scene_->probe_compliance_nm_nn()(2, 2);
  return true;
}

bool NveSlave::solve_within_force_limit(const Vec3& commanded, double dt_s, const Port& from, Port& to,
                                        bool& held_back) const noexcept {
  const double limit = scene_->limits.force_max_nn;
  if (!solve(commanded, dt_s, from, to)) return false;
  // The end goes back along the normal to where the force is the limit, and is free to follow the target
  // sideways. Springs and contact in series say how far; the law is close to a line there, so a few trials
  // do.
  Vec3 end = commanded;
  for (int trial = 0; to.solution.normal_force_nn > limit; ++trial) {
    held_back = true;
    if (trial == kForceLimitTrials) return false;
    const double k_total = scene_->coupling.stiffness_n_m + scene_->coupling.damping_n_s_m / dt_s;
    const Vec3 n = to.solution.normal_w;
    const double springs = 1.0 / k_total + n.z() * n.z() * scene_->probe_compliance_nm_nn()(2, 2);
    const double contact = to.solution.stiffness_n_m > 0.0 ? 1.0 / to.solution.stiffness_n_m : 0.0;
    const double excess = to.solution.normal_force_nn - (1.0 - 0.5 * kForceLimitSlack) * limit;
    end += n * (excess * (springs + contact));
    if (!solve(end, dt_s, from, to)) return false;
  }
  return true;
}

void NveSlave::book(const Port& before, const Port& after, double dt_s) noexcept {
  const double damper =
      scene_->coupling.damping_n_s_m * (after.extension_w_nm - before.extension_w_nm).squaredNorm() / dt_s;
  const double dissipated = after.solution.dissipated_aj + after.solution.friction_dissipated_aj + damper;
  double charge = after.stored_aj - before.stored_aj + dissipated;
  trace_.dissipated_aj += dissipated;
  if (after.solution.slid) {
    const Vec3 moved = after.commanded_w_nm - before.commanded_w_nm;
    const double trapezium = -0.5 * (before.solution.force_w_nn + after.solution.force_w_nn).dot(moved);
    if (trapezium > charge) {
      trace_.dissipated_aj += trapezium - charge;
      charge = trapezium;
    }
    ++trace_.slides;
  }
  if (charge > 0.0) {
    energy_in_aj_ += charge;
  } else {
    energy_out_aj_ -= charge;
  }
}

void NveSlave::step(const SlaveInput& input, double dt_s, SlaveOutput& output) noexcept {
  if (!is_finite(input.tip_target_pos_w_nm) || !std::isfinite(dt_s)) {
    publish(link::kFaultNonFinite, output);
    output.force_w_nn.setZero();
    return;
  }
  dt_s = std::clamp(dt_s, kShortestStep_s, kLongestStep_s);
  std::uint32_t faults = 0;
  Vec3 goal = port_.commanded_w_nm;
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
  Vec3 move = goal - port_.commanded_w_nm;
  double distance = move.norm();
  if (distance > speed * dt_s) {
    move *= speed * dt_s / distance;
    distance = speed * dt_s;
    if (!input.retract) faults |= link::kFaultStepLimit;
  }

  int substeps = 1;
  if (!flat_) {
    double longest = kSubstepRadii * scene_->probe.tip_radius_nm;
    if (marked_ && port_.solution.contact_radius_nm > 0.0) {
      longest = std::min(longest, kMarkRadii * port_.solution.contact_radius_nm);
    }
    const double pieces = std::ceil(distance / longest);
    substeps = std::clamp(static_cast<int>(std::min(pieces, 1.0 * kMaxSubsteps)), 1, kMaxSubsteps);
  }
  const double sub_dt_s = dt_s / substeps;
  const Vec3 target = port_.commanded_w_nm + move;
  for (int left = substeps; left > 0; --left) {
    const Vec3 next =
        left == 1 ? target : Vec3(port_.commanded_w_nm + (target - port_.commanded_w_nm) / left);
    Port after;
    bool held_back = false;
    if (!solve_within_force_limit(next, sub_dt_s, port_, after, held_back)) {
      faults |= link::kFaultNoEquilibrium;
      break;
    }
    if (held_back) faults |= link::kFaultForceLimit;
    book(port_, after, sub_dt_s);
    port_ = after;
    if (marked_) marked_->press(port_.solution.yielded);
  }
  if (port_.solution.outside) ++trace_.outside_steps;
  if (port_.solution.radius_clamped) ++trace_.clamped_radius_steps;
  publish(faults, output);
}

void NveSlave::publish(std::uint32_t fault_bits, SlaveOutput& output) noexcept {
  output.force_w_nn = port_.solution.force_w_nn;
  output.tip_pos_w_nm = port_.solution.apex_w_nm;
  output.deflection_nm = port_.solution.force_w_nn.z() * scene_->probe_compliance_nm_nn()(2, 2);
  output.contact_state = contact_state(port_.solution.branch);
  output.fault_bits = fault_bits;
  output.energy_in_aj = energy_in_aj_;
  output.energy_out_aj = energy_out_aj_;
  output.measurement_age_ns = 0;
  trace_.commanded_end_w_nm = port_.commanded_w_nm;
  trace_.coupling_extension_w_nm = port_.extension_w_nm;
  trace_.tip = port_.solution;
  trace_.stored_aj = port_.stored_aj;
}

}  // namespace telenano::slave
