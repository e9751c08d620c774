#include "common/control/scaling.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/base/det_math.h"

namespace telenano::control {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

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

}  // namespace

double exact_impedance_bound(const ScalingPlant& plant) noexcept {
  const double spring = 0.5 * plant.coupling_stiffness_n_m * plant.period_s;
  const double sum = plant.coupling_damping_n_s_m + spring;
  if (!(sum > 0)) return kInfinity;
  const int turns = std::max(0, plant.delay_samples) + 1;
  const auto bound = [&](double theta) {
    const SinCos half = det_sin_cos(0.5 * theta);
    const SinCos whole = det_sin_cos(theta);
    const SinCos delayed_half = det_sin_cos(0.5 * turns * theta);
    const double s2 = half.sin * half.sin;
    const double c2 = half.cos * half.cos;
    const double one_minus_cos = 2 * delayed_half.sin * delayed_half.sin;  // no cancellation at small θ
    if (!(one_minus_cos > 0)) return kInfinity;
    return (plant.device_damping_n_s_m + plant.adaptive_damping_n_s_m * whole.cos) * 2 * sum * s2 /
           ((sum * sum * s2 + spring * spring * c2) * one_minus_cos);
  };
  double smallest = minimum(bound, 0, kPi, 512 * turns);
  if (spring > 0) {  // θ → 0
    smallest = std::min(smallest, (plant.device_damping_n_s_m + plant.adaptive_damping_n_s_m) * sum /
                                      (spring * spring * turns * turns));
  }
  return smallest;
}

double llewellyn_impedance_bound(const ScalingPlant& plant) noexcept {
  const double spring = 0.5 * plant.coupling_stiffness_n_m * plant.period_s;
  const double sum = plant.coupling_damping_n_s_m + spring;
  if (!(sum > 0)) return kInfinity;
  const auto bound = [&](double c) {
    const double divisor = c * (sum * sum - (sum * sum - spring * spring) * c * c);
    if (!(divisor > 0)) return kInfinity;
    return 2 * (plant.device_damping_n_s_m + plant.adaptive_damping_n_s_m * c * c) * sum * (1 + c) / divisor;
  };
  return minimum(bound, 0, 1, 2048);
}

double device_force_scale_bound(double force_safety, double device_force_max_n,
                                double tip_force_max_nn) noexcept {
  if (!(tip_force_max_nn > 0)) return kInfinity;
  return force_safety * device_force_max_n * kNanonewtonPerNewton / tip_force_max_nn;
}

}  // namespace telenano::control
