#pragma once

#include <algorithm>
#include <cstdint>

namespace telenano::security {

/// Bounds the share of a loop's time that goes into handshakes, by what they really took: sessions that run
/// keep the rest whatever a flood of strangers asks for. At most `burst_ns` at once, `share` in the long run.
///
/// What the budget holds back is strangers. A handshake that was let in goes on though the debt is high, a
/// step each kOverdraftNs, and the debt grows by it: strangers wait for longer. Otherwise nobody would ever
/// come in where one step takes more than the burst (a slow or very busy machine): the answer to its own
/// first step would be refused.
class HandshakeBudget {
 public:
  HandshakeBudget(double share, std::int64_t burst_ns) noexcept
      : share_(share), burst_ns_(static_cast<double>(burst_ns)) {}

  bool allows(std::int64_t now_ns) noexcept {
    debt_ns_ = std::max(0.0, debt_ns_ - share_ * static_cast<double>(now_ns - last_ns_));
    last_ns_ = now_ns;
    return debt_ns_ < burst_ns_;
  }
  /// A step of a handshake that was let in before.
  bool allows_to_go_on(std::int64_t now_ns) noexcept {
    if (allows(now_ns)) return true;
    if (now_ns < next_overdraft_ns_) return false;
    next_overdraft_ns_ = now_ns + kOverdraftNs;
    return true;
  }
  void charge(std::int64_t taken_ns) noexcept {
    debt_ns_ += static_cast<double>(std::max<std::int64_t>(taken_ns, 0));
  }

 private:
  static constexpr std::int64_t kOverdraftNs = 10'000'000;

  double share_;
  double burst_ns_;
  double debt_ns_ = 0;
  std::int64_t last_ns_ = 0;
  std::int64_t next_overdraft_ns_ = 0;
};

}  // namespace telenano::security
