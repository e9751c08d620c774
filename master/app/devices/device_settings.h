#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/common/config/toml_document.h"
#include "telenano/master/app/devices/device_kinds.h"
#include "telenano/master/device/device_map.h"

namespace telenano::app {

/// [device] of the station file. What is left out is the backend's own default.
struct DeviceSettings {
  std::string kind = device_name(DeviceKind::kSim);  ///< what --device says when it is not given
  std::optional<std::string> serial;
  std::optional<device::AxisMap> axes;
  std::optional<Vec3> centre_m;                  ///< of the workspace, in the device's own frame
  std::optional<double> workspace_half_m;        ///< half the edge of the largest cube in it
  std::optional<std::uint32_t> deadman_buttons;  ///< masks
  std::optional<std::uint32_t> clutch_buttons;
  std::optional<std::uint32_t> stop_buttons;
  std::optional<int> watchdog_ms;
  std::optional<double> force_max_n;
  std::optional<double> damping_n_s_m;
  std::optional<double> latency_ms;
  std::optional<double> mass_kg;
  std::optional<double> speed_m_s;
  std::optional<double> hold_s;
  std::optional<double> dead_zone;
};

/// [pedal] of the station file: foot pedals besides the device.
struct PedalSettings {
  std::uint16_t vendor = 0;  ///< 0: there are none
  std::uint16_t product = 0;
  device::ButtonMap buttons{};
};

PedalSettings read_pedal_settings(const config::TomlTable& table);
DeviceSettings read_device_settings(const config::TomlTable& table);

/// What was given, by its name in the file; but for kind, damping and latency, which a recording has anyway.
void describe(const DeviceSettings& settings, std::vector<std::pair<std::string, std::string>>& list);

}  // namespace telenano::app
