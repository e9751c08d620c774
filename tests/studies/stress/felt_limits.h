#pragma once

#include <cstdint>
#include <limits>
#include <optional>

#include "tests/studies/fidelity/felt_metrics.h"
#include "tests/studies/stress/run_spec.h"

namespace telenano::studies::stress {

/// How near what is felt must be to the same sample felt without link and delay. Asked of calm runs only: a
/// task of an ordinary hand, at a scale within what is planned, over a link that delays and does nothing
/// else. There a force that is wrong is wrong for no reason. `none`, `tank`, `model`, `twin`; the others are
/// baselines that clamp or damp a calm touch, too.
struct FeltLimits {
  double nrmse = 0;                                           ///< at the lag that fits best
  double lag_ms = 0;                                          ///< of felt behind true,
  double lag_by = 0;                                          ///< give or take, ms
  double pull = std::numeric_limits<double>::infinity();      ///< relative error of the pull-off
  double lateral = -std::numeric_limits<double>::infinity();  ///< least correlation of the lateral force
};
/// Nothing: of this run no such thing is asked.
std::optional<FeltLimits> felt_limits(const RunSpec& spec) noexcept;

/// Invariant bits: felt, lateral, in-time, pull.
std::uint32_t felt_violations(const fidelity::FeltMetrics& felt, const FeltLimits& limits) noexcept;

}  // namespace telenano::studies::stress
