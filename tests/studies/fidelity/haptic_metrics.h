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
/// kJudgedN²: below that two forces count as one. (The paper weighs changes by a rule of its own, which is not
/// in the text that we have: its numbers and ours are not to be compared.)
///
/// *At a perceptual deadband* (Weber, as the kinesthetic codec of IEEE 1918.1.1 without delay has it): a sample of
/// the force is sent where it differs from the last one that was sent by more than kWeber of that; the
/// receiver holds the last one. Of the true force: which part of the samples that sends, and how wrong what is
/// held is. Where the force is next to nothing, kJudgedN is the least deadband: of nothing 10 % is nothing.
struct HapticMetrics {
  static constexpr double kWeber = 0.1;
  double effective_delay_ms = FeltMetrics::kNone;
  double effective_nrmse = FeltMetrics::kNone;
  double weber_sent_share = FeltMetrics::kNone;
  double weber_nrmse = FeltMetrics::kNone;
  /// The greatest attraction before the first contact, true and felt: a hand notices it from
  /// control::kNoticedForceN on. None where nothing is touched.
  double approach_true_n = FeltMetrics::kNone, approach_felt_n = FeltMetrics::kNone;
};

/// `delay_max_s`: the longest delay that is looked at.
HapticMetrics measure_haptic(const TouchTrace& trace, double delay_max_s);

/// d of each tick; `cost`: the sum that is least.
std::vector<std::size_t> effective_delays(std::span<const TouchTrace::Row> rows, std::size_t most,
                                          double change_n2, double& cost);

}  // namespace telenano::studies::fidelity
