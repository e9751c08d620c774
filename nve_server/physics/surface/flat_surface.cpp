#include "telenano/nve_server/physics/surface/flat_surface.h"

#include <cmath>

#include "telenano/common/base/error.h"

namespace telenano::physics {

FlatSurface::FlatSurface(double tip_radius_nm) : tip_radius_(tip_radius_nm) {
  if (!(tip_radius_nm > 0.0 && std::isfinite(tip_radius_nm))) {
    throw UserError("surface: expected a positive tip radius");
  }
}

SurfaceContact FlatSurface::nearest(const Vec3& centre_w_nm, Search, FootMemory&) const noexcept {
  SurfaceContact contact;
  contact.distance_nm = centre_w_nm.z();
  contact.foot_w_nm = Vec3(centre_w_nm.x(), centre_w_nm.y(), 0.0);
  contact.effective_radius_nm = contact.origin_radius_nm = tip_radius_;
  return contact;
}

}  // namespace telenano::physics
