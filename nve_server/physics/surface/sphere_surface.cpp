#include "telenano/nve_server/physics/surface/sphere_surface.h"

#include <cmath>

#include "telenano/common/base/error.h"

namespace telenano::physics {

SphereSurface::SphereSurface(const Shape& shape, double tip_radius_nm)
    : shape_(shape),
      tip_radius_(tip_radius_nm),
      middle_(shape.x_nm, shape.y_nm, shape.height_nm - shape.radius_nm),
      crease_sq_(shape.height_nm * (2.0 * shape.radius_nm - shape.height_nm)) {
  if (!(std::isfinite(shape.x_nm) && std::isfinite(shape.y_nm) && shape.radius_nm > 0.0 &&
        std::isfinite(shape.radius_nm))) {
    throw UserError("sphere: expected a finite position and a positive radius");
  }
  if (!(shape.height_nm > 0.0 && shape.height_nm <= shape.radius_nm)) {
    throw UserError("sphere: expected a height above 0 and up to the radius (no overhang)");
  }
  if (!(tip_radius_nm > 0.0 && std::isfinite(tip_radius_nm))) {
    throw UserError("sphere: expected a positive tip radius");
  }
}

double SphereSurface::height_nm(double x_nm, double y_nm) const noexcept {
  const double ex = x_nm - shape_.x_nm, ey = y_nm - shape_.y_nm;
  const double out_sq = ex * ex + ey * ey;
  if (!(out_sq < crease_sq_)) return 0.0;
  return middle_.z() + std::sqrt(shape_.radius_nm * shape_.radius_nm - out_sq);
}

SurfaceContact SphereSurface::nearest(const Vec3& centre, Search search, FootMemory& memory) const noexcept {
  const Vec3 e = centre - middle_;
  const double length = e.norm();
  // From the very middle every direction is as good: up.
  const Vec3 n = length > 0.0 ? Vec3(e / length) : Vec3(0.0, 0.0, 1.0);
  const Vec3 on_ball = middle_ + shape_.radius_nm * n;
  const double out_sq = e.x() * e.x() + e.y() * e.y();
  const bool ball_has = on_ball.z() >= 0.0;     // a foot, above the plate
  const bool plane_has = out_sq >= crease_sq_;  // a foot, not under the ball
  bool ball = length - shape_.radius_nm < centre.z();
  if (search == Search::kLocal && memory.warm && ball_has && plane_has) {
    const double mx = memory.x_nm - shape_.x_nm, my = memory.y_nm - shape_.y_nm;
    ball = mx * mx + my * my < crease_sq_;
  }
  if (!plane_has && ball_has) ball = true;

  SurfaceContact contact;
  if (ball) {
    contact.distance_nm = length - shape_.radius_nm;
    contact.foot_w_nm = on_ball;
    contact.normal_w = n;
    contact.curvature_1_per_nm = contact.curvature_2_per_nm = 1.0 / shape_.radius_nm;
    contact.effective_radius_nm = tip_radius_ * shape_.radius_nm / (tip_radius_ + shape_.radius_nm);
    if (length > 1e-3) contact.normal_turn_per_nm = (Mat3::Identity() - n * n.transpose()) / length;
  } else {
    contact.distance_nm = centre.z();
    contact.foot_w_nm = Vec3(centre.x(), centre.y(), 0.0);
    contact.effective_radius_nm = tip_radius_;
  }
  contact.origin_radius_nm = contact.effective_radius_nm;
  memory.x_nm = contact.foot_w_nm.x();
  memory.y_nm = contact.foot_w_nm.y();
  memory.warm = true;
  return contact;
}

}  // namespace telenano::physics
