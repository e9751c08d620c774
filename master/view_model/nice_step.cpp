#include "telenano/master/view_model/nice_step.h"

#include <cmath>

namespace telenano::view_model {

double nice_step(double value) noexcept {
  if (!(value > 0) || !std::isfinite(value)) return 1;
  const double decade = std::pow(10.0, std::floor(std::log10(value)));
  const double mantissa = value / decade * (1 + 1e-12);  // 0.2 / 0.1 may come out a hair too small
  if (mantissa >= 10) return 10 * decade;
  if (mantissa >= 5) return 5 * decade;
  if (mantissa >= 2) return 2 * decade;
  return decade;
}

}  // namespace telenano::view_model
