#include "telenano/nve_server/physics/particle/particle_bristle.h"

#include <Eigen/Geometry>

namespace telenano::physics {

BristleResponse respond(const Bristle& bristle, const Vec3& trial) noexcept {
  BristleResponse out;
  if (!bristle.acts()) return out;
  const double k = bristle.stiffness;
  const double reach = bristle.limit / k;
  const double length = trial.norm();
  if (length <= reach) {
    out.deflection = trial;
    out.force = k * trial;
    out.stored = out.envelope = 0.5 * k * length * length;
    out.tangent = k * Mat3::Identity();
    return out;
  }
  const Vec3 along = trial / length;
  out.slips = true;
  out.deflection = reach * along;
  out.force = bristle.limit * along;
  out.stored = 0.5 * bristle.limit * reach;
  out.dissipated = bristle.limit * (length - reach);
  out.envelope = out.stored + out.dissipated;
  out.tangent = (bristle.limit / length) * (Mat3::Identity() - along * along.transpose());
  return out;
}

Vec3 carried_over(const Vec3& deflection, double stiffness_before, double stiffness) noexcept {
  if (!(stiffness > 0.0)) return Vec3::Zero();
  return stiffness > stiffness_before ? Vec3(deflection * (stiffness_before / stiffness)) : deflection;
}

Vec3 transported(const Vec3& vector, const Vec3& from, const Vec3& to) noexcept {
  // Rodrigues' formula for the smallest turn that takes one normal to the other.
  const double cosine = from.dot(to);
  if (!(cosine > -0.99)) return Vec3::Zero();
  const Vec3 axis = from.cross(to);
  const Vec3 once = axis.cross(vector);
  return vector + once + axis.cross(once) / (1.0 + cosine);
}

}  // namespace telenano::physics
