#pragma once

#include <algorithm>
#include <cstdint>

namespace telenano::server {

/// Bounds the share of the loop's time that goes into opening sessions, by what making their slaves really
/// took: a flat scene's takes microseconds, and a thousand stations that come back at once after a restart
/// need not wait; a costly one must not keep the sessions that run waiting, whoever opens how many.
class OpeningBudget {
 public:
  OpeningBudget(double share, std::int64_t burst_ns) noexcept
      : share_(share), burst_ns_(static_cast<double>(burst_ns)) {}

  bool allows(std::int64_t now_ns) noexcept {
    const std::int64_t passed_ns = known_ ? std::max<std::int64_t>(now_ns - last_ns_, 0) : 0;
    debt_ns_ = std::max(0.0, debt_ns_ - share_ * static_cast<double>(passed_ns));
    known_ = true;
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
  bool known_ = false;
};

}  // namespace telenano::server
