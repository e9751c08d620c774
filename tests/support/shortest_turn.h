#pragma once

#include <Eigen/Geometry>
#include <cmath>

#include "telenano/common/base/vec3.h"

namespace telenano::support {

/// The shortest turn of one direction onto another: about the normal of both, by the angle between them. (Eigen's own
/// FromTwoVectors gives the same by a singular value decomposition, which takes 7 s to compile.)
inline Mat3 shortest_turn(const Vec3& from, const Vec3& to) {
  const Vec3 normal = from.cross(to);
  return Eigen::AngleAxisd(std::atan2(normal.norm(), from.dot(to)), normal.normalized()).toRotationMatrix();
}

}  // namespace telenano::support
