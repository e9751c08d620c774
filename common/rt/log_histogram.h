#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace telenano::rt {

/// Counts of non-negative nanoseconds in logarithmic bins: 16 to the octave, so a percentile is right to 1/16
/// of its value (exactly, below 16 ns), from 0 to 2^40 ns (18 minutes; more goes into the last bin). Fixed
/// memory (5 kB), one addition for a value. Not shared between threads: copy it through a LatestValue or read
/// it after the loop.
class LogHistogram {
 public:
  void add(std::int64_t value_ns) noexcept {
    const auto value = static_cast<std::uint64_t>(std::max<std::int64_t>(value_ns, 0));
    ++counts_[bin_of(value)];
    ++count_;
    sum_ns_ += static_cast<double>(value);
    max_ns_ = std::max(max_ns_, static_cast<std::int64_t>(value));
  }

  std::uint64_t count() const noexcept { return count_; }
  std::int64_t max_ns() const noexcept { return max_ns_; }
  double mean_ns() const noexcept { return count_ == 0 ? 0.0 : sum_ns_ / static_cast<double>(count_); }

  /// Smallest bin border (never above the maximum) that at least the fraction `q` of all values do not
  /// exceed. 0 when there is no value.
  std::int64_t percentile_ns(double q) const noexcept {
    const double wanted = std::clamp(q, 0.0, 1.0) * static_cast<double>(count_);
    std::uint64_t seen = 0;
    for (std::size_t bin = 0; bin < kBins; ++bin) {
      seen += counts_[bin];
      if (seen > 0 && static_cast<double>(seen) >= wanted) return std::min(upper_ns(bin), max_ns_);
    }
    return max_ns_;
  }

  static constexpr std::size_t kBins = 16 + 36 * 16;

  std::uint64_t bin_count(std::size_t bin) const noexcept { return counts_[bin]; }
  /// Largest value of a bin.
  static constexpr std::int64_t upper_ns(std::size_t bin) noexcept {
    if (bin < 16) return static_cast<std::int64_t>(bin);
    const std::size_t octave = bin / 16 - 1;
    return static_cast<std::int64_t>(((16 + bin % 16 + 1) << octave) - 1);
  }
  static constexpr std::size_t bin_of(std::uint64_t value_ns) noexcept {
    if (value_ns < 16) return static_cast<std::size_t>(value_ns);
    const auto octave = static_cast<std::size_t>(std::bit_width(value_ns)) - 5;
    const std::size_t bin = octave * 16 + static_cast<std::size_t>(value_ns >> octave);
    return std::min(bin, kBins - 1);
  }

 private:
  std::array<std::uint64_t, kBins> counts_{};
  std::uint64_t count_ = 0;
  double sum_ns_ = 0;
  std::int64_t max_ns_ = 0;
};

}  // namespace telenano::rt
