#pragma once

#include <cstdint>
#include <optional>

#include "telenano/common/recording/sample.h"
#include "telenano/common/recording/summary.h"
#include "telenano/common/rt/log_histogram.h"

namespace telenano::recording {

/// What the rows themselves do not say.
struct SummaryContext {
  double rate_hz = 0;                    ///< 0: not known, then missed ticks are not counted
  std::optional<double> surface_z_w_nm;  ///< under the start
};

/// Gathers a Summary row by row in fixed memory (20 kB), without allocating, so that it can run in the loop.
/// Rows come in the order of time; a gap in their ticks is allowed.
class SummaryBuilder {
 public:
  explicit SummaryBuilder(const SummaryContext& context = {}) noexcept : context_(context) {}

  void add(const Sample& sample) noexcept;
  /// May be called at any time; `rows_dropped` and `cut_short` belong to the recorder and are left alone.
  Summary finish() const noexcept;

 private:
  void add_contact(const Sample& sample) noexcept;
  void add_hand(const Sample& sample) noexcept;
  void add_link(const Sample& sample) noexcept;
  void add_control(const Sample& sample) noexcept;

  SummaryContext context_;
  Summary so_far_;  // maxima, minima and last values; fractions and percentiles come in finish()
  Sample first_;
  Sample last_;
  double touch_z_nm_ = 0;  // height at which the present contact began
  double depth_below_touch_nm_ = 0;
  double lowest_touching_z_nm_ = 0;
  Xyz target_min_nm_{};
  Xyz target_max_nm_{};
  double force_step_sum_n2_ = 0;
  std::int64_t replies_of_past_epochs_ = 0;
  std::uint64_t touching_ = 0;
  std::uint64_t acted_ = 0;
  std::uint64_t damped_ = 0;
  std::uint64_t clamped_ = 0;
  std::uint64_t limited_ = 0;
  rt::LogHistogram rtt_;
  rt::LogHistogram force_age_;
  rt::LogHistogram lateness_;
  rt::LogHistogram step_;
};

}  // namespace telenano::recording
