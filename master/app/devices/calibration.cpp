#include "telenano/master/app/devices/calibration.h"

#include <fmt/format.h>

#include <cmath>

namespace telenano::app {

Push judge_push(const Vec3& displacement_d_m, double shortest_m) {
  if (!is_finite(displacement_d_m)) return {"", "the device gave no position"};
  int axis = 0;
  displacement_d_m.cwiseAbs().maxCoeff(&axis);
  const double along_m = std::fabs(displacement_d_m[axis]);
  if (along_m < shortest_m) {
    return {"", fmt::format("the handle moved by only {:.1f} mm; push it by {:.0f} mm or more", 1e3 * along_m,
                            1e3 * shortest_m)};
  }
  for (int other = 0; other < 3; ++other) {
    const double across_m = std::fabs(displacement_d_m[other]);
    if (other == axis || 2 * across_m <= along_m) continue;
    return {"", fmt::format("the handle went {:.0f} mm along {} and {:.0f} mm along {}; push it straight",
                            1e3 * along_m, "xyz"[axis], 1e3 * across_m, "xyz"[other])};
  }
  return {fmt::format("{}{}", displacement_d_m[axis] > 0 ? '+' : '-', "xyz"[axis]), ""};
}

std::string calibration_toml(const std::string& kind, const device::AxisMap& axes, const ReachedBox* box) {
  std::string text =
      fmt::format("[device]\nkind = \"{}\"\naxes = \"{}\"\n", kind, fmt::join(axes.names(), " "));
  if (box != nullptr) {
    const Vec3 c = box->centre_d_m();
    // To a tenth of a millimetre: a hand does not find the ends any better.
    text += fmt::format("centre_m = [{:.4f}, {:.4f}, {:.4f}]\nworkspace_half_m = {:.4f}\n", c.x(), c.y(),
                        c.z(), box->half_m());
  }
  return text;
}

}  // namespace telenano::app
