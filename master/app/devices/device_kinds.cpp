#include "telenano/master/app/devices/device_kinds.h"

#include "telenano/common/base/error.h"

namespace telenano::app {

static_assert(
    [] {
      for (std::size_t i = 0; i < kDeviceRows.size(); ++i) {
        if (kDeviceRows[i].kind != static_cast<DeviceKind>(i)) return false;
      }
      return true;
    }(),
    "the rows stand in the order of DeviceKind");

const DeviceRow& device_row(DeviceKind kind) noexcept {
  return kDeviceRows[static_cast<std::size_t>(kind)];
}

std::string choices_text(const std::vector<std::string>& names) {
  std::string text = "{";
  for (const std::string& name : names) text += (text.size() > 1 ? "," : "") + name;
  return text + "}";
}

std::string any_of_text(const std::vector<std::string>& names) {
  if (names.empty()) return "none";
  std::string text = names.front();
  for (std::size_t i = 1; i < names.size(); ++i) text += (i + 1 < names.size() ? ", " : " or ") + names[i];
  return text;
}

DeviceSpec parse_device_spec(const std::string& text) {
  for (const DeviceRow& row : kDeviceRows) {
    if (!row.reads_file && text == row.name) return {row.kind, ""};
    const std::string start = std::string(row.name) + ":";
    if (row.reads_file && text.starts_with(start) && text.size() > start.size())
      return {row.kind, text.substr(start.size())};
  }
  throw UserError("--device " + text + ": unknown device, expected " +
                  any_of_text(device_names([](const DeviceRow&) { return true; })));
}

}  // namespace telenano::app
