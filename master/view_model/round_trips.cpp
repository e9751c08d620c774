#include "master/view_model/round_trips.h"

#include <algorithm>
#include <cmath>

namespace telenano::view_model {

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
  const int bin = bin_of(rtt_us);
  if (kept_ == kKept) --counts_[bins_[next_]];
  ++counts_[static_cast<std::size_t>(bin)];
  bins_[next_] = static_cast<std::uint8_t>(bin);
  next_ = (next_ + 1) % kKept;
  kept_ = std::min(kept_ + 1, kKept);
}

double RoundTrips::percentile_us(double fraction) const noexcept {
  if (kept_ == 0) return 0;
  const double wanted = fraction * static_cast<double>(kept_);
  double seen = 0;
  for (int bin = 0; bin < kBins; ++bin) {
    seen += counts_[static_cast<std::size_t>(bin)];
    if (seen > 0 && seen >= wanted) return lower_us(bin + 1);
  }
  return lower_us(kBins);
}

}  // namespace telenano::view_model
