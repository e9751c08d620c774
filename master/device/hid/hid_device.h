#pragma once

#include <cstdint>

#include "telenano/common/rt/latest_value.h"
#include "telenano/master/device/device_map.h"
#include "telenano/master/device/hand_motion.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/device/hid/hid_reader.h"

namespace telenano::device {

struct HidConfig {
  /// The makers' frame: x to the right, y towards the operator, z down.
  AxisMap axes = AxisMap::parse({"+x", "-y", "-z"}, "default");
  ButtonMap buttons{0, 1u << 0, 1u << 1};  ///< left: deadman, right: stop
  double speed_m_s = 0.05;                 ///< of the virtual hand with the puck at its stop
  double full_scale = 350;                 ///< reading there
  double dead_zone = 0.05;                 ///< of full scale: a puck at rest is not always at zero
  double hold_s = 0.5;                     ///< a motion of which nothing more is heard for so long ends
  HandMotionLimits motion{};
};

/// A SpaceMouse as a hand without force: its deflection is a velocity of the hand, while the deadman is held.
///
/// Safe by these rules. Motion needs the deadman, whatever the station asks for: some pucks fall silent when
/// they are held still, so silence alone says nothing; and a motion of which nothing is heard for `hold_s`
/// ends all the same (a receiver whose puck has left keeps its last word). A stop pressed and released
/// between two ticks counts. A device that has gone is failed, for good: its buttons are not believed any
/// more, and after plugging it in again a person starts again. With the deadman released the hand goes back
/// to the middle, slowly, so that the next grip has room on every side: the tip does not follow then.
///
/// A force holds the hand back: against the force that a hand with motors would get, the speed is divided by
/// 1 + |F|/F½; along it and across it is whole. So the hand never goes faster than the puck says.
class HidDevice final : public HapticDevice {
 public:
  /// Throws UserError when no button is the deadman or a number is out of its range. `news` must outlive the
  /// device.
  HidDevice(const rt::LatestValue<HidNews>& news, const HidConfig& config);

  const DeviceInfo& info() const noexcept override { return info_; }
  void advance(std::int64_t dt_ns) noexcept override;
  void read(DeviceReading& reading) noexcept override;
  Vec3 write_force(const Vec3& hand_force_h_n) noexcept override;

 private:
  Vec3 wanted_velocity_h_m_s() const noexcept;
  Vec3 resisted(const Vec3& velocity_h_m_s) const noexcept;

  const rt::LatestValue<HidNews>& source_;
  HidConfig config_;
  DeviceInfo info_;
  HidNews news_{};
  bool begun_ = false;  // presses before the first look are none of ours
  bool stop_pressed_ = false;
  std::int64_t silent_ns_ = 0;
  Vec3 target_h_m_ = Vec3::Zero();
  Vec3 force_h_n_ = Vec3::Zero();  // that a hand with motors would get
  SmoothHand hand_;
};

}  // namespace telenano::device
