#pragma once

namespace telenano::device {

/// Seam: a hand that plays a motion of known length (simulated, recorded) instead of a person's. Until it is
/// started it holds still.
class PlayedMotion {
 public:
  virtual ~PlayedMotion() = default;
  /// The session is up and engaged: the motion begins.
  virtual void start_motion() noexcept = 0;
  virtual bool motion_started() const noexcept = 0;
  virtual double motion_time_s() const noexcept = 0;
  virtual double motion_duration_s() const noexcept = 0;
  bool motion_done() const noexcept { return motion_time_s() >= motion_duration_s(); }
};

}  // namespace telenano::device
