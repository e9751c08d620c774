#pragma once

#include <cstdint>

#include "telenano/common/base/vec3.h"

namespace telenano::device {

/// What the operator sees of the tip before a tick.
struct TipSeen {
  Vec3 target_nm = Vec3::Zero();  ///< x, y from where the session starts, z above the surface there
  double metres_per_nm = 1e-3;    ///< hand over tip, 1/(α_v·1e9), as it is now
  bool engaged = false;           ///< the tip follows the hand
  bool held = false;              ///< it did, and will again as soon as the server is heard of
};

/// How a simulated operator goes from the middle of one task to the beginning of another: he presses the
/// clutch, so that the tip stands and the force is gone, takes the hand to where the way back fits into the
/// device's box, takes hold again, lifts the tip straight up, and only then goes over to the start. What does
/// not fit into one stroke takes several. It goes by what the operator sees of the tip, so it also finds the
/// start after a stop has withdrawn the tip, or after another scale. A hold that is lost on the way (a stop,
/// a silent server) begins a new stroke when it is back.
class TaskChange {
 public:
  /// `start_pos_h_m`: hand at which a task begins; `start_height_nm`: the tip's height there.
  TaskChange(const Vec3& start_pos_h_m, double start_height_nm, const Vec3& half_m) noexcept
      : start_h_m_(start_pos_h_m), start_height_nm_(start_height_nm), half_m_(half_m) {}

  /// From the intention where the hand is now.
  void begin(const Vec3& intended_h_m) noexcept;
  void see(const TipSeen& seen) noexcept { seen_ = seen; }
  void advance(double dt_s) noexcept;

  bool active() const noexcept { return phase_ != Phase::kNone; }
  bool clutch() const noexcept { return phase_ == Phase::kReach || phase_ == Phase::kSettle; }
  const Vec3& intended_pos_h_m() const noexcept { return pos_h_m_; }

 private:
  enum class Phase : std::uint8_t { kNone, kReach, kSettle, kGrip, kLift, kOver };
  void enter(Phase phase, const Vec3& to_h_m, double speed_m_s) noexcept;
  void next() noexcept;
  Vec3 wanted_h_m() const noexcept;

  Vec3 start_h_m_;
  double start_height_nm_;
  Vec3 half_m_;
  TipSeen seen_{};
  Phase phase_ = Phase::kNone;
  Vec3 from_h_m_ = Vec3::Zero();
  Vec3 to_h_m_ = Vec3::Zero();
  Vec3 pos_h_m_ = Vec3::Zero();
  double phase_s_ = 0;
  double elapsed_s_ = 0;
};

}  // namespace telenano::device
