#include "telenano/common/control/z_width.h"

#include <cmath>
#include <limits>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/common/control/minimum.h"

namespace telenano::control {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// Re{e^{−j(d+1)θ} / (T + τ − τ e^{−jθ})}, 1/s.
double damper_response(const HapticDisplay& display, const VirtualDamper& damper, double theta) noexcept {
  const SinCos turned = det_sin_cos((damper.delay_samples + 1) * theta);
  const SinCos whole = det_sin_cos(theta);
  const double real = display.period_s + damper.filter_s * (1.0 - whole.cos);
  const double imaginary = damper.filter_s * whole.sin;
  return (turned.cos * real - turned.sin * imaginary) / (real * real + imaginary * imaginary);
}

double spring_response(const VirtualDamper& damper, double theta) noexcept {
  return det_sin_cos((damper.delay_samples + 0.5) * theta).sin;
}

int grid_points(const VirtualDamper& damper) noexcept {
  return 1024 * (damper.delay_samples + 1);
}

}  // namespace

double passive_stiffness(const HapticDisplay& display, const VirtualDamper& damper) noexcept {
  const auto left = [&](double theta) {  // for the spring, of 2b/T
    return 2.0 * (display.damping_n_s_m / display.period_s +
                  damper.damping_n_s_m * damper_response(display, damper, theta));
  };
  const int points = grid_points(damper);
  // At θ → 0 the damper alone takes −B: 2(b + B)/T is left.
  const double low = 2.0 * (display.damping_n_s_m + damper.damping_n_s_m) / display.period_s;
  if (!(low > 0) || !(minimum(left, 0, kPi, points) > 0)) return kNaN;
  const auto bound = [&](double theta) {
    const double taken = spring_response(damper, theta) / det_sin_cos(0.5 * theta).sin;
    return taken > 0 ? left(theta) / taken : kInfinity;
  };
  return std::min(minimum(bound, 0, kPi, points), low / (1.0 + 2.0 * damper.delay_samples));
}

double passive_stiffness_closed(const HapticDisplay& display, const VirtualDamper& damper) noexcept {
  const double b = display.damping_n_s_m;
  const double period = display.period_s;
  const double virtual_b = damper.damping_n_s_m;
  double bound = kNaN;
  if (virtual_b == 0) {
    bound = 2.0 * b / ((1.0 + 2.0 * damper.delay_samples) * period);
  } else if (damper.delay_samples == 0) {
    const double spent = virtual_b > 0 ? virtual_b * period / (period + 2.0 * damper.filter_s) : -virtual_b;
    bound = 2.0 / period * (b - spent);
  }
  return bound > 0 ? bound : kNaN;
}

double heavy_hand_stiffness(const HapticDisplay& display, const VirtualDamper& damper,
                            double theta_max) noexcept {
  const auto left = [&](double theta) {
    const double s = det_sin_cos(0.5 * theta).sin;
    return display.damping_n_s_m * theta * theta / (2.0 * s * display.period_s) +
           2.0 * s * damper.damping_n_s_m * damper_response(display, damper, theta);
  };
  const int points = grid_points(damper);
  // Both sides go with θ: divided by it, the limit at 0 is (b + B)/T.
  const double low = (display.damping_n_s_m + damper.damping_n_s_m) / display.period_s;
  if (!(low > 0) || !(minimum([&](double t) { return left(t) / t; }, 0, theta_max, points) > 0)) return kNaN;
  const auto bound = [&](double theta) {
    const double taken = spring_response(damper, theta);
    return taken > 0 ? left(theta) / taken : kInfinity;
  };
  return std::min(minimum(bound, 0, theta_max, points), low / (damper.delay_samples + 0.5));
}

}  // namespace telenano::control
