#pragma once

#include <string>

#include "telenano/master/device/replay_device.h"

namespace telenano::app {

/// The hand of a recording, from the moment at which the station first engaged. Where it was not engaged (a
/// silent server, a device whose force was cut, a stop) the hand moved no tip: the clutch is pressed there, so
/// that it moves none again. Throws UserError: one line with the file.
device::HandTrack load_hand_track(const std::string& path);

}  // namespace telenano::app
