#pragma once

#include <cstdint>
#include <string>

#include "telenano/common/base/vec3.h"

namespace telenano::device {

enum ButtonBits : std::uint32_t { kButtonClutch = 1u << 0, kButtonDeadman = 1u << 1, kButtonStop = 1u << 2 };

/// kForceOff: positions are good, the device shows no force. kHoming: not calibrated yet, positions mean
/// nothing. kFailed: neither positions nor forces can be relied on, and a person must look.
enum class DeviceStatus : std::uint8_t { kOk, kForceOff, kFailed, kHoming };

/// Why a device shows no force, or failed; the first seven as the devices themselves tell it.
enum class ForceOffCause : std::uint8_t {
  kNone,
  kButton,
  kVelocity,
  kWatchdog,
  kSoftware,
  kUsb,
  kDeadman,
  kUnknown,
  kNoPower,
  kUnplugged,
  kDeviceError,
};
/// One phrase for a person: what is the matter and what to do.
const char* force_off_text(ForceOffCause cause) noexcept;

struct DeviceReading {
  DeviceStatus status = DeviceStatus::kOk;
  ForceOffCause cause = ForceOffCause::kNone;  ///< when not kOk
  Vec3 hand_pos_h_m = Vec3::Zero();            ///< as the encoder sees it
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
  /// True when the hand moves by the clock on the wall; false when it moves by advance() alone, so that the
  /// time between two positions is what advance() was told.
  bool moves_by_itself = false;
};

/// Seam: a hand controller. Frame H: x to the right, y away from the operator, z up; origin in the
/// workspace's centre.
class HapticDevice {
 public:
  virtual ~HapticDevice() = default;
  virtual const DeviceInfo& info() const noexcept = 0;
  /// So much time has passed since the last call; called once a tick, before read(). For devices whose hand
  /// is simulated, replayed or integrated from velocities.
  virtual void advance(std::int64_t dt_ns) noexcept { static_cast<void>(dt_ns); }
  /// The newest that the device has said. Nobody reads between opening and the first tick, for a second and more:
  /// what a device has sent meanwhile must be skipped, or the hand seems to leap.
  virtual void read(DeviceReading& reading) noexcept = 0;
  /// Commands the force on the hand, held until the next call. Returns what is really applied (after
  /// saturation and command quantisation): that is what the energy observer must count.
  virtual Vec3 write_force(const Vec3& hand_force_h_n) noexcept = 0;
};

}  // namespace telenano::device
