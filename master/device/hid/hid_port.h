#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "telenano/master/device/device_map.h"

namespace telenano::device {

/// Seam: an open HID device, as a source of reports. Used by one thread.
class HidPort {
 public:
  virtual ~HidPort() = default;
  /// The next report, at most `timeout_ms` from now: its bytes, 0 when none came, negative when the device is
  /// gone.
  virtual int read(std::span<std::uint8_t> report, int timeout_ms) noexcept = 0;
};

struct HidChoice {
  std::optional<std::string> serial;  ///< which one, when several are attached
};

/// Opens a SpaceMouse through the kernel's hidraw nodes. `description` is told what was opened. Throws
/// RunError or UserError: one line with what to do; UserError where this build has no HID.
std::unique_ptr<HidPort> open_puck(const HidChoice& choice, std::string& description);

/// Opens foot pedals by their vendor and product, in the same way.
std::unique_ptr<HidPort> open_pedals(std::uint16_t vendor, std::uint16_t product, std::string& description);

/// Every SpaceMouse attached, opened and closed to see whether it can be.
std::vector<FoundDevice> find_pucks();

}  // namespace telenano::device
