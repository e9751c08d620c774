#include "telenano/nve_server/physics/surface/sphere_surface.h"

#include <cmath>

#include "telenano/common/base/error.h"

namespace telenano::physics {

SphereSurface::SphereSurface(const Shape& shape)
    : shape_(shape), crease_sq_(shape.height_nm * (2.0 * shape.radius_nm - shape.height_nm)) {
  if (!(std::isfinite(shape.x_nm) && std::isfinite(shape.y_nm) && shape.radius_nm > 0.0 &&
        std::isfinite(shape.radius_nm))) {
    throw UserError("sphere: expected a finite position and a positive radius");
  }
  if (!(shape.height_nm > 0.0 && shape.height_nm <= shape.radius_nm)) {
    throw UserError("sphere: expected a height above 0 and up to the radius (no overhang)");
  }
}

double SphereSurface::height_nm(double x_nm, double y_nm) const noexcept {
  const double ex = x_nm - shape_.x_nm, ey = y_nm - shape_.y_nm;
  const double out_sq = ex * ex + ey * ey;
  if (!(out_sq < crease_sq_)) return 0.0;
  return shape_.height_nm - shape_.radius_nm + std::sqrt(shape_.radius_nm * shape_.radius_nm - out_sq);
}

}  // namespace telenano::physics
