#pragma once

#include <cmath>

#include "telenano/common/control/method.h"

namespace telenano::control {

/// What a choice of method goes by.
struct MethodCircumstances {
  double rtt_s = -1;      ///< smoothed round trip; negative or not finite: not known
  double jitter_s = 0;    ///< its mean deviation
  bool at_rest = false;   ///< the tip touches nothing and no force is felt: a change cannot be felt either
  bool twin = false;      ///< the station runs the server's own scene, step by step
  bool measures = false;  ///< the slave's force is measured by an instrument, not computed
};

/// Which method when, for an operator who has not said. Of the methods that promise energy:
///
///   answer = rtt + 4 jitter      (what nearly every reply stays within, as of RFC 6298)
///   a twin             → `twin`: the sample itself, without the link's delay
///   a measuring slave  → `model`
///   answer ≤ kNear_s   → `tank`: the newest reply of the sample itself
///   answer > kFar_s    → `model`: a plane of what the sample was like, without the link's delay
///   between, unknown   → as before; `model` after a twin
///
/// A plane is right for a flat, linear wall at any delay, and wrong for adhesion that is stretched, a rough
/// ground, a groove; the newest reply is right for all of them, but late. telenano-lab fidelity, 15 motions
/// over the scenes that come with the project (--rtt 0,2,4,8,16 --loss 0), NRMSE of the force, geometric mean
/// of `tank` : `model`:
/// 0.027 : 0.056 at a round trip of 0, 0.037 : 0.062 at 2 ms, 0.053 : 0.071 at 4 ms, 0.078 : 0.079 at 8 ms,
/// 0.13 : 0.09 at 16 ms; the worst motion 0.05 : 0.31 at 0. So they cross at 8 ms; between 4 and 8 ms, where
/// neither is much better, nothing changes, lest a link that lies there change it again and again.
///
/// The twin's felt force is the sample's at every round trip at which the session holds: nothing felt waits
/// for the link. One that is given up is gone at once: the station shows `model` in that tick
/// (Station::usable), and the rule goes on from there.
///
/// What an instrument answers is of some milliseconds ago, however near it is. `tank` pays for that with the
/// energy that the hand has put in, and has less to show with each press.
///
/// A wish must have held for kHold_s, and waits until the tip is free: the force then has nothing to go over
/// from. All these methods plan with the same delay (binding_delay_samples), so that no scale changes with
/// them.
class MethodChoice {
 public:
  static constexpr double kNear_s = 0.004;
  static constexpr double kFar_s = 0.008;
  static constexpr double kHold_s = 1.0;

  explicit MethodChoice(Method now = Method::kModel) noexcept : now_(now) {}

  /// For a session that begins: at once.
  static Method at_start(const MethodCircumstances& c) noexcept { return wanted(c, Method::kModel); }

  /// Once a tick, `dt_s` long; the method to use from now on.
  Method update(const MethodCircumstances& c, double dt_s) noexcept {
    if (now_ == Method::kTwin && !c.twin) now_ = Method::kModel;
    const Method want = wanted(c, now_);
    held_s_ = want != now_ && want == want_ ? held_s_ + dt_s : 0;
    want_ = want;
    if (want != now_ && held_s_ >= kHold_s && c.at_rest) {
      now_ = want;
      held_s_ = 0;
    }
    return now_;
  }
  Method now() const noexcept { return now_; }

 private:
  static Method wanted(const MethodCircumstances& c, Method before) noexcept {
    if (c.twin) return Method::kTwin;
    if (c.measures) return Method::kModel;
    const double answer_s = c.rtt_s + 4 * c.jitter_s;
    if (!(c.rtt_s >= 0) || !std::isfinite(answer_s)) return before;
    if (answer_s <= kNear_s) return Method::kTank;
    return answer_s > kFar_s ? Method::kModel : before;
  }

  Method now_;
  Method want_ = Method::kModel;
  double held_s_ = 0;
};

}  // namespace telenano::control
