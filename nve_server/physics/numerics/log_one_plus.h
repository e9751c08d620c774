#pragma once

#include "telenano/common/base/det_math.h"

namespace telenano::physics {

/// ln(1 + y), y > 0, in the form 2 s (1 + e) with s = y/(2 + y), e = atanh(s)/s - 1 = s^2/3 + s^4/5 + ...
/// What is left when the leading terms of an expression in ln(1 + y) cancel is then a sum of positive terms:
///   1 - ln(1 + y)/y = s - (1 - s) e,        (1 + 1/y) ln(1 + y) - 1 = s + e + s e,
///   ln(1 + y) - y/(1 + y) = 2 s (e + s/(1 + s)),   y - ln(1 + y) = 2 s (s/(1 - s) - e).
struct LogOnePlus {
  double s = 0;
  double rest = 1;  ///< 1 - s = 2/(2 + y)
  double e = 0;

  explicit LogOnePlus(double y) noexcept : s(y / (2.0 + y)), rest(2.0 / (2.0 + y)) {
    if (s < kSeriesBelow) {
      e = series(s);
    } else {
      e = det_log(1.0 + y) / (2.0 * s) - 1.0;
    }
  }
  double log() const noexcept { return 2.0 * s * (1.0 + e); }

  static constexpr double kSeriesBelow = 0.1;
  /// Nine terms: the first left out is below 2e-18 of the first.
  static double series(double s) noexcept {
    const double x = s * s;
    return x * (1.0 / 3 +
                x * (1.0 / 5 +
                     x * (1.0 / 7 +
                          x * (1.0 / 9 +
                               x * (1.0 / 11 + x * (1.0 / 13 + x * (1.0 / 15 + x * (1.0 / 17 + x / 19))))))));
  }
};

/// ln(1 + y) of several y >= 0, with the bits of LogOnePlus; the series has no branch, so that two are made at
/// once.
inline void log_one_plus(const double* y, int count, double* log) noexcept {
  for (int k = 0; k < count; ++k) {
    const double s = y[k] / (2.0 + y[k]);
    log[k] = 2.0 * s * (1.0 + LogOnePlus::series(s));
  }
  for (int k = 0; k < count; ++k) {
    // s rises with y, and is 0.1 at 2/9: a little below, the class decides.
    if (!(y[k] < 0.22)) log[k] = LogOnePlus(y[k]).log();
  }
}

}  // namespace telenano::physics
