#include "telenano/nve_server/afm/afm_slave.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace telenano::afm {

slave::SlaveLimits limits_of(const AfmConfig& config) noexcept {
  slave::SlaveLimits limits;
  limits.workspace_min_w_nm = Vec3(-config.half_width_nm, -config.half_width_nm, -config.depth_nm);
  limits.workspace_max_w_nm = Vec3(config.half_width_nm, config.half_width_nm, config.top_nm);
  limits.start_pos_w_nm = Vec3(0, 0, config.lift_nm);
  limits.surface_z_w_nm = 0;
  limits.force_max_nn = config.force_max_nn;
  limits.coupling_stiffness_n_m = config.spring_constant_n_m;  // no harder is ever shown
  limits.coupling_damping_n_s_m = 0;
  limits.measures = true;
  return limits;
}

AfmSlave::AfmSlave(const AfmConfig& config, std::shared_ptr<AfmExchange> exchange, const rt::Clock& clock)
    : lever_n_m_(config.spring_constant_n_m),
      limits_(limits_of(config)),
      lag_nm_(3 * config.step_nm),
      exchange_(std::move(exchange)),
      clock_(clock) {}

void AfmSlave::step(const slave::SlaveInput& input, double, slave::SlaveOutput& output) noexcept {
  exchange_->load_state(state_);
  std::uint32_t faults = 0;
  if (wish_.session == 0) {
    if (input.retract && !input.by_operator) return publish(faults, input, output);  // nobody has come yet
    wish_.session = exchange_->next_session();
  }
  const bool wants = input.follow || input.wanted;
  const bool another = wants && (!wanted_ || input.opening != opening_);
  const bool clears = another || (stopped_ && !input.retract);
  wanted_ = wanted_ || wants;
  if (wants) opening_ = input.opening;
  if (input.retract && input.by_operator) stopped_ = true;
  if (clears) {
    exchange_->clear();
    stopped_ = false;
  }
  wish_.clears = exchange_->clears();
  wish_.time_ns = clock_.now_ns();
  wish_.retract = input.retract;
  wish_.follow = input.follow && !input.retract;
  wish_.wanted = wants && !input.retract;
  if (!is_finite(input.tip_target_pos_w_nm)) {
    faults |= link::kFaultNonFinite;
    wish_.follow = wish_.wanted = false;
  } else if (wish_.follow) {
    wish_.target_w_nm =
        input.tip_target_pos_w_nm.cwiseMax(limits_.workspace_min_w_nm).cwiseMin(limits_.workspace_max_w_nm);
    if (wish_.target_w_nm != input.tip_target_pos_w_nm) faults |= link::kFaultWorkspace;
  }
  exchange_->store_wish(wish_);
  publish(faults, input, output);
  if ((faults & link::kFaultNonFinite) != 0) output.force_w_nn.setZero();
}

void AfmSlave::publish(std::uint32_t faults, const slave::SlaveInput& input,
                       slave::SlaveOutput& output) noexcept {
  const bool following = state_.phase == Phase::kFollowing && !input.retract;
  output.model = {};
  // Never 0, which would say that the force was computed.
  output.measurement_age_ns = state_.force_known
                                  ? std::max<std::int64_t>(clock_.now_ns() - state_.measured_ns, 1)
                                  : slave::kNeverMeasuredNs;
  energy_in_aj_ = std::max(energy_in_aj_, state_.energy_in_aj);
  energy_out_aj_ = std::max(energy_out_aj_, state_.energy_out_aj);
  output.energy_in_aj = energy_in_aj_;
  output.energy_out_aj = energy_out_aj_;
  if (!following) {
    output.fault_bits = faults | link::kFaultRetracted;
    if (approaching(state_.phase) && !input.retract) output.fault_bits |= link::kFaultApproaching;
    output.force_w_nn.setZero();
    output.deflection_nm = 0;
    output.contact_state = link::ContactState::kFree;
    // Where it will stand when it is back: who resumes begins there.
    output.commanded_pos_w_nm = Vec3(state_.base_w_nm.x(), state_.base_w_nm.y(), limits_.start_pos_w_nm.z());
    output.tip_pos_w_nm = Vec3(state_.base_w_nm.x(), state_.base_w_nm.y(), limits_.workspace_max_w_nm.z());
    return;
  }
  const link::LocalModel& m = state_.model;
  const Vec3& base = state_.base_w_nm;
  Vec3 force = Vec3::Zero();
  const double depth_nm = m.version != 0 ? m.normal_w.dot(m.point_w_nm - base) : -1;
  if (depth_nm > 0 || (state_.touching && m.stiffness_n_m * depth_nm > -m.adhesion_nn)) {
    force = m.stiffness_n_m * depth_nm * m.normal_w;
    if (state_.touching) force.x() = state_.measured_force_w_nn.x();  // holds until the next reading
  } else if (!state_.touching &&
             std::fabs(state_.measured_force_w_nn.z()) > threshold_factor_ * state_.noise_nn) {
    force.z() = std::min(0.0, state_.measured_force_w_nn.z());  // attraction across the gap
  }
  // A model that runs ahead of the readings says no more than what is allowed, or was read.
  const double most_nn = std::max(limits_.force_max_nn, state_.measured_force_w_nn.norm());
  if (force.norm() > most_nn) force *= most_nn / force.norm();
  output.force_w_nn = force;
  output.deflection_nm = force.z() / lever_n_m_;
  output.commanded_pos_w_nm = base;
  output.tip_pos_w_nm = base + Vec3(0, 0, output.deflection_nm);
  output.contact_state =
      depth_nm > 0 || state_.touching ? link::ContactState::kContact : link::ContactState::kFree;
  if (state_.held_by_force) faults |= link::kFaultForceLimit;
  if (wish_.follow && !state_.held_by_force && (wish_.target_w_nm - base).norm() > lag_nm_)
    faults |= link::kFaultStepLimit;
  output.fault_bits = faults;
  if (input.wants_model) output.model = m;
}

}  // namespace telenano::afm
