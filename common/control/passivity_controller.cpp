#include "common/control/passivity_controller.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace telenano::control {
namespace {

constexpr double kWindowQuanta = 8;   // (1 − 1/8)² = 77 % of the loss is still credited
constexpr double kWindowMaxS = 0.05;  // a window in which the hand turned back proves little: start again

}  // namespace

PassivityController::PassivityController(const PassivityConfig& config) noexcept
    : config_(config),
      observer_(config.position_quantum_m),
      damper_cap_n_s_m_(std::max(0.0, config.damping_certain_n_s_m -
                                          0.5 * config.shown_stiffness_n_m * config.period_s -
                                          std::fabs(config.shown_damping_n_s_m))) {}

double PassivityController::certain_loss_j(const Vec3& hand_pos_h_m, double dt_s) noexcept {
  double loss_j = 0;
  for (int axis = 0; axis < 3; ++axis) {
    window_s_[axis] += dt_s;
    const double moved_m = std::fabs(hand_pos_h_m[axis] - window_start_h_m_[axis]);
    const bool enough = moved_m >= kWindowQuanta * config_.position_quantum_m;
    if (!enough && window_s_[axis] < kWindowMaxS) continue;
    if (enough) {
      const double certain_m = moved_m - config_.position_quantum_m;
      loss_j += config_.damping_certain_n_s_m * certain_m * certain_m / window_s_[axis];
    }
    window_start_h_m_[axis] = hand_pos_h_m[axis];
    window_s_[axis] = 0;
  }
  return loss_j;
}

void PassivityController::observe(const Vec3& applied_force_h_n, const Vec3& hand_pos_h_m,
                                  double dt_s) noexcept {
  damper_n_s_m_ = 0;
  damper_force_h_n_.setZero();
  if (!observer_.started()) {
    observer_.update(applied_force_h_n, hand_pos_h_m);
    window_start_h_m_ = hand_pos_h_m;
    return;
  }
  const double put_in_j = observer_.update(applied_force_h_n, hand_pos_h_m);
  const Vec3& displacement_h_m = observer_.displacement_h_m();
  const double moved_m2 = displacement_h_m.squaredNorm();
  double deficit_j = 0;
  switch (config_.method) {
    case Method::kKs:
      deficit_j = std::max(0.0, -ledger_j_);  // E(k−1), as published
      ledger_j_ += put_in_j;
      if (moved_m2 > 0) ledger_j_ += deficit_j;  // γ|Δx|²/T with γ = −E T/|Δx|²
      break;
    case Method::kKsClamp: {
      ledger_j_ += put_in_j;
      const double loss_j = certain_loss_j(hand_pos_h_m, dt_s);
      if (ledger_j_ < 0) {
        const double repaid_j = std::min(-ledger_j_, loss_j);
        ledger_j_ += repaid_j;
        credit_j_ += repaid_j;
      }
      deficit_j = std::max(0.0, -ledger_j_);
      break;
    }
    default:
      ledger_j_ = observer_.energy_j();
      return;
  }
  if (deficit_j > 0 && moved_m2 > 0) {
    const double wanted_n_s_m = deficit_j * dt_s / moved_m2;
    damper_n_s_m_ = config_.method == Method::kKs ? wanted_n_s_m : std::min(wanted_n_s_m, damper_cap_n_s_m_);
    // Δx may be so small that γ overflows; such a damper cannot act, and must not make a NaN.
    if (!std::isfinite(damper_n_s_m_)) damper_n_s_m_ = 0;
    damper_force_h_n_ = -damper_n_s_m_ / dt_s * displacement_h_m;
  }
}

double PassivityController::force_bound_n() const noexcept {
  if (config_.method != Method::kKsClamp) return std::numeric_limits<double>::infinity();
  return std::max(0.0, ledger_j_ + config_.allowance_j) / (config_.velocity_max_m_s * config_.period_s);
}

}  // namespace telenano::control
