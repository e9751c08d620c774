#pragma once

#include <algorithm>
#include <cstdint>

namespace telenano::server {

/// Admission: what a session will take of the loop is its rate times what an exchange takes here, measured as
/// processor time, so that neither the machine's other programs nor a scene's price need be known. Sessions that are
/// there are never ended by it.
class LoadEstimate {
 public:
  /// `most`: share of the loop's time that all sessions may take; 0: no bound.
  explicit LoadEstimate(double most) noexcept : most_(most) {}

  void note(std::int64_t taken_ns, std::uint64_t exchanges) noexcept {
    if (exchanges == 0 || taken_ns < 0) return;
    const double n = static_cast<double>(exchanges);
    seen_ = std::min(seen_ + n, kMemory);
    const double weight = std::min(1.0, n / seen_);
    cost_ns_ += weight * (static_cast<double>(taken_ns) / n - cost_ns_);
  }
  /// Before kLeast exchanges nothing is known, and everybody is let in.
  double cost_s() const noexcept { return seen_ < kLeast ? 0 : 1e-9 * cost_ns_; }
  /// `active_hz`: the rates of the active sessions together. One session alone is always let in.
  bool admits(double active_hz, double rate_hz) const noexcept {
    return most_ <= 0 || active_hz <= 0 || (active_hz + rate_hz) * cost_s() <= most_;
  }

 private:
  static constexpr double kMemory = 16384;  // exchanges: some seconds of a few sessions
  static constexpr double kLeast = 512;

  double most_;
  double seen_ = 0;
  double cost_ns_ = 0;
};

}  // namespace telenano::server
