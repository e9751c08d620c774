#pragma once

#include "telenano/common/base/vec3.h"

namespace telenano::physics {

/// Is the symmetric matrix positive definite (Sylvester's minors)? Reads the lower triangle.
inline bool positive_definite(const Mat3& m) noexcept {
  const double minor = m(0, 0) * m(1, 1) - m(1, 0) * m(1, 0);
  const double a = m(1, 1) * m(2, 2) - m(2, 1) * m(2, 1);
  const double b = m(1, 0) * m(2, 2) - m(2, 1) * m(2, 0);
  const double c = m(1, 0) * m(2, 1) - m(1, 1) * m(2, 0);
  return m(0, 0) > 0.0 && minor > 0.0 && m(0, 0) * a - m(1, 0) * b + m(2, 0) * c > 0.0;
}

/// Its inverse by the adjugate; false, with the rest as it comes, unless it is positive definite. A library's
/// decomposition of a 3 × 3 matrix costs five times as much.
inline bool invert_positive(const Mat3& m, Mat3& inverse) noexcept {
  const double m00 = m(0, 0), m10 = m(1, 0), m20 = m(2, 0), m11 = m(1, 1), m21 = m(2, 1), m22 = m(2, 2);
  const double a = m11 * m22 - m21 * m21;
  const double b = m21 * m20 - m10 * m22;
  const double c = m10 * m21 - m11 * m20;
  const double minor = m00 * m11 - m10 * m10;
  const double determinant = m00 * a + m10 * b + m20 * c;
  if (!(m00 > 0.0 && minor > 0.0 && determinant > 0.0)) return false;
  const double scale = 1.0 / determinant;
  const double d = m00 * m22 - m20 * m20;
  const double e = m10 * m20 - m00 * m21;
  inverse << scale * a, scale * b, scale * c, scale * b, scale * d, scale * e, scale * c, scale * e,
      scale * minor;
  return true;
}

/// The inverse of any regular matrix, by the adjugate.
inline Mat3 inverse_of(const Mat3& m) noexcept {
  const double a = m(1, 1) * m(2, 2) - m(1, 2) * m(2, 1);
  const double b = m(1, 2) * m(2, 0) - m(1, 0) * m(2, 2);
  const double c = m(1, 0) * m(2, 1) - m(1, 1) * m(2, 0);
  const double scale = 1.0 / (m(0, 0) * a + m(0, 1) * b + m(0, 2) * c);
  Mat3 inverse;
  inverse(0, 0) = scale * a;
  inverse(1, 0) = scale * b;
  inverse(2, 0) = scale * c;
  inverse(0, 1) = scale * (m(0, 2) * m(2, 1) - m(0, 1) * m(2, 2));
  inverse(1, 1) = scale * (m(0, 0) * m(2, 2) - m(0, 2) * m(2, 0));
  inverse(2, 1) = scale * (m(0, 1) * m(2, 0) - m(0, 0) * m(2, 1));
  inverse(0, 2) = scale * (m(0, 1) * m(1, 2) - m(0, 2) * m(1, 1));
  inverse(1, 2) = scale * (m(0, 2) * m(1, 0) - m(0, 0) * m(1, 2));
  inverse(2, 2) = scale * (m(0, 0) * m(1, 1) - m(0, 1) * m(1, 0));
  return inverse;
}

/// a b, without the library's blocking.
inline Mat3 times(const Mat3& a, const Mat3& b) noexcept {
  return a.lazyProduct(b);
}

}  // namespace telenano::physics
