#include "telenano/master/app/devices/found_devices.h"

#include <utility>

#include "telenano/master/app/devices/device_kinds.h"
#include "telenano/master/device/hid/hid_port.h"
#include "telenano/master/device/omega/omega_device.h"

namespace telenano::app {

std::vector<device::FoundDevice> find_devices() {
  std::vector<device::FoundDevice> all{
      {device_name(DeviceKind::kSim), "simulated omega.3 with a simulated hand", "", "", true, ""}};
  for (auto& one : device::find_omegas()) all.push_back(std::move(one));
  for (auto& one : device::find_pucks()) all.push_back(std::move(one));
  return all;
}

}  // namespace telenano::app
