#include "telenano/nve_server/physics/surface/plane_surface.h"

#include <cmath>

#include "telenano/common/base/error.h"

namespace telenano::physics {

PlaneSurface::PlaneSurface(const Shape& shape, double tip_radius_nm)
    : shape_(shape),
      tip_radius_(tip_radius_nm),
      normal_(Vec3(-shape.slope_x, -shape.slope_y, 1.0) /
              std::sqrt(1.0 + shape.slope_x * shape.slope_x + shape.slope_y * shape.slope_y)),
      rise_((std::abs(shape.slope_x) + std::abs(shape.slope_y)) * shape.extent_nm) {
  if (!(std::abs(shape.slope_x) <= kMaxSlope && std::abs(shape.slope_y) <= kMaxSlope)) {
    throw UserError("plane: expected slopes from -10 to 10");
  }
  if (!(std::isfinite(shape.height_nm) && shape.extent_nm > 0.0 && std::isfinite(shape.extent_nm))) {
    throw UserError("plane: expected a finite height and a positive extent");
  }
  if (!(tip_radius_nm > 0.0 && std::isfinite(tip_radius_nm))) {
    throw UserError("plane: expected a positive tip radius");
  }
}

double PlaneSurface::height_nm(double x_nm, double y_nm) const noexcept {
  return shape_.height_nm + shape_.slope_x * x_nm + shape_.slope_y * y_nm;
}

SurfaceContact PlaneSurface::nearest(const Vec3& centre, Search, FootMemory& memory) const noexcept {
  SurfaceContact contact;
  contact.normal_w = normal_;
  contact.distance_nm = normal_.z() * (centre.z() - height_nm(centre.x(), centre.y()));
  contact.foot_w_nm = centre - contact.distance_nm * normal_;
  contact.effective_radius_nm = contact.origin_radius_nm = tip_radius_;
  contact.outside = !(std::abs(contact.foot_w_nm.x()) <= shape_.extent_nm &&
                      std::abs(contact.foot_w_nm.y()) <= shape_.extent_nm);
  memory.x_nm = contact.foot_w_nm.x();
  memory.y_nm = contact.foot_w_nm.y();
  memory.warm = true;
  return contact;
}

}  // namespace telenano::physics
