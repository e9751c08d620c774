#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "telenano/master/calibration/axis_dynamics.h"

namespace telenano::app {

using DeviceDynamics = std::array<calibration::AxisDynamics, 3>;  ///< x, y, z of the handle's frame

/// The damping that is certain: the least of the axes' lower bounds, rounded down to three digits; 0 where an
/// interval reaches below.
double certain_damping_n_s_m(const DeviceDynamics& axes);

/// The latency that is not exceeded for certain: the most of the axes' upper bounds, rounded up to 0.01 ms.
double certain_latency_s(const DeviceDynamics& axes);

/// A line an axis, with the 95 % intervals, for a person.
std::string dynamics_table(const DeviceDynamics& axes);

/// The part of a station file that says so; what was measured and when (Unix time) as comments.
std::string dynamics_toml(const std::string& kind, const DeviceDynamics& axes, double seconds_per_axis,
                          std::int64_t unix_s);

}  // namespace telenano::app
