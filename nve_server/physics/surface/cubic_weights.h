#pragma once

namespace telenano::physics {

/// Cubic B-splines that reach into a cell at u in [0, 1], and their derivatives along the length: `inv` is
/// 1/h.
struct CubicWeights {
  double value[4], slope[4], bend[4];
};

inline CubicWeights cubic_weights(double u, double inv) noexcept {
  const double v = 1.0 - u;
  const double u2 = u * u;
  const double inv2 = inv * inv;
  constexpr double kSixth = 1.0 / 6.0;
  return {{kSixth * v * v * v, kSixth * ((3.0 * u - 6.0) * u2 + 4.0),
           kSixth * (((-3.0 * u + 3.0) * u + 3.0) * u + 1.0), kSixth * u2 * u},
          {inv * (-0.5 * v * v), inv * ((1.5 * u - 2.0) * u), inv * ((-1.5 * u + 1.0) * u + 0.5),
           inv * (0.5 * u2)},
          {inv2 * v, inv2 * (3.0 * u - 2.0), inv2 * (1.0 - 3.0 * u), inv2 * u}};
}

}  // namespace telenano::physics
