#include "telenano/master/app/devices/device_settings.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <sstream>

#include "telenano/common/base/error.h"

namespace telenano::app {
namespace {

using config::between;
using config::TomlTable;

std::optional<device::AxisMap> read_axes(const TomlTable& table) {
  if (!table.has("axes")) return std::nullopt;
  std::istringstream words(table.text("axes"));
  std::array<std::string, 3> names;
  std::string more;
  words >> names[0] >> names[1] >> names[2];
  if (words >> more || names[2].empty()) {
    table.fail("axes", "expected three device axes for the hand's right, away and up, e.g. \"+y -x +z\"");
  }
  try {
    return device::AxisMap::parse(names, "axes");
  } catch (const UserError& error) {
    table.fail("axes", error.what());
  }
}

/// Numbers of buttons, as a mask.
std::optional<std::uint32_t> read_buttons(const TomlTable& table, const char* key) {
  if (!table.has(key)) return std::nullopt;
  std::uint32_t mask = 0;
  for (const double number : table.numbers(key, between(0, 31), 0, 32)) {
    if (number != std::floor(number)) table.fail(key, "expected button numbers: whole numbers from 0");
    mask |= 1u << static_cast<unsigned>(number);
  }
  return mask;
}

}  // namespace

DeviceSettings read_device_settings(const TomlTable& table) {
  DeviceSettings settings;
  settings.kind = table.choice_or("kind", device_names([](const DeviceRow& row) { return !row.reads_file; }),
                                  settings.kind);
  if (table.has("serial")) settings.serial = table.text("serial");
  settings.axes = read_axes(table);
  if (table.has("centre_m")) {
    const std::vector<double> centre = table.numbers("centre_m", between(-1, 1), 3, 3);
    settings.centre_m = Vec3(centre[0], centre[1], centre[2]);
  }
  settings.workspace_half_m = table.optional_number("workspace_half_m", between(0.005, 1));
  settings.deadman_buttons = read_buttons(table, "deadman_buttons");
  settings.clutch_buttons = read_buttons(table, "clutch_buttons");
  settings.stop_buttons = read_buttons(table, "stop_buttons");
  const std::uint32_t deadman = settings.deadman_buttons.value_or(0);
  const std::uint32_t clutch = settings.clutch_buttons.value_or(0);
  const std::uint32_t stop = settings.stop_buttons.value_or(0);
  if ((deadman & clutch) != 0 || (deadman & stop) != 0 || (clutch & stop) != 0)
    table.fail("stop_buttons",
               "a button is listed in two of deadman_buttons, clutch_buttons and stop_buttons");
  if (table.has("watchdog_ms")) settings.watchdog_ms = static_cast<int>(table.integer("watchdog_ms", 0, 31));
  settings.force_max_n = table.optional_number("force_max_n", between(0.1, 100));
  settings.damping_n_s_m = table.optional_number("damping_n_s_m", between(0, 1000));
  settings.latency_ms = table.optional_number("latency_ms", between(0, 100));
  if (settings.latency_ms && !settings.damping_n_s_m)
    table.fail("latency_ms", "needs damping_n_s_m as well: calibrate --dynamics measures both");
  settings.mass_kg = table.optional_number("mass_kg", between(1e-3, 100));
  settings.speed_m_s = table.optional_number("speed_m_s", between(0.001, 0.25));
  settings.hold_s = table.optional_number("hold_s", between(0.05, 10));
  settings.dead_zone = table.optional_number("dead_zone", between(0, 0.5));
  return settings;
}

PedalSettings read_pedal_settings(const TomlTable& table) {
  PedalSettings settings;
  settings.vendor = static_cast<std::uint16_t>(table.integer("vendor", 1, 65535));
  settings.product = static_cast<std::uint16_t>(table.integer("product", 0, 65535));
  settings.buttons.deadman = read_buttons(table, "deadman_buttons").value_or(0);
  settings.buttons.clutch = read_buttons(table, "clutch_buttons").value_or(0);
  settings.buttons.stop = read_buttons(table, "stop_buttons").value_or(0);
  if ((settings.buttons.deadman | settings.buttons.clutch | settings.buttons.stop) == 0)
    table.fail("stop_buttons",
               "no pedal has a function: give deadman_buttons, clutch_buttons or stop_buttons");
  return settings;
}

void describe(const DeviceSettings& settings, std::vector<std::pair<std::string, std::string>>& list) {
  const auto number = [&](const char* key, const auto& value) {
    if (value)
      list.emplace_back(std::string("device.") + key, fmt::format("{:.17g}", static_cast<double>(*value)));
  };
  const auto buttons = [&](const char* key, const std::optional<std::uint32_t>& mask) {
    if (!mask) return;
    std::string text;
    for (int i = 0; i < 32; ++i) {
      if ((*mask >> i & 1u) != 0) text += fmt::format("{}{}", text.empty() ? "" : " ", i);
    }
    list.emplace_back(std::string("device.") + key, text);
  };
  if (settings.serial) list.emplace_back("device.serial", *settings.serial);
  if (settings.axes)
    list.emplace_back("device.axes", fmt::format("{}", fmt::join(settings.axes->names(), " ")));
  if (settings.centre_m) {
    const Vec3& c = *settings.centre_m;
    list.emplace_back("device.centre_m", fmt::format("{:.17g} {:.17g} {:.17g}", c.x(), c.y(), c.z()));
  }
  number("workspace_half_m", settings.workspace_half_m);
  buttons("deadman_buttons", settings.deadman_buttons);
  buttons("clutch_buttons", settings.clutch_buttons);
  buttons("stop_buttons", settings.stop_buttons);
  number("watchdog_ms", settings.watchdog_ms);
  number("force_max_n", settings.force_max_n);
  number("mass_kg", settings.mass_kg);
  number("speed_m_s", settings.speed_m_s);
  number("hold_s", settings.hold_s);
  number("dead_zone", settings.dead_zone);
}

}  // namespace telenano::app
