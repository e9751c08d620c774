#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "telenano/master/device/haptic_device.h"
#include "telenano/master/device/played_motion.h"

namespace telenano::device {

/// The hand's motion of a recording: one point a recorded tick, times rising strictly from 0.
struct HandTrack {
  struct Point {
    double time_s = 0;
    Vec3 hand_pos_h_m = Vec3::Zero();
    std::uint32_t buttons = 0;
  };
  std::vector<Point> points;

  /// Throws UserError, `source` first, when there is nothing to play or what is there is no motion.
  void validate(const std::string& source) const;
};

/// A recorded hand, played again: on a line between the recorded points, held where they end. It yields to no
/// force, like a hand of stone; the force is taken for applied up to that of an omega.3, so that the energy
/// account is that of such a hand. It waits while the tip is held (TipSeen), as the person would have, and in a
/// tick that is more than 50 ms late. A stop that was pressed then is not pressed again: it ended that session.
class ReplayDevice final : public HapticDevice, public PlayedMotion {
 public:
  explicit ReplayDevice(HandTrack track, const std::string& source = "replay");

  const DeviceInfo& info() const noexcept override { return info_; }
  void advance(std::int64_t dt_ns) noexcept override;
  void read(DeviceReading& reading) noexcept override;
  Vec3 write_force(const Vec3& hand_force_h_n) noexcept override;

  void start_motion() noexcept override { started_ = true; }
  bool motion_started() const noexcept override { return started_; }
  double motion_time_s() const noexcept override { return static_cast<double>(motion_ns_) * 1e-9; }
  double motion_duration_s() const noexcept override { return track_.points.back().time_s; }
  void see_tip(const TipSeen& seen) noexcept override { held_ = seen.held; }

 private:
  HandTrack track_;
  DeviceInfo info_;
  bool started_ = false;
  bool held_ = false;
  std::int64_t motion_ns_ = 0;
  std::size_t at_ = 0;  // the last point that is not in the future
};

}  // namespace telenano::device
