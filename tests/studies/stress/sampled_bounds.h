#pragma once

#include <string>
#include <vector>

#include "tests/studies/stress/table.h"

namespace telenano::studies::stress {

/// What a sample says (`stress --sample`, whose runs are independent draws): for each method, over all and in
/// each kind of scene, hand, act, fault and link, how many runs there were, how many broke a promise, and the
/// bounds of the rate at 95 % by Clopper and Pearson. CSV, a line each.
std::string sampled_bounds_csv(const std::vector<Row>& rows);

}  // namespace telenano::studies::stress
