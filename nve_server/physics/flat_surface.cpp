#include "nve_server/physics/flat_surface.h"

namespace telenano::physics {

SurfaceContact FlatSurface::nearest(const Vec3& centre_w_nm, Search, FootMemory&) const noexcept {
  SurfaceContact contact;
  contact.distance_nm = centre_w_nm.z();
  contact.foot_w_nm = Vec3(centre_w_nm.x(), centre_w_nm.y(), 0.0);
  return contact;
}

}  // namespace telenano::physics
