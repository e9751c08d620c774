#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/rt/latest_value.h"
#include "telenano/master/app/devices/device_kinds.h"
#include "telenano/master/app/devices/device_settings.h"
#include "telenano/master/app/station_file.h"
#include "telenano/master/device/call_watch.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/device/hid/hid_reader.h"
#include "telenano/master/device/played_motion.h"
#include "telenano/master/device/pointer_device.h"

namespace telenano::app {

/// An open device with what keeps it going.
struct SessionDevice {
  std::unique_ptr<device::HidReader> pedals;
  std::unique_ptr<device::HidReader> reader;  // before the device that listens to it: goes after it
  std::unique_ptr<device::HapticDevice> device;
  device::PlayedMotion* motion = nullptr;    ///< of a device that plays one
  const device::CallWatch* calls = nullptr;  ///< of a device that calls a vendor's library
  std::string description;                   ///< for a person, one line
  std::vector<std::string> notes;            ///< what a person should know, a line each
};

/// What a plan must know of a device that is not open: for the simulated one what the file says, for an omega
/// the maker's figures and the file's. Nothing for those that show no force.
std::optional<device::DeviceInfo> planned_device(const DeviceSpec& spec, const StationFile& file);

/// Opens every kind but the simulated one, which needs to know the session first. `may_home`: the device may
/// be moved by its motors. `pointer`: what a viewer stores for the mouse; null where there is no viewer.
/// Throws UserError or RunError.
SessionDevice open_session_device(const DeviceSpec& spec, const DeviceSettings& settings, bool may_home,
                                  const rt::LatestValue<device::PointerState>* pointer);

/// Foot pedals besides it, where the station file names some.
void add_pedals(SessionDevice& opened, const PedalSettings& settings);

}  // namespace telenano::app
