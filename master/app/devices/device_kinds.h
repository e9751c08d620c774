#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace telenano::app {

enum class DeviceKind : std::uint8_t { kSim, kOmega, kHid, kMouse, kReplay };

/// A haptic device that a station can open: a row of the one table of them.
struct DeviceRow {
  DeviceKind kind;
  const char* name;          ///< for --device and `kind` in the station file; DeviceInfo::name begins with it
  bool reads_file = false;   ///< it is given as NAME:FILE, by --device alone
  bool shows_force = false;  ///< so there is a scaling to plan, and its dynamics can be measured
  bool has_own_axes = false;  ///< its frame is not frame H: `calibrate` finds which axis is which
  bool has_motors = false;    ///< they can home it: --home
  bool needs_window = false;  ///< the viewer's window moves the hand
};

/// The one place where devices get their names. Help texts, checks and error messages are made from it.
inline constexpr std::array<DeviceRow, 5> kDeviceRows{{
    {.kind = DeviceKind::kSim, .name = "sim", .shows_force = true},
    {.kind = DeviceKind::kOmega,
     .name = "omega",
     .shows_force = true,
     .has_own_axes = true,
     .has_motors = true},
    {.kind = DeviceKind::kHid, .name = "hid", .has_own_axes = true},
    {.kind = DeviceKind::kMouse, .name = "mouse", .needs_window = true},
    {.kind = DeviceKind::kReplay, .name = "replay", .reads_file = true},
}};

const DeviceRow& device_row(DeviceKind kind) noexcept;
inline const char* device_name(DeviceKind kind) noexcept {
  return device_row(kind).name;
}

/// Names of the devices for which `has` is true, in the table's order; "replay:FILE" where a file is read.
template <class Has>
std::vector<std::string> device_names(const Has& has) {
  std::vector<std::string> names;
  for (const DeviceRow& row : kDeviceRows) {
    if (has(row)) names.push_back(std::string(row.name) + (row.reads_file ? ":FILE" : ""));
  }
  return names;
}

/// "{sim,omega}": as the help of an option and the shells' completion show the choices.
std::string choices_text(const std::vector<std::string>& names);
/// "sim, omega or hid": as a sentence says them. No names: "none".
std::string any_of_text(const std::vector<std::string>& names);

/// What --device names.
struct DeviceSpec {
  using Kind = DeviceKind;
  Kind kind = Kind::kSim;
  std::string file;  ///< of a replay
};

/// A name of the table, with its file where it reads one. Throws UserError.
DeviceSpec parse_device_spec(const std::string& text);

}  // namespace telenano::app
