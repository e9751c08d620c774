#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>

#include "telenano/master/station/station.h"
#include "tests/studies/stress/run_spec.h"
#include "tests/studies/stress/stress_hand.h"
#include "tests/support/virtual_session.h"

namespace telenano::studies::stress {

/// What an operator does while the tip touches, by the very functions that window and buttons call: every
/// kActEveryS, whatever the hand does meanwhile.
///
///   scale      nanometres five times as large in the hand and forces five times as strong, and back: the
///              same impedance, which the window's sliders allow at any time
///   impedance  forces at three tenths, and back; where the scale is a planned one, each time after five times as
///              strong ones were asked for, which the station refuses as it would not be passive
///   method     through the methods that promise energy, the run's own first
///   clutch     let go for kClutchS and taken up again
///   stop       stopped, and cleared after kClutchS
///   task       another task: the hand goes on to it from where it is (hands.cpp), and the station's companding is
///              that of another task
///   take-over  of a shared tip: another operator takes it, leads it aside, and gives it back after kClutchS
class OperatorActs {
 public:
  static constexpr double kActEveryS = 0.7;
  static constexpr double kClutchS = 0.2;
  static constexpr double kRescale = 5;
  static constexpr double kWeaker = 0.3;
  static constexpr double kTooStrong = 5;
  static constexpr double kTaskGain = 5;

  OperatorActs(const RunSpec& spec, support::VirtualSession& session, StressHand& hand);

  /// Before a tick at `t_s` of the hand's motion.
  void step(double t_s) noexcept;

  /// Of all scales that the run has, hand joules for an attojoule of the sample, over those at the beginning.
  static double most_energy_scale(Act act) noexcept { return act == Act::kScale ? kRescale * kRescale : 1; }
  /// Likewise the least impedance.
  static double least_impedance(Act act) noexcept { return act == Act::kImpedance ? kWeaker : 1; }
  /// The greatest companding that the run has.
  static double most_gain(const RunSpec& spec) noexcept {
    return spec.act == Act::kTask ? std::max(spec.compand, kTaskGain) : spec.compand;
  }
  /// Another operator's part of the tick, after the session's own.
  void step_rival(int periods) {
    if (rival_) rival_->step(periods);
  }

  /// What the operator has chosen, as far as it was not refused.
  const control::Scaling& scaling() const noexcept { return chosen_; }
  /// Scale, method or task were changed before this tick.
  bool changed_now() const noexcept { return changed_now_; }
  bool rescaled_now() const noexcept { return rescaled_now_; }
  /// The other operator has the shared tip, and nobody has asked for it yet.
  bool rival_has_tip() const noexcept {
    return rivals_turn_ && rival_->client().has_reply() && rival_->client().reply().tip.hold != 0;
  }
  /// So long ago was the last act, and the end of what it holds.
  double quiet_s(double t_s) const noexcept;
  /// Stopped and not cleared yet.
  bool stopped() const noexcept { return stopped_; }
  /// A scale that cannot be passive was accepted.
  bool accepted_too_stiff() const noexcept { return accepted_too_stiff_; }

  /// Changes of scale that the station refused, as it does beyond what is passive.
  std::int64_t refused() const noexcept { return refused_; }
  /// A refusal must leave everything as it was.
  bool refusal_changed_something() const noexcept { return refusal_changed_; }
  /// Of a shared tip: how often it became another's, and this station's again.
  std::int64_t handed_over() const noexcept { return handed_over_; }

 private:
  void change_scale(double velocity, double force) noexcept;
  bool too_stiff(const control::Scaling& scaling) const noexcept;

  void take_over(bool rival) noexcept;

  RunSpec spec_;
  Act act_;
  control::Method method_;
  control::Scaling scaling_, chosen_;
  support::VirtualSession& session_;
  station::Station& station_;
  StressHand& hand_;
  std::unique_ptr<support::VirtualSession> rival_;  // another operator of the same tip
  bool rivals_turn_ = false;
  int done_ = 0;
  bool held_ = true;
  std::int64_t refused_ = 0;
  bool refusal_changed_ = false;
  bool changed_now_ = false, rescaled_now_ = false, stopped_ = false, accepted_too_stiff_ = false;
  std::int64_t handed_over_ = 0;
};

}  // namespace telenano::studies::stress
