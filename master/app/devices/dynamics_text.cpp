#include "telenano/master/app/devices/dynamics_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/utc_time.h"

namespace telenano::app {
namespace {

using calibration::AxisDynamics;
using calibration::Interval;

std::string with_bounds(const Interval& interval, double times = 1) {
  return fmt::format("{:.4f} ({:.4f} to {:.4f})", times * interval.value, times * interval.low,
                     times * interval.high);
}

double rounded_down(double value) {
  if (!(value > 0)) return 0;
  const double digit = std::pow(10.0, std::floor(std::log10(value)) - 2);
  return digit * std::floor(value / digit);
}

}  // namespace

double certain_damping_n_s_m(const DeviceDynamics& axes) {
  double least = axes[0].damping_n_s_m.low;
  for (const AxisDynamics& axis : axes) least = std::min(least, axis.damping_n_s_m.low);
  return rounded_down(least);
}

double certain_latency_s(const DeviceDynamics& axes) {
  double most_s = 0;
  for (const AxisDynamics& axis : axes) most_s = std::max(most_s, axis.latency_s.high);
  return 1e-5 * std::ceil(1e5 * most_s - 1e-9);
}

std::string dynamics_table(const DeviceDynamics& axes) {
  std::string text = fmt::format("{:4}  {:27}  {:27}  {:29}  {:25}  {}\n", "axis", "mass, kg",
                                 "damping, N s/m", "friction, N", "latency, ms", "encoder step, mm");
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const AxisDynamics& axis = axes[i];
    text += fmt::format("{:4}  {:27}  {:27}  {:29}  {:25}  {}\n", "xyz"[i], with_bounds(axis.mass_kg),
                        with_bounds(axis.damping_n_s_m), with_bounds(axis.friction_n),
                        with_bounds(axis.latency_s, 1e3),
                        axis.quantum_m > 0 ? fmt::format("{:.3g}", 1e3 * axis.quantum_m) : "none seen");
  }
  return text;
}

std::string dynamics_toml(const std::string& kind, const DeviceDynamics& axes, double seconds_per_axis,
                          std::int64_t unix_s) {
  std::string text = fmt::format("# Measured by telenano-master calibrate --dynamics, {}, {:g} s an axis:\n",
                                 utc_text(unix_s), seconds_per_axis);
  double mass_kg = 0;
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const AxisDynamics& axis = axes[i];
    mass_kg += axis.mass_kg.value / static_cast<double>(axes.size());
    text += fmt::format("# {}: mass {} kg, damping {} N s/m, friction {} N, latency {} ms\n", "xyz"[i],
                        with_bounds(axis.mass_kg), with_bounds(axis.damping_n_s_m),
                        with_bounds(axis.friction_n), with_bounds(axis.latency_s, 1e3));
  }
  text += fmt::format("[device]\nkind = \"{}\"\n", kind);
  text += fmt::format("damping_n_s_m = {:.3g}  # lower bound (97.5 %) of the least damped axis\n",
                      certain_damping_n_s_m(axes));
  text += fmt::format("latency_ms = {:.5g}  # upper bound (97.5 %) of the slowest axis\n",
                      1e3 * certain_latency_s(axes));
  text += fmt::format("mass_kg = {:.3g}\n", mass_kg);
  return text;
}

}  // namespace telenano::app
