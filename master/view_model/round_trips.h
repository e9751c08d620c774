#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace telenano::view_model {

/// The newest round trips, and their histogram: ten bins to the decade from 1 µs to 10 s; what lies outside
/// goes into the first or last.
class RoundTrips {
 public:
  static constexpr int kBins = 70;
  static constexpr std::size_t kKept = 5000;

  void add(double rtt_us) noexcept;

  const std::array<int, kBins>& counts() const noexcept { return counts_; }
  int count() const noexcept { return static_cast<int>(kept_); }
  static double lower_us(int bin) noexcept;
  static int bin_of(double rtt_us) noexcept;
  /// The least of the newest round trips that so large a part of them does not exceed, itself and not its
  /// bin's border; 0 without any.
  double percentile_us(double fraction) const noexcept;

 private:
  std::array<int, kBins> counts_{};
  std::array<float, kKept> kept_us_{};  // the newest ones, a ring; three digits are shown, a float has seven
  mutable std::array<float, kKept> sorted_us_{};  // room for percentile_us()
  std::size_t next_ = 0;
  std::size_t kept_ = 0;
};

}  // namespace telenano::view_model
