#include "telenano/common/control/scaling.h"

#include <algorithm>
#include <limits>

#include "telenano/common/base/det_math.h"
#include "telenano/common/control/minimum.h"

namespace telenano::control {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

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

double exact_impedance_bound(ScalingPlant plant, double delay_samples) noexcept {
  const double whole = std::floor(delay_samples);
  const double part = delay_samples - whole;
  plant.delay_samples = static_cast<int>(whole);
  const double shorter = exact_impedance_bound(plant);
  if (!(part > 0)) return shorter;
  ++plant.delay_samples;
  const double longer = exact_impedance_bound(plant);
  if (!(shorter > 0) || !(longer > 0)) return std::min(shorter, longer);
  return 1 / ((1 - part) / shorter + part / longer);
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
