#pragma once

#include "telenano/master/station/station.h"
#include "tests/studies/stress/run_spec.h"
#include "tests/studies/stress/stress_hand.h"

namespace telenano::studies::stress {

/// What an operator does while the tip touches, by the very functions that window and buttons call: every
/// kActEveryS, whatever the hand does meanwhile.
///
///   scale      nanometres five times as large in the hand and forces five times as strong, and back: the
///              same impedance, which the window's sliders allow at any time
///   impedance  forces at three tenths, and back
///   method     through the methods that promise energy, the run's own first
///   clutch     let go for kClutchS and taken up again
///   stop       stopped, and cleared after kClutchS
class OperatorActs {
 public:
  static constexpr double kActEveryS = 0.7;
  static constexpr double kClutchS = 0.2;
  static constexpr double kRescale = 5;
  static constexpr double kWeaker = 0.3;

  OperatorActs(const RunSpec& spec, station::Station& station, StressHand& hand);

  /// Before a tick at `t_s` of the hand's motion.
  void step(double t_s) noexcept;

  /// Of all scales that the run has, hand joules for an attojoule of the sample, over those at the beginning.
  static double most_energy_scale(Act act) noexcept { return act == Act::kScale ? kRescale * kRescale : 1; }
  /// Likewise the least impedance.
  static double least_impedance(Act act) noexcept { return act == Act::kImpedance ? kWeaker : 1; }

 private:
  void change_scale(double velocity, double force) noexcept;

  Act act_;
  control::Method method_;
  control::Scaling scaling_;
  station::Station& station_;
  StressHand& hand_;
  int done_ = 0;
};

}  // namespace telenano::studies::stress
