#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace telenano::view_model {

/// Histogram of the newest round trips, ten bins to the decade from 1 µs to 10 s; what lies outside goes into
/// the first or last.
class RoundTrips {
 public:
  static constexpr int kBins = 70;
  static constexpr std::size_t kKept = 5000;

  void add(double rtt_us) noexcept;

  const std::array<int, kBins>& counts() const noexcept { return counts_; }
  int count() const noexcept { return static_cast<int>(kept_); }
  static double lower_us(int bin) noexcept;
  static int bin_of(double rtt_us) noexcept;
  /// Upper border of the bin that holds it; 0 without any.
  double percentile_us(double fraction) const noexcept;

 private:
  std::array<int, kBins> counts_{};
  std::array<std::uint8_t, kKept> bins_{};  // of the newest ones, a ring
  std::size_t next_ = 0;
  std::size_t kept_ = 0;
};

}  // namespace telenano::view_model
