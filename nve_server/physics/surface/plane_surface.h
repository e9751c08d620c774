#pragma once

#include "telenano/nve_server/physics/surface/surface.h"

namespace telenano::physics {

/// The tilted plane z = z₀ + s_x x + s_y y without end. What lies outside ±extent around the origin is not
/// counted in lowest and highest.
class PlaneSurface final : public Surface {
 public:
  struct Shape {
    double height_nm = 0;  ///< z₀
    double slope_x = 0;
    double slope_y = 0;
    double extent_nm = 500;
  };
  /// Throws UserError unless slopes are at most kMaxSlope, the extent is positive, and all are finite.
  explicit PlaneSurface(const Shape& shape);
  static constexpr double kMaxSlope = 10.0;

  double height_nm(double x_nm, double y_nm) const noexcept override;
  double lowest_nm() const noexcept override { return shape_.height_nm - rise_; }
  double highest_nm() const noexcept override { return shape_.height_nm + rise_; }
  /// Level or not, it is not the plane z = 0 that is meant.
  bool is_flat() const noexcept override { return false; }

 private:
  Shape shape_;
  double rise_;  // at the corners of the extent
};

}  // namespace telenano::physics
