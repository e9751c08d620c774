#pragma once

#include <algorithm>
#include <cmath>

#include "telenano/common/base/vec3.h"

namespace telenano::studies::stress {

/// What the hand has got out of its port, three axes, true positions, the force that really acted, long
/// double; shares nothing with the product. As support::PortAccount, and besides:
///
///   Q = (q/2)·(Σ|ΔF| + 2 max|F|), summed over the axes: what an encoder of quantum q may hide (summation by
///   parts, positions within q/2).
class TrueAccount {
 public:
  TrueAccount(double damping_n_s_m, double period_s, double quantum_m)
      : damping_n_s_m_(damping_n_s_m), period_s_(period_s), quantum_m_(quantum_m) {}

  /// A period during which `force_n` acted and the hand moved by `moved_m`.
  void add(const Vec3& force_n, const Vec3& moved_m) noexcept {
    for (int axis = 0; axis < 3; ++axis) {
      const long double f = force_n[axis], dx = moved_m[axis];
      if (dx != 0) {  // most hands leave two axes alone, and a division is slow
        given_j_ += f * dx;
        loss_j_ += damping_n_s_m_ * dx * dx / period_s_;
      }
      steps_n_ += std::fabs(f - last_n_[axis]);
      most_n_[axis] = std::max(most_n_[axis], std::fabs(force_n[axis]));
    }
    last_n_ = force_n;
    most_given_j_ = std::max(most_given_j_, given_j_);
    most_extracted_j_ = std::max(most_extracted_j_, given_j_ - loss_j_);
  }

  double given_j() const noexcept { return static_cast<double>(given_j_); }
  double extracted_j() const noexcept { return static_cast<double>(given_j_ - loss_j_); }
  double most_given_j() const noexcept { return static_cast<double>(most_given_j_); }
  double most_extracted_j() const noexcept { return static_cast<double>(most_extracted_j_); }
  double quantum_bound_j() const noexcept {
    return 0.5 * quantum_m_ * (static_cast<double>(steps_n_) + 2 * most_n_.sum());
  }

 private:
  long double damping_n_s_m_, period_s_;
  double quantum_m_;
  long double given_j_ = 0, loss_j_ = 0, most_given_j_ = 0, most_extracted_j_ = 0, steps_n_ = 0;
  Vec3 last_n_ = Vec3::Zero();
  Vec3 most_n_ = Vec3::Zero();
};

}  // namespace telenano::studies::stress
