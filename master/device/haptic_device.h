#pragma once

#include <cstdint>
#include <string>

#include "common/base/vec3.h"

namespace telenano::device {

enum ButtonBits : std::uint32_t { kButtonClutch = 1u << 0, kButtonDeadman = 1u << 1, kButtonStop = 1u << 2 };

enum class DeviceStatus : std::uint8_t { kOk, kForceOff, kFailed };

struct DeviceReading {
  DeviceStatus status = DeviceStatus::kOk;
  Vec3 hand_pos_h_m = Vec3::Zero();  ///< as the encoder sees it
  std::uint32_t buttons = 0;
};

/// What the station must know of a device to plan scaling and to keep its limits.
struct DeviceInfo {
  std::string name;
  double force_max_n = 0;
  double position_quantum_m = 0;
  double damping_n_s_m = 0;       ///< certain, per axis
  double mass_kg = 0;             ///< apparent, per axis
  double workspace_radius_m = 0;  ///< half the edge of the largest cube in the workspace
  bool has_force = true;
};

/// Seam: a hand controller. Frame H: x to the right, y away from the operator, z up; origin in the
/// workspace's centre.
class HapticDevice {
 public:
  virtual ~HapticDevice() = default;
  virtual const DeviceInfo& info() const noexcept = 0;
  virtual void read(DeviceReading& reading) noexcept = 0;
  /// Commands the force on the hand, held until the next call. Returns what is really applied (after
  /// saturation and command quantisation): that is what the energy observer must book.
  virtual Vec3 write_force(const Vec3& hand_force_h_n) noexcept = 0;
};

}  // namespace telenano::device
