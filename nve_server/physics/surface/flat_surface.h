#pragma once

#include "telenano/nve_server/physics/surface/surface.h"

namespace telenano::physics {

/// The plane z = 0 without end.
class FlatSurface final : public Surface {
 public:
  double height_nm(double, double) const noexcept override { return 0.0; }
  double lowest_nm() const noexcept override { return 0.0; }
  double highest_nm() const noexcept override { return 0.0; }
  bool is_flat() const noexcept override { return true; }
};

}  // namespace telenano::physics
