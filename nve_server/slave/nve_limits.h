#pragma once

#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/slave.h"

namespace telenano::slave {

/// What a station may know of the NVE before it moves, but for the well.
SlaveLimits limits_of(const scene::Scene& scene);

}  // namespace telenano::slave
