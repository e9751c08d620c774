#pragma once

#include <string>
#include <vector>

#include "tests/studies/stress/table.h"

namespace telenano::studies::stress {

/// How often a method broke a promise in a sample, over all (feature and value empty) or in the runs of one kind.
struct SampledRate {
  control::Method method = control::Method::kNone;
  std::string feature, value;
  std::size_t runs = 0, broken = 0;
  double low = 0, high = 1;  ///< of the rate, 95 % (Clopper and Pearson)
};
std::vector<SampledRate> sampled_rates(const std::vector<Row>& rows);

/// What a sample says (`stress --sample`, whose runs are independent draws): for each method, over all and in
/// each kind of scene, hand, act, fault and link, how many runs there were, how many broke a promise, and the
/// bounds of the rate at 95 % by Clopper and Pearson. CSV, a line each.
std::string sampled_bounds_csv(const std::vector<Row>& rows);

}  // namespace telenano::studies::stress
