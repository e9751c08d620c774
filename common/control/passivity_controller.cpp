#include "telenano/common/control/passivity_controller.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace telenano::control {

PassivityController::PassivityController(const PassivityConfig& config) noexcept
    : config_(config),
      loss_(config.damping_certain_n_s_m, config.position_quantum_m),
      damper_cap_n_s_m_(std::max(0.0, config.damping_certain_n_s_m -
                                          0.5 * config.shown_stiffness_n_m * config.period_s -
                                          std::fabs(config.shown_damping_n_s_m))) {}

void PassivityController::take_over(double account_j, const Vec3& hand_pos_h_m) noexcept {
  account_j_ = std::min(0.0, account_j);
  // Which axis owes it is not known: a third each.
  axis_account_j_.setConstant(account_j_ / 3);
  damper_n_s_m_ = 0;
  damper_force_h_n_.setZero();
  loss_.start(hand_pos_h_m);
}

void PassivityController::repay_with(const Vec3& loss_j) noexcept {
  if (account_j_ < 0) {
    const double repaid_j = std::min(-account_j_, loss_j.x() + loss_j.y() + loss_j.z());
    account_j_ += repaid_j;
    credit_j_ += repaid_j;
  }
  for (int axis = 0; axis < 3; ++axis) {
    if (axis_account_j_[axis] < 0)
      axis_account_j_[axis] = std::min(0.0, axis_account_j_[axis] + loss_j[axis]);
  }
}

void PassivityController::damp(const Vec3& deficit_axes_j, double deficit_j,
                               const PortInterval& interval) noexcept {
  const bool capped = config_.method != Method::kKs;
  const auto damping = [&](double deficit, double moved_m2) {
    if (!(deficit > 0) || !(moved_m2 > 0)) return 0.0;
    const double wanted_n_s_m = deficit * interval.dt_s / moved_m2;
    const double given_n_s_m = capped ? std::min(wanted_n_s_m, damper_cap_n_s_m_) : wanted_n_s_m;
    // Δx may be so small that γ overflows; such a damper cannot act, and must not make a NaN.
    return std::isfinite(given_n_s_m) ? given_n_s_m : 0.0;
  };
  if (config_.damper == DamperDirection::kAlongMotion) {
    damper_n_s_m_ = damping(deficit_j, interval.displacement_h_m.squaredNorm());
    if (damper_n_s_m_ > 0) damper_force_h_n_ = -damper_n_s_m_ / interval.dt_s * interval.displacement_h_m;
    return;
  }
  for (int axis = 0; axis < 3; ++axis) {
    const double moved_m = interval.displacement_h_m[axis];
    const double damper = damping(deficit_axes_j[axis], moved_m * moved_m);
    damper_force_h_n_[axis] = -damper / interval.dt_s * moved_m;
    damper_n_s_m_ = std::max(damper_n_s_m_, damper);
  }
}

void PassivityController::account_for(const PortInterval& interval) noexcept {
  damper_n_s_m_ = 0;
  damper_force_h_n_.setZero();
  const bool per_axis = config_.damper == DamperDirection::kPerAxis;
  const Vec3 put_in_axes_j = -interval.applied_force_h_n.cwiseProduct(interval.displacement_h_m);
  const Vec3 before_axes_j = axis_account_j_;
  const double before_j = account_j_;
  account_j_ += interval.put_in_j;
  axis_account_j_ += put_in_axes_j;
  if (config_.method == Method::kNone) return;
  if (config_.method == Method::kKs) {
    // As published: the damper acts on E(k−1), and γ|Δx|²/T = −E(k−1) is credited at once.
    const double deficit_j = std::max(0.0, -before_j);
    const Vec3 deficit_axes_j = (-before_axes_j).cwiseMax(0.0);
    if (interval.displacement_h_m.squaredNorm() > 0 && !per_axis) account_j_ += deficit_j;
    if (per_axis) {
      for (int axis = 0; axis < 3; ++axis) {
        if (interval.displacement_h_m[axis] == 0) continue;
        axis_account_j_[axis] += deficit_axes_j[axis];
        account_j_ += deficit_axes_j[axis];
      }
    }
    damp(deficit_axes_j, deficit_j, interval);
    return;
  }
  repay_with(loss_.update(interval.hand_pos_h_m, interval.dt_s));
  if (config_.leak_time_s > 0) {
    const double kept = std::max(0.0, 1 - interval.dt_s / config_.leak_time_s);
    if (account_j_ > 0) account_j_ *= kept;
    for (double& axis_j : axis_account_j_) {
      if (axis_j > 0) axis_j *= kept;
    }
  }
  account_j_ = std::min(account_j_, config_.store_max_j);
  axis_account_j_ = axis_account_j_.cwiseMin(config_.store_max_j);
  damp((-axis_account_j_).cwiseMax(0.0), std::max(0.0, -account_j_), interval);
}

double PassivityController::force_bound_n() const noexcept {
  if (!clamps()) return std::numeric_limits<double>::infinity();
  return std::max(0.0, account_j_ + config_.allowance_j) / (config_.velocity_max_m_s * config_.period_s);
}

}  // namespace telenano::control
