#pragma once

#include <cmath>

#include "telenano/common/base/vec3.h"

namespace telenano::control {

/// Energy certainly lost in the device's own viscous damping b, from sampled positions: ∫b v² dt ≥ b|Δx|²/T
/// over any window (Cauchy–Schwarz). With a quantised encoder Δx is known to ±q an axis only, and b q²/T of a
/// flickering last digit would be a credit for nothing: so the loss is taken over windows long enough for
/// |Δx| ≥ 8 q, as b (|Δx| − q)²/t_window. Windows of an axis do not overlap, so the sum stays certain.
class CertainLoss {
 public:
  CertainLoss(double damping_n_s_m, double position_quantum_m) noexcept
      : damping_n_s_m_(damping_n_s_m), quantum_m_(position_quantum_m) {}

  void start(const Vec3& hand_pos_h_m) noexcept {
    window_start_h_m_ = hand_pos_h_m;
    window_s_.setZero();
  }

  /// What has become certain with this interval, `dt_s` long and ended at `hand_pos_h_m`, J, an axis each.
  Vec3 update(const Vec3& hand_pos_h_m, double dt_s) noexcept {
    Vec3 loss_j = Vec3::Zero();
    for (int axis = 0; axis < 3; ++axis) {
      window_s_[axis] += dt_s;
      const double moved_m = std::fabs(hand_pos_h_m[axis] - window_start_h_m_[axis]);
      const bool enough = moved_m >= kWindowQuanta * quantum_m_;
      if (!enough && window_s_[axis] < kWindowMaxS) continue;
      if (enough) {
        const double certain_m = moved_m - quantum_m_;
        loss_j[axis] = damping_n_s_m_ * certain_m * certain_m / window_s_[axis];
      }
      window_start_h_m_[axis] = hand_pos_h_m[axis];
      window_s_[axis] = 0;
    }
    return loss_j;
  }

 private:
  static constexpr double kWindowQuanta = 8;   // (1 − 1/8)² = 77 % of the loss is still credited
  static constexpr double kWindowMaxS = 0.05;  // a window in which the hand turned back proves little

  double damping_n_s_m_;
  double quantum_m_;
  Vec3 window_start_h_m_ = Vec3::Zero();
  Vec3 window_s_ = Vec3::Zero();
};

}  // namespace telenano::control
