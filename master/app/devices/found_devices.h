#pragma once

#include <vector>

#include "telenano/master/device/device_map.h"

namespace telenano::app {

/// The hands of this machine, the simulated one first. Devices are opened and closed, none is moved.
std::vector<device::FoundDevice> find_devices();

}  // namespace telenano::app
