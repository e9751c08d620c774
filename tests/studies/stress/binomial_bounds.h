#pragma once

#include <cstddef>

namespace telenano::studies::stress {

/// Exact bounds of a rate after Clopper and Pearson (Biometrika 26 (1934), 404–413), each one-sided at
/// `confidence` (0.975 for both ends of an interval at 95 %): for `hits` among `trials` independent trials.
///
/// Upper: the p at which no more than `hits` would be seen with probability 1 − confidence; 1 if all hit.
/// Lower: the p at which no fewer would be seen with that probability; 0 if none hit.
/// No trials: anything from 0 to 1. Needs hits ≤ trials, 0 < confidence < 1.
double binomial_upper(std::size_t hits, std::size_t trials, double confidence);
double binomial_lower(std::size_t hits, std::size_t trials, double confidence);

}  // namespace telenano::studies::stress
