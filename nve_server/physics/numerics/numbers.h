#pragma once

#include <limits>

#include "telenano/common/base/constants.h"

namespace telenano::physics {

inline constexpr double kTwoPi = 2.0 * kPi;
inline constexpr double kLn2 = 0.69314718055994530942;
inline constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

}  // namespace telenano::physics
