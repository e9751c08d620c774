#pragma once

#include "telenano/nve_server/physics/surface/surface.h"

namespace telenano::physics {

/// The tilted plane z = z₀ + s_x x + s_y y without end, in closed form: with n = (−s_x, −s_y, 1)/√(1 + s_x² +
/// s_y²) the distance of c is n_z (c_z − z(c_x, c_y)), the foot c − distance·n; no curvature, R_eff = R. What
/// lies outside ±extent around the origin is flagged, and its height not counted in lowest and highest.
class PlaneSurface final : public Surface {
 public:
  struct Shape {
    double height_nm = 0;  ///< z₀
    double slope_x = 0;
    double slope_y = 0;
    double extent_nm = 500;
  };
  /// Slopes at most kMaxSlope, extent and radius positive, all finite.
  PlaneSurface(const Shape& shape, double tip_radius_nm);
  static constexpr double kMaxSlope = 10.0;

  SurfaceContact nearest(const Vec3& centre_w_nm, Search search, FootMemory& memory) const noexcept override;
  double height_nm(double x_nm, double y_nm) const noexcept override;
  double lowest_nm() const noexcept override { return shape_.height_nm - rise_; }
  double highest_nm() const noexcept override { return shape_.height_nm + rise_; }
  /// Level or not, it is not the plane z = 0 that is meant.
  bool is_flat() const noexcept override { return false; }

 private:
  Shape shape_;
  double tip_radius_;
  Vec3 normal_;
  double rise_;  // at the corners of the extent
};

}  // namespace telenano::physics
