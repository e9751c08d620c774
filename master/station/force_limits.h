#pragma once

#include "telenano/common/base/vec3.h"

namespace telenano::station {

/// Limits on a force vector by its norm. All return how the result came about by value, and never make it
/// larger.

/// Scales `force_n` down to norm `bound_n`; `cut` tells whether it did.
inline Vec3 limit_norm(const Vec3& force_n, double bound_n, bool& cut) noexcept {
  const double norm_n = force_n.norm();
  cut = norm_n > bound_n;
  // Rounding may leave the norm one ulp above the bound; the factor stays strictly below it.
  return cut ? Vec3(force_n * (bound_n / norm_n * (1 - 4e-16))) : force_n;
}

/// Slew limit for increases and reversals only: force may fall at once, but what is new must grow. The part
/// of the force that already acts in the wanted direction is the norm from which it may grow: p = max(0,
/// F_old·n). On a line: same sign grows from |F_old|, a reversal from zero.
inline Vec3 limit_slew(const Vec3& force_n, const Vec3& old_force_n, double step_n, bool& cut) noexcept {
  const double norm_n = force_n.norm();
  cut = false;
  if (!(norm_n > 0)) return force_n;
  const double along_n = old_force_n.dot(force_n) / norm_n;
  return limit_norm(force_n, (along_n > 0 ? along_n : 0.0) + step_n, cut);
}

}  // namespace telenano::station
