#include "telenano/master/view_model/scaling_region.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace telenano::view_model {
namespace {

// Just inside, so that the station's own check, which multiplies in another order, agrees.
constexpr double kInside = 1 - 1e-9;

constexpr double kAboveBorder = 10;

}  // namespace

double ScalingRegion::force_top() const noexcept {
  const double largest = *std::max_element(impedance_bound.begin(), impedance_bound.end()) / velocity_planned;
  const double top = kAboveBorder * std::max(largest, device_force_scale);
  return std::isfinite(top) && top > kAboveBorder * force_min ? top : kAboveBorder * force_min;
}

double ScalingRegion::force_max(control::Method method, double velocity) const noexcept {
  if (unsafe_allowed) return std::numeric_limits<double>::infinity();
  return std::max(bound(method), 0.0) / velocity * kInside;
}

control::Scaling ScalingRegion::clamped(control::Method method,
                                        const control::Scaling& wanted) const noexcept {
  control::Scaling scaling;
  scaling.velocity =
      std::clamp(std::isfinite(wanted.velocity) ? wanted.velocity : velocity_min, velocity_min, velocity_max);
  const double force = std::isfinite(wanted.force) ? std::max(wanted.force, force_min) : force_min;
  scaling.force = std::min(force, force_max(method, scaling.velocity));
  return scaling;
}

double slider_of(double value, double least, double greatest) noexcept {
  if (!(value > least)) return 0;
  if (!(value < greatest)) return 1;
  return std::log(value / least) / std::log(greatest / least);
}

double value_of(double slider, double least, double greatest) noexcept {
  return least * std::pow(greatest / least, std::clamp(slider, 0.0, 1.0));
}

}  // namespace telenano::view_model
