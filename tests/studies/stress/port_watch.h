#pragma once

#include <algorithm>
#include <cmath>

#include "telenano/nve_server/slave/slave.h"

namespace telenano::studies::stress {

/// Are a slave's sums of energy the work that is done at its port? Held against the forces and the commanded places that
/// it says itself, step by step, by the trapezium rule:
///
///   Σ(Δin − Δout) = −∫F·dx
///
/// What is stored and what is lost are both within the sums, so nothing else is needed. A force that goes from F₀ to F₁
/// without turning back does a work that the trapezium misses by ½|ΔF·Δx| at most. Where a contact begins or ends in a
/// step, the force goes through its extreme there: its greatest so far, twice, over the step's way. In a long step it may turn
/// back besides, and an extreme may be one that was never seen: the whole well then. A slave may charge more than that, by a part of what is turned over (it
/// is the hand that pays), and by no more.
class PortWatch {
 public:
  /// Of the turnover Σ|F·Δx|: scans charge up to 0.2 % more than the work (SceneEnergy), other grounds nothing.
  static constexpr double kChargedMore = 0.01;

  /// `well_aj`: of the slave (SlaveLimits).
  explicit PortWatch(double well_aj) noexcept : well_aj_(well_aj) {}

  /// After a step of the slave.
  void step(const slave::SlaveOutput& now) noexcept {
    if (begun_) {
      const Vec3 moved = now.commanded_pos_w_nm - last_.commanded_pos_w_nm;
      const double first = -last_.force_w_nn.dot(moved), last = -now.force_w_nn.dot(moved);
      const double charged =
          (now.energy_in_aj - last_.energy_in_aj) - (now.energy_out_aj - last_.energy_out_aj);
      most_nn_ = std::max(most_nn_, now.force_w_nn.norm());
      charged_more_aj_ += charged - 0.5 * (first + last);
      turnover_aj_ += 0.5 * (std::fabs(first) + std::fabs(last));
      bound_aj_ += 0.5 * std::fabs(first - last);
      const double way_nm = moved.norm();
      if (way_nm > kLongNm) bound_aj_ += 0.5 * most_nn_ * way_nm;
      if (now.contact_state != last_.contact_state)
        bound_aj_ += std::max(2 * most_nn_ * way_nm, way_nm > kLongNm ? well_aj_ : 0);
    }
    begun_ = true;
    last_ = now;
  }
  bool is_true() const noexcept {
    const double bound_aj = bound_aj_ + kRoundingAj;
    return charged_more_aj_ >= -bound_aj && charged_more_aj_ <= bound_aj + kChargedMore * turnover_aj_;
  }
  double charged_more_aj() const noexcept { return charged_more_aj_; }
  double bound_aj() const noexcept { return bound_aj_; }
  double turnover_aj() const noexcept { return turnover_aj_; }

 private:
  // Differences of some 1e3 aJ in double, 1e4 of them: 1e-9 at most. A contact has some 10 aJ.
  static constexpr double kRoundingAj = 1e-6;
  static constexpr double kLongNm = 0.5;
  double well_aj_;
  bool begun_ = false;
  slave::SlaveOutput last_;
  double most_nn_ = 0;
  double charged_more_aj_ = 0, turnover_aj_ = 0, bound_aj_ = 0;
};

}  // namespace telenano::studies::stress
