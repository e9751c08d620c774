#pragma once

namespace telenano::physics {

/// A force without contact at one gap: repulsion positive, stiffness dF/d(overlap).
struct LongRangePoint {
  double force_nn = 0;
  double stiffness_n_m = 0;

  LongRangePoint& operator+=(const LongRangePoint& other) noexcept {
    force_nn += other.force_nn;
    stiffness_n_m += other.stiffness_n_m;
    return *this;
  }
};

/// The tip above its apex: a sphere that passes tangentially into a cone. Without cone a half sphere counts.
struct TipShape {
  double half_angle_sin = 0;
  double half_angle_cos = 1;
  double height_nm = 0;  ///< from the apex to the cone's upper end; 0: no cone

  /// Height of the sphere's part above the apex: the cone touches it where the normal leaves the axis by
  /// 90° - theta.
  double cap_nm(double radius_nm) const noexcept {
    const double cap = radius_nm * (1.0 - half_angle_sin);
    return height_nm > 0 && height_nm < cap ? height_nm : cap;
  }
};

}  // namespace telenano::physics
