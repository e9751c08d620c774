#pragma once

#include <algorithm>
#include <cmath>

#include "telenano/common/base/vec3.h"

namespace telenano::device {

/// How a hand that is only pointed at (mouse, SpaceMouse) may move.
struct HandMotionLimits {
  double speed_max_m_s = 0.25;  ///< below any sensible velocity trip
  double smooth_s = 0.03;       ///< time constant of what rounds the corners
  double half_m = 0.055;        ///< the hand stays within a cube of twice this edge
};

/// A smooth way to a target that may jump: a point that goes straight at the target with bounded speed, and
/// the hand, which follows that point by a first-order lag. Implicit Euler: h = dt/(τ + dt) lies in (0, 1),
/// so the hand stays between where it was and the point, for every dt.
///
/// Speed: let p be the point, x the hand, d = p − x. A step of the hand is h·(p' − x) = h·(d + Δp) with
/// |Δp| ≤ v·dt. If |d| ≤ v·τ then |step| ≤ dt/(τ + dt)·(v·τ + v·dt) = v·dt, and the new distance is
/// (1 − h)·|d + Δp| ≤ τ/(τ + dt)·(v·τ + v·dt) = v·τ. So from rest the bound holds for ever, for steps of any
/// length, and for a velocity in any direction.
class SmoothHand {
 public:
  explicit SmoothHand(const HandMotionLimits& limits = {}) noexcept : limits_(limits) {}

  void stand_at(const Vec3& pos_h_m) noexcept { point_h_m_ = hand_h_m_ = kept_inside(pos_h_m); }

  /// `target_h_m` finite, `dt_s` positive.
  void follow(const Vec3& target_h_m, double dt_s) noexcept {
    const Vec3 way = kept_inside(target_h_m) - point_h_m_;
    const double length_m = way.norm();
    const double reach_m = limits_.speed_max_m_s * dt_s;
    point_h_m_ += length_m > reach_m ? Vec3(way * (reach_m / length_m)) : way;
    hand_h_m_ += (dt_s / (limits_.smooth_s + dt_s)) * (point_h_m_ - hand_h_m_);
  }

  const Vec3& pos_h_m() const noexcept { return hand_h_m_; }
  const HandMotionLimits& limits() const noexcept { return limits_; }

  Vec3 kept_inside(const Vec3& pos_h_m) const noexcept {
    return pos_h_m.cwiseMax(-limits_.half_m).cwiseMin(limits_.half_m);
  }

 private:
  HandMotionLimits limits_;
  Vec3 point_h_m_ = Vec3::Zero();
  Vec3 hand_h_m_ = Vec3::Zero();
};

}  // namespace telenano::device
