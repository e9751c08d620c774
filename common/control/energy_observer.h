#pragma once

#include <algorithm>
#include <cmath>

#include "telenano/common/base/vec3.h"

namespace telenano::control {

/// Neumaier's compensated sum: the error of n additions is about one rounding of the result plus n·u² of
/// Σ|terms|, instead of n·u, so hours of samples stay exact to the last digits.
class CompensatedSum {
 public:
  void add(double term) noexcept {
    const double next = sum_ + term;
    carry_ += std::fabs(sum_) >= std::fabs(term) ? (sum_ - next) + term : (term - next) + sum_;
    sum_ = next;
  }
  double value() const noexcept { return sum_ + carry_; }
  void reset() noexcept { *this = {}; }

 private:
  double sum_ = 0;
  double carry_ = 0;
};

/// Sampled one-port energy observer.
///
/// The force is held between samples (zero-order hold), so the work done in the interval that ends at sample
/// k is exactly F(k−1)·[x(k) − x(k−1)], whatever the hand did in between. With F the force **on the hand**,
/// the energy that the hand puts in is
///
///   E(k) = E(k−1) − F(k−1)·[x(k) − x(k−1)]                                                    [N, m, J]
///
/// F must be the total force really applied: damper, limits, clamp, saturation and command quantisation
/// included; then nothing has to be added for the damper (to add it again counts it twice). The index is not
/// a detail: F(k)·Δx(k) turns a wall that gives energy away into one that seems to take it. F·v·T with a
/// filtered v is not an energy.
///
/// Quantised positions x + e with |e_i| ≤ q/2: summation by parts,
///   Σ F(k−1)·Δe(k) = F(n−1)·e(n) − F(0)·e(0) − Σ e(k)·[F(k) − F(k−1)],
/// so the error of E is at most Q = (q/2)·(Σ|ΔF| + 2 max|F|), summed over the axes, each with its own
/// maximum. The bound is kept beside the account; it is not mixed into it.
class EnergyObserver {
 public:
  explicit EnergyObserver(double position_quantum_m = 0) noexcept : quantum_m_(position_quantum_m) {}

  /// Accounts for the interval that has just ended: `applied_force_h_n` acted during all of it, `hand_pos_h_m` is
  /// its end. The first call only sets the position. Returns the energy put in by the hand in this interval.
  /// Arguments must be finite.
  double update(const Vec3& applied_force_h_n, const Vec3& hand_pos_h_m) noexcept {
    if (!started_) {
      started_ = true;
      last_pos_h_m_ = hand_pos_h_m;
      return 0;
    }
    displacement_h_m_ = hand_pos_h_m - last_pos_h_m_;
    last_pos_h_m_ = hand_pos_h_m;
    const Vec3 work_j = applied_force_h_n.cwiseProduct(displacement_h_m_);
    const double put_in_j = -(work_j.x() + work_j.y() + work_j.z());
    for (int axis = 0; axis < 3; ++axis) {
      energy_.add(-work_j[axis]);
      max_force_n_[axis] = std::max(max_force_n_[axis], std::fabs(applied_force_h_n[axis]));
    }
    if (put_in_j > 0) energy_in_.add(put_in_j);
    if (put_in_j < 0) energy_out_.add(-put_in_j);
    exchanged_.add(work_j.cwiseAbs().sum());
    force_steps_n_.add((applied_force_h_n - last_force_h_n_).cwiseAbs().sum());
    last_force_h_n_ = applied_force_h_n;
    return put_in_j;
  }

  /// The position is taken up anew, without an exchange: what lies before means nothing (a device that has
  /// just been calibrated). No force may have acted meanwhile.
  void resume_at(const Vec3& hand_pos_h_m) noexcept {
    last_pos_h_m_ = hand_pos_h_m;
    displacement_h_m_.setZero();
  }

  double energy_j() const noexcept { return energy_.value(); }        ///< put in by the hand, net
  double energy_in_j() const noexcept { return energy_in_.value(); }  ///< ≥ 0, never falls
  double energy_out_j() const noexcept {
    return energy_out_.value();
  }  ///< given to the hand, ≥ 0, never falls
  double exchanged_j() const noexcept { return exchanged_.value(); }  ///< Σ|F Δx| over all axes
  double quantisation_bound_j() const noexcept {
    return 0.5 * quantum_m_ * (force_steps_n_.value() + 2 * max_force_n_.sum());
  }
  const Vec3& displacement_h_m() const noexcept { return displacement_h_m_; }  ///< of the last interval
  bool started() const noexcept { return started_; }

 private:
  double quantum_m_;
  bool started_ = false;
  Vec3 last_pos_h_m_ = Vec3::Zero();
  Vec3 displacement_h_m_ = Vec3::Zero();
  Vec3 last_force_h_n_ = Vec3::Zero();
  Vec3 max_force_n_ = Vec3::Zero();
  CompensatedSum energy_;
  CompensatedSum energy_in_;
  CompensatedSum energy_out_;
  CompensatedSum exchanged_;
  CompensatedSum force_steps_n_;
};

}  // namespace telenano::control
