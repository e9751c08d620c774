#pragma once

#include <cstdint>
#include <limits>
#include <optional>

#include "tests/studies/fidelity/felt_metrics.h"
#include "tests/studies/stress/run_spec.h"

namespace telenano::studies::stress {

/// How near what is felt must be to the same sample felt without link and delay. Asked of calm runs only: a
/// task of an ordinary hand, at a scale within what is planned, over a link that delays and does nothing
/// else; with `twin` over one that jitters and loses, too. There a force that is wrong is wrong for no reason. `ks`, `ks-clamp`, `tdpa` and `wave` are baselines
/// that clamp or damp a calm touch, too: of them only the share of the force that is felt is asked.
struct FeltLimits {
  static constexpr double kAny = std::numeric_limits<double>::infinity();
  double nrmse = kAny;               ///< at the lag that fits best
  double lag_ms = 0;                 ///< of felt behind true,
  double lag_by = kAny;              ///< give or take, ms
  double pull = kAny;                ///< relative error of the pull-off
  double lateral = -kAny;            ///< least correlation of the lateral force
  double lateral_share_low = -kAny;  ///< of the lateral force over the true one
  double lateral_share_high = kAny;  ///< likewise
  double share_low = -kAny;          ///< normal force that is felt over the true one, on level ground
  double share_high = kAny;          ///< likewise
};
/// Nothing: of this run no such thing is asked.
std::optional<FeltLimits> felt_limits(const RunSpec& spec) noexcept;

/// Invariant bits: felt, lateral, in-time, pull. Shares, of the normal force and of the lateral one: NaN where they mean nothing.
struct FeltShares {
  double normal = 0, lateral = 0;
};
std::uint32_t felt_violations(const fidelity::FeltMetrics& felt, const FeltShares& shares,
                              const FeltLimits& limits) noexcept;

/// How far the tip may stand from where the hand has led it, when both are at rest at a run's end, mm of the hand; whatever
/// the link has lost meanwhile. Nothing where the operator has acted, or where a position is not sent as it is.
/// The share of the sample's force that the hand must feel once what the operator does has long been felt: of calm runs with
/// acts, below what the device may show, on samples that are soft enough for that at every scale.
struct ShareLimits {
  double low = 0, high = 0;
};
std::optional<ShareLimits> share_limits_of_acts(const RunSpec& spec) noexcept;

std::optional<double> drift_limit_mm(const RunSpec& spec) noexcept;

}  // namespace telenano::studies::stress
