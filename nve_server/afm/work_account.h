#pragma once

#include <algorithm>
#include <cmath>

#include "telenano/common/base/vec3.h"

namespace telenano::afm {

/// The energy account of a port whose force is read now and then: the force–position integral, by trapezia
/// between readings, with a bound of what it may be wrong by.
///
/// Between two readings the base goes from p₀ to p₁ = p₀ + Δ, over a way s ≥ |Δ|; it strays from the straight
/// way by at most x = (s − |Δ|)/2. Where the tip can touch, the force is a function of the base that is
/// nowhere steeper than the lever, k, but where it snaps in or lets go, by at most j; so on the way it lies
/// within k x + j of what is between both readings, and each reading within e of the true force at p: e = n +
/// k w, n the noise (three standard deviations) and w the way travelled while it was averaged and on its way.
/// The trapezium's error is then at most (½|ΔF| + e₀ + e₁ + k x + j) s. Free at both ends, e = n and j = 0.
class WorkAccount {
 public:
  struct Reading {
    Vec3 base_w_nm = Vec3::Zero();  ///< mean of where it was sent while the force was averaged
    Vec3 force_w_nn = Vec3::Zero();
    double way_nm = 0;         ///< travelled since the last reading
    double window_way_nm = 0;  ///< travelled while this one may have been averaged
  };

  WorkAccount(double lever_n_m) noexcept : lever_n_m_(lever_n_m) {}

  /// `touches`: the tip may have been in contact since the last reading; `jump_nn`: j.
  void add(const Reading& now, double noise_nn, bool touches, double jump_nn) noexcept {
    if (has_last_) {
      const Vec3 move = now.base_w_nm - last_.base_w_nm;
      const double work_aj = -0.5 * (now.force_w_nn + last_.force_w_nn).dot(move);
      (work_aj > 0 ? energy_in_aj_ : energy_out_aj_) += std::fabs(work_aj);
      const double straight_nm = move.norm();
      const double way_nm = std::max(now.way_nm, straight_nm);
      double error_nn = 0.5 * (now.force_w_nn - last_.force_w_nn).norm() + 2 * noise_nn +
                        lever_n_m_ * 0.5 * (way_nm - straight_nm);
      if (touches) error_nn += lever_n_m_ * (now.window_way_nm + last_.window_way_nm) + jump_nn;
      bound_aj_ += error_nn * way_nm;
    }
    last_ = now;
    has_last_ = true;
  }
  /// The tip is moved by the controller, not by the port: the next reading begins anew.
  void interrupt() noexcept { has_last_ = false; }

  double energy_in_aj() const noexcept { return energy_in_aj_; }
  double energy_out_aj() const noexcept { return energy_out_aj_; }
  double bound_aj() const noexcept { return bound_aj_; }

 private:
  double lever_n_m_;
  bool has_last_ = false;
  Reading last_;
  double energy_in_aj_ = 0;
  double energy_out_aj_ = 0;
  double bound_aj_ = 0;
};

}  // namespace telenano::afm
