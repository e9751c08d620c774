#pragma once

#include <array>
#include <cstdint>

#include "telenano/common/rt/latest_value.h"
#include "telenano/master/device/hand_motion.h"
#include "telenano/master/device/haptic_device.h"

namespace telenano::device {

/// What a mouse and keys say, stored by the viewer's thread at every frame, whether it has changed or not: a
/// viewer that stands still for longer than PointerConfig::silence_s lets go of the deadman.
struct PointerState {
  std::array<double, 3> hand_pos_h_m{};  ///< where the hand should be, frame H; kept inside the workspace
  std::uint32_t buttons = 0;             ///< ButtonBits
};

struct PointerConfig {
  HandMotionLimits motion{};
  double silence_s = 0.5;  ///< of the viewer, after which nobody is taken to hold the deadman
};

/// A device without force that has no damping nor mass either. Planned for as if it were an omega.3, so that
/// scales, pictures and recordings compare; the force that is asked for is not shown, and never counted.
DeviceInfo forceless_device_info(const char* name, double half_m);

/// The hand as a mouse in a window: goes smoothly, at bounded speed, where the newest PointerState says. No
/// force. A target that is not finite is not followed.
class PointerDevice final : public HapticDevice {
 public:
  /// `source` must outlive the device.
  explicit PointerDevice(const rt::LatestValue<PointerState>& source, const PointerConfig& config = {});

  const DeviceInfo& info() const noexcept override { return info_; }
  void advance(std::int64_t dt_ns) noexcept override;
  void read(DeviceReading& reading) noexcept override;
  Vec3 write_force(const Vec3& hand_force_h_n) noexcept override;

  /// As it was made: in the middle of its box, with nothing held until the source says so again.
  void start_anew() noexcept;

 private:
  const rt::LatestValue<PointerState>& source_;
  PointerConfig config_;
  DeviceInfo info_;
  SmoothHand hand_;
  Vec3 target_h_m_ = Vec3::Zero();
  std::uint32_t buttons_ = 0;
  std::uint64_t seen_ = 0;
  std::int64_t silent_ns_ = 0;
};

}  // namespace telenano::device
