#pragma once

#include <array>
#include <vector>

#include "tests/studies/stress/invariants.h"
#include "tests/studies/stress/table.h"

namespace telenano::studies::stress {

/// What all runs of a method say together.
struct MethodSummary {
  control::Method method = control::Method::kModel;
  std::size_t runs = 0, broken = 0, survived = 0, stopped = 0, too_fast = 0, repeated = 0;
  std::array<std::size_t, kInvariants> violated{};
  double most_extracted_mj = 0;
  double least_margin_mj = 1e300;
  double most_allowed_mj = 0;  ///< promise, without Q and late ticks
  double slowest_recovery_s = -1;
  double most_tip_nn = 0, most_over_force = 0;
  std::int64_t ticks = 0;
  double simulated_s = 0;
  std::int64_t clamp_ticks = 0, limit_ticks = 0, stop_ticks = 0;

  /// The highest rate of broken promises that is compatible with what was seen at 95 %, were the runs
  /// independent trials (binomial_bounds.h); with none among N it is just below 3/N. A profile's runs are a
  /// grid, no sample: for them it is a measure of how many there are, not a bound of a probability.
  double rate_at_most() const noexcept;
};
std::vector<MethodSummary> summarise(const std::vector<Row>& rows);

/// Apart from scene, hand, round trip and loss nothing but the method is special in it.
bool is_plain(const RunSpec& spec) noexcept;

}  // namespace telenano::studies::stress
