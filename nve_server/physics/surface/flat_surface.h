#pragma once

#include "telenano/nve_server/physics/surface/surface.h"

namespace telenano::physics {

/// The plane z = 0 without end.
class FlatSurface final : public Surface {
 public:
  explicit FlatSurface(double tip_radius_nm);

  SurfaceContact nearest(const Vec3& centre_w_nm, Search search, FootMemory& memory) const noexcept override;
  double height_nm(double, double) const noexcept override { return 0.0; }
  double lowest_nm() const noexcept override { return 0.0; }
  double highest_nm() const noexcept override { return 0.0; }
  bool is_flat() const noexcept override { return true; }

 private:
  double tip_radius_;
};

}  // namespace telenano::physics
