#include "tests/studies/methods/climbing.h"

#include <algorithm>

#include "telenano/common/base/det_math.h"

namespace telenano::studies {

void change_a_stretch(std::vector<double>& knots_m, double knot_s, const PathRange& range, Random& random) {
  const std::size_t count = knots_m.size();
  // A stretch of 25 ms and more: less would hardly be felt, and climbing would not end.
  const double wide_s = 0.025 * det_exp(3.5 * random.uniform());
  const auto wide = std::min(count, static_cast<std::size_t>(std::max(1.0, wide_s / knot_s)));
  const auto from = static_cast<std::size_t>(random.below(count - wide + 1));
  const double level_m = random.uniform(range.low_m, range.high_m);
  const double shift_m = 0.002 * random.normal();
  const auto kind = random.below(4);
  const auto later = static_cast<std::size_t>(random.below(wide) + 1);
  const std::vector<double> before_m = knots_m;
  for (std::size_t k = from; k < from + wide; ++k) {
    switch (kind) {
      case 0:  // stay somewhere else
        knots_m[k] = level_m;
        break;
      case 1:  // the same deeper or higher
        knots_m[k] += shift_m;
        break;
      case 2:  // shake
        knots_m[k] = random.uniform(range.low_m, range.high_m);
        break;
      default:  // the same sooner or later
        knots_m[k] = before_m[(k + later) % count];
        break;
    }
    knots_m[k] = std::clamp(knots_m[k], range.lowest_m, range.highest_m);
  }
}

}  // namespace telenano::studies
