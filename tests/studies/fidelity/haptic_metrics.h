#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "tests/studies/fidelity/felt_metrics.h"

namespace telenano::studies::fidelity {

/// What haptic communication measures a link by, beside the measures of felt_metrics.h.
///
/// *Effective delay and effective RMSE*, in the manner of ETVO (Kroep, Gokhale, Verburg, Venkatesha Prasad,
/// "ETVO: Effectively Measuring Tactile Internet With Experimental Validation"): dynamic time warping, of which
/// each felt tick has one true tick that it shows. What is felt at tick i is what was true d(i) ticks before;
/// the order is kept, d(i+1) ≤ d(i) + 1, nothing is felt before it is true, 0 ≤ d, and a change of d costs. Of
/// all such d the one of
///
///   least Σ |felt(i) − true(i − d(i))|² + w Σ |d(i+1) − d(i)|
///
/// The effective delay is the mean of d, the effective NRMSE what is left of the difference, over the ticks of
/// FeltMetrics' window. A constant delay is found as it is; a loss is a delay that grows and comes back. w is
/// kJudgedN²: below that two forces count as one. The effective delay derivative is the mean of |d(i+1) − d(i)|:
/// 0 where the delay stays. (Of the paper and of the one before it, "Setting the Yardstick", Verburg, Kroep, Gokhale,
/// Venkatesha Prasad, Rao, which names an "effective delay-derivative" and an "effective root mean square error",
/// only the abstracts could be read. What they add to time warping is not known from these: their numbers and
/// ours are not to be compared.)
///
/// Warping makes time of what is value: a force that is felt 0.1 N too strong is one that is felt earlier or later,
/// wherever a better one is near. Hence beside it *one alignment of the whole motion* (Alignment): a time
/// offset, a gain and a value offset that stay.
///
/// *At a perceptual deadband* (Weber, as the kinesthetic codec of IEEE 1918.1.1 without delay has it): a sample of
/// the force is sent where it differs from the last one that was sent by more than kWeber of that; the
/// receiver holds the last one. Of the true force: which part of the samples that sends, and how wrong what is
/// held is. Where the force is next to nothing, kJudgedN is the least deadband: of nothing 10 % is nothing.
struct HapticMetrics {
  static constexpr double kWeber = 0.1;
  double effective_delay_ms = FeltMetrics::kNone;
  double effective_delay_derivative = FeltMetrics::kNone;
  double effective_nrmse = FeltMetrics::kNone;
  /// Of Alignment, with the value offset's length.
  double time_offset_ms = FeltMetrics::kNone, value_gain = FeltMetrics::kNone,
         value_offset_n = FeltMetrics::kNone;
  double weber_sent_share = FeltMetrics::kNone;
  double weber_nrmse = FeltMetrics::kNone;
  /// The greatest attraction before the first contact, true and felt: a hand notices it from
  /// control::kNoticedForceN on. None where nothing is touched.
  double approach_true_n = FeltMetrics::kNone, approach_felt_n = FeltMetrics::kNone;
};

/// `delay_max_s`: the longest delay that is looked at.
HapticMetrics measure_haptic(const TouchTrace& trace, double delay_max_s);

/// felt(i) = gain · true(i − ticks) + offset_n, with the least squares over the ticks of FeltMetrics' window, its
/// least mean of all delays from 0 to the most. A delay that covers less than half of the rows is not looked at.
/// Of a true force that never changes by more than kJudgedN (RMS) there is no gain: 1, and no delay: 0. A
/// gain of nothing or less says that the two are not alike, with any delay.
struct Alignment {
  std::size_t ticks = 0;
  double gain = 1;
  Vec3 offset_n = Vec3::Zero();
  double left_n = 0;  ///< RMS of what is left
  bool found = false;
};
Alignment align(std::span<const TouchTrace::Row> rows, std::size_t most);

/// d of each tick; `cost`: the sum that is least.
std::vector<std::size_t> effective_delays(std::span<const TouchTrace::Row> rows, std::size_t most,
                                          double change_n2, double& cost);

}  // namespace telenano::studies::fidelity
