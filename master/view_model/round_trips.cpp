#include "telenano/master/view_model/round_trips.h"

#include <algorithm>
#include <cmath>

namespace telenano::view_model {
namespace {

constexpr double kMost_us = 1e30;  // of what a float holds

}  // namespace

int RoundTrips::bin_of(double rtt_us) noexcept {
  if (!(rtt_us > 1)) return 0;
  const double bin = std::min(std::floor(10 * std::log10(rtt_us)), kBins - 1.0);
  return static_cast<int>(bin);
}

double RoundTrips::lower_us(int bin) noexcept {
  return std::pow(10.0, 0.1 * bin);
}

void RoundTrips::add(double rtt_us) noexcept {
  if (!(rtt_us > 0)) return;
  // The bin is the rounded value's, so that it is the same when the value leaves.
  const auto kept_us = static_cast<float>(std::min(rtt_us, kMost_us));
  const int bin = bin_of(static_cast<double>(kept_us));
  if (kept_ == kKept) --counts_[static_cast<std::size_t>(bin_of(static_cast<double>(kept_us_[next_])))];
  ++counts_[static_cast<std::size_t>(bin)];
  kept_us_[next_] = kept_us;
  next_ = (next_ + 1) % kKept;
  kept_ = std::min(kept_ + 1, kKept);
}

double RoundTrips::percentile_us(double fraction) const noexcept {
  if (kept_ == 0) return 0;
  const auto rank = static_cast<std::size_t>(std::ceil(fraction * static_cast<double>(kept_) - 1e-9));
  const std::size_t place = std::clamp<std::size_t>(rank, 1, kept_) - 1;
  const auto end = std::copy_n(kept_us_.begin(), kept_, sorted_us_.begin());
  const auto wanted = sorted_us_.begin() + static_cast<std::ptrdiff_t>(place);
  std::nth_element(sorted_us_.begin(), wanted, end);
  return static_cast<double>(*wanted);
}

}  // namespace telenano::view_model
