#include "telenano/nve_server/physics/surface/plane_surface.h"

#include <cmath>

#include "telenano/common/base/error.h"

namespace telenano::physics {

PlaneSurface::PlaneSurface(const Shape& shape)
    : shape_(shape), rise_((std::abs(shape.slope_x) + std::abs(shape.slope_y)) * shape.extent_nm) {
  if (!(std::abs(shape.slope_x) <= kMaxSlope && std::abs(shape.slope_y) <= kMaxSlope)) {
    throw UserError("plane: expected slopes from -10 to 10");
  }
  if (!(std::isfinite(shape.height_nm) && shape.extent_nm > 0.0 && std::isfinite(shape.extent_nm))) {
    throw UserError("plane: expected a finite height and a positive extent");
  }
}

double PlaneSurface::height_nm(double x_nm, double y_nm) const noexcept {
  return shape_.height_nm + shape_.slope_x * x_nm + shape_.slope_y * y_nm;
}

}  // namespace telenano::physics
