#pragma once

#include "telenano/common/control/local_slave.h"

namespace telenano::app {

/// What a step of this twin costs here, s of this thread's processor time: 99 of 100 groups of ten steps of a
/// touch (down from its start until it touches and 2 nm on, 50 nm along the ground, up again, at `rate_hz`)
/// are within it. The second such touch: what the first one makes for those that follow does not count. Leaves
/// the twin as a new one.
double twin_step_cost_s(control::LocalSlave& twin, double rate_hz);

/// Up to this share of a tick a twin is used: the rest of the tick is the station's, and a late tick shows a
/// force that is old.
inline constexpr double kTwinShareOfTick = 1.0 / 3;

}  // namespace telenano::app
