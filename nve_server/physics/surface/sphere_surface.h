#pragma once

#include "telenano/nve_server/physics/surface/surface.h"

namespace telenano::physics {

/// A ball on a plate: the cap of a sphere of radius ρ that rises `height` above the plane z = 0 around (x,
/// y).
class SphereSurface final : public Surface {
 public:
  struct Shape {
    double x_nm = 0;
    double y_nm = 0;
    double radius_nm = 50;
    double height_nm = 50;  ///< up to the radius: no overhang
  };
  /// Throws UserError unless the place is finite, the radius positive and the height above 0 and at most the
  /// radius.
  explicit SphereSurface(const Shape& shape);

  double height_nm(double x_nm, double y_nm) const noexcept override;
  double lowest_nm() const noexcept override { return 0.0; }
  double highest_nm() const noexcept override { return shape_.height_nm; }
  bool is_flat() const noexcept override { return false; }

 private:
  Shape shape_;
  double crease_sq_;  // squared radius of the crease: ρ² − (height − ρ)²
};

}  // namespace telenano::physics
