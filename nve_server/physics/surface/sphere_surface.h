#pragma once

#include "telenano/nve_server/physics/surface/surface.h"

namespace telenano::physics {

/// A particle on a plate: the cap of a sphere of radius ρ that rises `height` above the plane z = 0 around
/// (x, y), in closed form. The solid is the union of ball and half-space, so from outside it the distance is
/// the lesser of the two, and the crease between them, being hollow, is never nearest:
///
///   ball: e = c − m, m = (x, y, height − ρ); distance |e| − ρ, n = e/|e|, ∂n/∂c = (1 − nnᵀ)/|e|,
///         κ₁ = κ₂ = 1/ρ, R_eff = Rρ/(R + ρ);
///   plane: distance c_z, n = e_z, R_eff = R.
///
/// A local search stays on the side of the crease where its foot was, while there is a foot on it; so a tip
/// that leans on both has both.
class SphereSurface final : public Surface {
 public:
  struct Shape {
    double x_nm = 0;
    double y_nm = 0;
    double radius_nm = 50;
    double height_nm = 50;  ///< up to the radius: no overhang
  };
  SphereSurface(const Shape& shape, double tip_radius_nm);

  SurfaceContact nearest(const Vec3& centre_w_nm, Search search, FootMemory& memory) const noexcept override;
  double height_nm(double x_nm, double y_nm) const noexcept override;
  double lowest_nm() const noexcept override { return 0.0; }
  double highest_nm() const noexcept override { return shape_.height_nm; }
  bool is_flat() const noexcept override { return false; }

 private:
  Shape shape_;
  double tip_radius_;
  Vec3 middle_;
  double crease_sq_;  // squared radius of the crease: ρ² − (height − ρ)²
};

}  // namespace telenano::physics
