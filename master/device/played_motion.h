#pragma once

#include <cstdint>

#include "telenano/master/device/task_change.h"

namespace telenano::device {

/// A program that was kept from running for longer has led no hand meanwhile. Half of what makes a station
/// hold (limits.stale_zero_s, 0.1 s): from then on the tip would not have followed.
inline constexpr std::int64_t kLongestTickNs = 50'000'000;

/// Which of its motions a hand plays.
struct TaskState {
  int task = 0;
  bool changing = false;  ///< on its way to the beginning
  double time_s = 0;
  double duration_s = 0;  ///< infinite: until another is chosen
};

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

  /// Of a hand that knows several: lets go of what it does and begins another, or the same anew (TaskChange).
  /// False, and nothing changes, for one that it does not know, or that does not fit into the device's box at
  /// the scale that was seen last.
  virtual bool begin_task(int) noexcept { return false; }
  virtual TaskState task() const noexcept { return {0, false, motion_time_s(), motion_duration_s()}; }
  /// Once a tick, before advance().
  virtual void see_tip(const TipSeen&) noexcept {}
};

}  // namespace telenano::device
