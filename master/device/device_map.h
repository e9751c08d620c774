#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/master/device/haptic_device.h"

namespace telenano::device {

/// How a device's own frame D lies in the operator's frame H: each hand axis is one device axis, forwards or
/// backwards, measured from the workspace's centre. Hand right, away and up stay a right-handed frame: a
/// mirrored map would show a mirrored sample.
class AxisMap {
 public:
  AxisMap() = default;  ///< parallel frames
  /// Names of the device axes that are the hand's x (right), y (away), z (up), e.g. {"+y", "-x", "+z"}.
  /// Throws UserError: one line that names what is wrong; `source` stands before it.
  static AxisMap parse(const std::array<std::string, 3>& names, const std::string& source);

  Vec3 to_hand(const Vec3& device_vec) const noexcept;  ///< directions: forces, velocities, displacements
  Vec3 to_device(const Vec3& hand_vec) const noexcept;
  std::array<std::string, 3> names() const;

 private:
  std::array<int, 3> axis_{0, 1, 2};     // hand axis i is device axis axis_[i] ...
  std::array<double, 3> sign_{1, 1, 1};  // ... times this
};

/// Which of a device's buttons (counted from 0) mean what at the station.
struct ButtonMap {
  std::uint32_t clutch = 0;  ///< masks of device buttons
  std::uint32_t deadman = 0;
  std::uint32_t stop = 0;

  std::uint32_t mapped(std::uint32_t pressed) const noexcept {
    return ((pressed & clutch) != 0 ? kButtonClutch : 0u) | ((pressed & deadman) != 0 ? kButtonDeadman : 0u) |
           ((pressed & stop) != 0 ? kButtonStop : 0u);
  }
};

/// One line of `telenano-master devices`.
struct FoundDevice {
  std::string backend;
  std::string name;
  std::string serial;
  std::string node;
  bool usable = false;
  std::string why;  ///< when not usable: what is the matter and what to do
};

}  // namespace telenano::device
