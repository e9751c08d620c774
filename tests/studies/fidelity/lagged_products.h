#pragma once

#include <cstddef>
#include <vector>

#include "tests/studies/fidelity/felt_metrics.h"

namespace telenano::studies::fidelity {

/// Σ felt(k)·true(k − lag) over the rows that both have, N², for each lag from −ahead to reach in ticks, in this
/// order. Each sum has the bits of the plain loop over k, row by row.
std::vector<double> lagged_products(const TouchTrace& trace, std::ptrdiff_t ahead, std::ptrdiff_t reach);

}  // namespace telenano::studies::fidelity
