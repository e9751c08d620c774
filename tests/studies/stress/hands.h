#pragma once

#include <memory>

#include "tests/studies/stress/run_spec.h"
#include "tests/studies/stress/stress_hand.h"

namespace telenano::studies::stress {

/// Where the ground is for a hand that begins at 0.
struct Ground {
  double wall_m = -0.005;       ///< height of the ground over the hand's start, along z; below 0
  double metres_per_nm = 1e-3;  ///< hand over tip
  double deepest_nm = 40;       ///< that a driven hand goes below the ground, of the tip
};

/// Phases of HandKind::kPress in a run of so many seconds: still, in, hold, out, still.
struct PressTimes {
  double down_s = 0.5;  ///< begins to go in
  double held_s = 1.5;  ///< is in
  double out_s = 0;     ///< begins to let go
  double free_s = 0;    ///< is out
};
PressTimes press_times(double seconds) noexcept;

/// Does the hand do what a person with a task does, so that force and drift are worth comparing?
bool is_task(HandKind kind) noexcept;
/// Is the motion given, whatever the force? Such hands are never faster than v_max.
bool is_driven(HandKind kind) noexcept;

/// The hand of a run. Of the climbing kinds: standing at the ground, what climbing begins with.
std::unique_ptr<StressHand> make_hand(const RunSpec& spec, const Ground& ground);

}  // namespace telenano::studies::stress
