#pragma once

#include <algorithm>
#include <cstdint>

namespace telenano::security {

/// Bounds the share of a loop's time that goes into handshakes, by what they really took: sessions that run
/// keep the rest whatever a flood of strangers asks for. At most `burst_ns` at once, `share` in the long run.
class HandshakeBudget {
 public:
  HandshakeBudget(double share, std::int64_t burst_ns) noexcept
      : share_(share), burst_ns_(static_cast<double>(burst_ns)) {}

  bool allows(std::int64_t now_ns) noexcept {
    debt_ns_ = std::max(0.0, debt_ns_ - share_ * static_cast<double>(now_ns - last_ns_));
    last_ns_ = now_ns;
    return debt_ns_ < burst_ns_;
  }
  void charge(std::int64_t taken_ns) noexcept {
    debt_ns_ += static_cast<double>(std::max<std::int64_t>(taken_ns, 0));
  }

 private:
  double share_;
  double burst_ns_;
  double debt_ns_ = 0;
  std::int64_t last_ns_ = 0;
};

}  // namespace telenano::security
