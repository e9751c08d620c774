#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "telenano/common/control/scaling_plan.h"

namespace telenano::control {

/// The plan of the force scale, kept while the session runs: for the methods whose touch is passive only as far as
/// the whole loop is (binding_delay_samples: `none`, `ks`), what was planned for one round trip is too stiff at a
/// longer one. The same planner makes a table of delays before the session; afterwards only the table is looked
/// at.
///
///   needed = samples of delay at rtt + 4 jitter     (what nearly every reply stays within, as of RFC 6298)
///   needed > 1.5 planned + 4, for kLower_s   → the scale for it, at once: a lower stiffness may come in contact
///   needed < 0.6 planned − 4, for kRaise_s   → the scale for it, when the tip is free and no force is felt: a
///                                              stiffness never rises under a hand that presses
///
/// A lower scale is come to by kStepFactor each kStep_s, lest the force drop at once.
/// In between nothing changes, lest a link that lies there change it again and again. The change itself is the
/// station's, and without a bump (Station::change_scaling).
class ScalingFollower {
 public:
  static constexpr double kLower_s = 0.5;
  static constexpr double kRaise_s = 3;
  static constexpr double kStep_s = 0.02;
  static constexpr double kStepFactor = 0.8;
  static constexpr int kMostDelay = 512;

  struct Entry {
    int delay_samples = 0;
    double force = 0;
  };
  struct Circumstances {
    double rtt_s = -1;  ///< smoothed; negative: not known
    double jitter_s = 0;
    bool at_rest = false;  ///< the tip touches nothing and no force is felt
  };

  /// Follows nothing.
  ScalingFollower() = default;
  /// `input`: as the session was planned, with the delay of that; `force`: what came of it. Allocates; may throw
  /// as plan_scaling().
  ScalingFollower(ScalingPlanInput input, double force)
      : planned_(std::max(1, input.plant.delay_samples)),
        period_s_(input.plant.period_s),
        force_(force),
        target_(force) {
    if (binding_delay_samples(input.method, kMostDelay) < kMostDelay) return;
    double next = 1;
    for (int delay = 1; delay <= kMostDelay; delay = static_cast<int>(std::ceil(next *= 1.3))) {
      input.plant.delay_samples = delay;
      const double planned = plan_scaling(input).scaling.force;
      if (!(planned >= kForceScaleLeast)) break;
      if (table_.empty() || table_.back().delay_samples < delay) table_.push_back({delay, planned});
    }
  }

  bool follows() const noexcept { return !table_.empty(); }
  double force() const noexcept { return force_; }                    ///< the scale to use now
  double target() const noexcept { return target_; }                  ///< that it goes to
  double planned_s() const noexcept { return planned_ * period_s_; }  ///< loop delay that it is for

  /// Once a tick, `dt_s` long. True: force() is another one.
  bool update(const Circumstances& c, double dt_s) noexcept {
    if (table_.empty()) return false;
    look(c, dt_s);
    since_step_s_ += dt_s;
    if (force_ == target_ || (force_ > target_ && since_step_s_ < kStep_s)) return false;
    force_ = std::max(target_, kStepFactor * force_);
    since_step_s_ = 0;
    return true;
  }

 private:
  static constexpr double kForceScaleLeast = 1;

  void look(const Circumstances& c, double dt_s) noexcept {
    const double answer_s = c.rtt_s + 4 * c.jitter_s;
    if (!(c.rtt_s >= 0) || !(answer_s < 1e3)) return;
    const int needed = loop_delay_samples(answer_s, period_s_);
    const bool lower = needed > 1.5 * planned_ + 4;
    const bool raise = needed < 0.6 * planned_ - 4;
    too_long_s_ = lower ? too_long_s_ + dt_s : 0;
    shorter_s_ = raise ? shorter_s_ + dt_s : 0;
    if (!(too_long_s_ >= kLower_s) && !(shorter_s_ >= kRaise_s && c.at_rest)) return;
    too_long_s_ = shorter_s_ = 0;
    const auto fits = [needed](const Entry& entry) { return entry.delay_samples >= needed; };
    const auto found = std::find_if(table_.begin(), table_.end(), fits);
    Entry chosen = found != table_.end() ? *found : table_.back();
    if (chosen.delay_samples < needed) {
      // Beyond the table: the bound falls with the square of the delay at most.
      const double shorter = (chosen.delay_samples + 1.0) / (needed + 1.0);
      chosen = {needed, std::max(kForceScaleLeast, chosen.force * shorter * shorter)};
    }
    planned_ = chosen.delay_samples;
    target_ = chosen.force;
  }

  std::vector<Entry> table_;
  int planned_ = 1;
  double period_s_ = 1e-3;
  double force_ = 0;
  double target_ = 0;
  double since_step_s_ = 0;
  double too_long_s_ = 0;
  double shorter_s_ = 0;
};

}  // namespace telenano::control
