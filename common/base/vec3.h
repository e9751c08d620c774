#pragma once

#include <Eigen/Core>
#include <cmath>

namespace telenano {

/// A vector in one of the frames W (sample), T (tip) or H (handle); the name of the variable says which, and
/// the unit.
using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix3d;

inline bool is_finite(const Vec3& v) noexcept {
  return std::isfinite(v.x()) && std::isfinite(v.y()) && std::isfinite(v.z());
}

}  // namespace telenano
