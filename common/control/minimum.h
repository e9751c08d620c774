#pragma once

#include <algorithm>

namespace telenano::control {

/// Minimum of f on (low, high]: a grid finds the basin, golden section refines it. f may be +infinite.
template <class Function>
double minimum(const Function& f, double low, double high, int points) {
  const double step = (high - low) / points;
  int best = points;
  double best_value = f(high);
  for (int i = 1; i < points; ++i) {
    const double value = f(low + step * i);
    if (value < best_value) {
      best = i;
      best_value = value;
    }
  }
  double left = low + step * (best - 1);
  double right = std::min(high, low + step * (best + 1));
  if (best == 1) left = low + 1e-6 * step;
  constexpr double kGolden = 0.6180339887498949;
  for (int i = 0; i < 80; ++i) {
    const double a = right - kGolden * (right - left);
    const double b = left + kGolden * (right - left);
    const double value_a = f(a);
    const double value_b = f(b);
    best_value = std::min({best_value, value_a, value_b});
    (value_a < value_b ? right : left) = value_a < value_b ? b : a;
  }
  return best_value;
}

}  // namespace telenano::control
