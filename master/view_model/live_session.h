#pragma once

#include <cstdint>

#include "telenano/common/link/messages.h"
#include "telenano/common/recording/sample.h"
#include "telenano/master/view_model/force_curve.h"
#include "telenano/master/view_model/ground.h"
#include "telenano/master/view_model/round_trips.h"
#include "telenano/master/view_model/strip.h"
#include "telenano/master/view_model/trail.h"

namespace telenano::view_model {

/// Is the sample a model or a real one? A reply's measurement age is 0 where the force was computed for its
/// command (PROTOCOL.md); one measured force makes the session a live one for good.
enum class Origin : std::uint8_t { kUnknown, kComputed, kMeasured };

/// What the screen keeps of a running session, made of the loop's samples.
class LiveSession {
 public:
  static constexpr double kWindowS = 10;
  static constexpr std::size_t kBins = 500;

  explicit LiveSession(double trail_step_nm);

  void take(const recording::Sample& sample, const Ground& ground);

  const recording::Sample& now() const noexcept { return now_; }
  bool any() const noexcept { return taken_ > 0; }
  std::uint64_t taken() const noexcept { return taken_; }

  /// Height of the apex above the ground under it; negative: indented, or an adhesive pull.
  double gap_nm() const noexcept { return gap_nm_; }
  bool contact() const noexcept;
  Origin origin() const noexcept { return origin_; }
  /// Where the scene's nanoparticle was seen last; radius 0: there is none.
  const link::Particle& particle() const noexcept { return particle_; }

  const Strip& gap() const noexcept { return gap_strip_; }
  const Strip& tip_force() const noexcept { return tip_force_; }          ///< nN, along z
  const Strip& raw_force() const noexcept { return raw_force_; }          ///< N, α_F times it
  const Strip& limited_force() const noexcept { return limited_force_; }  ///< N, what was sent to the device
  const Strip& applied_force() const noexcept { return applied_force_; }  ///< N, what the device applied
  const Strip& energy() const noexcept { return energy_; }  ///< mJ, of the observer, put in by the hand
  const Strip& damper() const noexcept { return damper_; }  ///< N·s/m
  const RoundTrips& round_trips() const noexcept { return round_trips_; }
  const Trail& trail() const noexcept { return trail_; }
  const TouchedGround& touched() const noexcept { return touched_; }
  const ForceCurve& force_curve() const noexcept { return force_curve_; }

  /// Tip force at which the cone has its full length: 2 or 5 or 10 … nN, not less than what was felt in the
  /// window.
  double force_full_nn() const noexcept;
  /// Likewise of the lever's deflection, in nm, at least 0.2.
  double deflection_full_nm() const noexcept;

 private:
  recording::Sample now_{};
  std::uint64_t taken_ = 0;
  double gap_nm_ = 0;
  Origin origin_ = Origin::kUnknown;
  std::int64_t reply_seen_ = 0;
  link::Particle particle_;
  Strip gap_strip_;
  Strip tip_force_;
  Strip force_size_;
  Strip deflection_size_;
  Strip raw_force_;
  Strip limited_force_;
  Strip applied_force_;
  Strip energy_;
  Strip damper_;
  RoundTrips round_trips_;
  Trail trail_;
  TouchedGround touched_;
  ForceCurve force_curve_;
};

}  // namespace telenano::view_model
