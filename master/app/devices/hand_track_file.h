#pragma once

#include <string>

#include "telenano/master/device/replay_device.h"

namespace telenano::app {

/// The hand of a recording, from the moment at which the station first engaged. Throws UserError: one line
/// with the file.
device::HandTrack load_hand_track(const std::string& path);

}  // namespace telenano::app
