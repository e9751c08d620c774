#pragma once

#include <cstddef>
#include <vector>

#include "telenano/common/base/random.h"

namespace telenano::studies {

/// Where a path may be changed to, and kept within.
struct PathRange {
  double low_m = 0, high_m = 0;        ///< of places that are drawn
  double lowest_m = 0, highest_m = 0;  ///< that a hand goes to at all
};

/// A step of hill climbing over a hand's path, points `knot_s` apart: `knots_m` differs from before in one
/// stretch of 25 ms to 0.8 s: somewhere else, deeper or higher, shaken, or the same later.
void change_a_stretch(std::vector<double>& knots_m, double knot_s, const PathRange& range, Random& random);

}  // namespace telenano::studies
