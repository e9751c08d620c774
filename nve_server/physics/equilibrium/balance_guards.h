#pragma once

#include <cmath>

#include "telenano/common/base/vec3.h"

/// What keeps Newton's method of tip_equilibrium.cpp from going round in circles.
namespace telenano::physics {

/// Newton's method between two places that send it to each other: in a pit nearly as narrow as the tip the
/// foot swings from one side to the other within a fraction of a nanometre, and with it the normal, and from
/// neither side does Newton see the steep stretch between. So when a step turns back on the one before, the
/// place between is sought (by halving) where it does not, and Newton goes on from there, with that place's
/// own, steep, slope.
class Swing {
 public:
  explicit Swing(double tip_radius_nm) noexcept : least_(kLeastRadii * tip_radius_nm) {}
  /// Takes the step found at p; changes it to where to go instead. True while a swing is being searched.
  bool guard(const Vec3& p, Vec3& step) noexcept {
    if (searching_) {
      const double along = step.dot(direction_);
      if (std::abs(along) < kTurnedBack * direction_.squaredNorm() || ++halvings_ == kHalvings) {
        searching_ = false;
      } else {
        (along > 0.0 ? low_ : high_) = at_;
        at_ = 0.5 * (low_ + high_);
        step = origin_ + at_ * direction_ - p;
        return true;
      }
    } else if (armed_ && step.norm() > least_ &&
               step.dot(direction_) < -kTurnedBack * direction_.squaredNorm()) {
      searching_ = true;
      halvings_ = 0;
      low_ = 0.0;
      high_ = 1.0;
      at_ = 0.5;
      step = origin_ + at_ * direction_ - p;
      return true;
    }
    armed_ = true;
    origin_ = p;
    direction_ = step;
    return false;
  }
  void forget() noexcept { armed_ = searching_ = false; }
  bool searching() const noexcept { return searching_; }

 private:
  static constexpr double kTurnedBack = 0.3;
  static constexpr double kLeastRadii = 1e-3;  // shorter swings are left to the secants
  static constexpr int kHalvings = 12;
  double least_;
  bool armed_ = false;
  bool searching_ = false;
  int halvings_ = 0;
  double low_ = 0, high_ = 1, at_ = 0;
  Vec3 origin_ = Vec3::Zero();
  Vec3 direction_ = Vec3::Zero();
};

/// What Newton's method leaves out — how the radius, its gradient and the friction go with the position —
/// from the steps themselves: Anderson's acceleration with up to three of them, which in three dimensions is
/// the secant method. Of the steps r_k found at p_k the combination of changes Δr that best cancels the
/// present r is taken off, with the positions that go with it:
///   p_{k+1} = p_k + r_k − Σ γ_i (Δp_i + Δr_i),   γ = argmin |r_k − Σ γ_i Δr_i|.
/// Source: D. G. Anderson, J. ACM 12 (1965) 547.
class Secants {
 public:
  void forget() noexcept { known_ = -1; }
  Vec3 better(const Vec3& p, const Vec3& step) noexcept {
    if (known_ >= 0) {
      // A step much longer than the last belongs to another piece of ground.
      if (step.squaredNorm() > kLonger * kLonger * last_step_.squaredNorm()) {
        known_ = -1;
      } else {
        for (int i = kDepth - 1; i > 0; --i) {
          moved_[i] = moved_[i - 1];
          changed_[i] = changed_[i - 1];
        }
        moved_[0] = p - last_p_;
        changed_[0] = step - last_step_;
        if (known_ < kDepth) ++known_;
      }
    }
    if (known_ < 0) known_ = 0;
    last_p_ = p;
    last_step_ = step;
    // Gram–Schmidt from the newest change on; those that say nothing new are left out.
    Vec3 rest = step, result = step;
    Vec3 direction[kDepth], carried[kDepth];
    int used = 0;
    for (int i = 0; i < known_; ++i) {
      Vec3 change = changed_[i], move = moved_[i] + changed_[i];
      const double size = change.squaredNorm();
      for (int j = 0; j < used; ++j) {
        const double part = direction[j].dot(change);
        change -= part * direction[j];
        move -= part * carried[j];
      }
      const double left = change.squaredNorm();
      if (!(left > kNew * kNew * size && left > 0.0)) continue;
      const double inverse = 1.0 / std::sqrt(left);
      direction[used] = change * inverse;
      carried[used] = move * inverse;
      const double part = direction[used].dot(rest);
      rest -= part * direction[used];
      result -= part * carried[used];
      ++used;
    }
    // Never much farther than the step itself: secants extrapolate.
    const double longest = kFarther * step.norm();
    const double length = result.norm();
    if (length > longest) result *= longest / length;
    return result;
  }

 private:
  static constexpr int kDepth = 3;
  static constexpr double kNew = 0.05;
  static constexpr double kLonger = 4.0;
  static constexpr double kFarther = 5.0;
  int known_ = -1;  // changes; -1: not even a position
  Vec3 last_p_ = Vec3::Zero(), last_step_ = Vec3::Zero();
  Vec3 moved_[kDepth], changed_[kDepth];
};

}  // namespace telenano::physics
