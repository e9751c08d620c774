#pragma once

#include <algorithm>
#include <cstdint>

namespace telenano::link {

/// Bounds how often something is done: `burst` at once, `per_s` in the long run.
class TokenBucket {
 public:
  TokenBucket(double per_s, double burst) noexcept : per_ns_(per_s * 1e-9), burst_(burst), tokens_(burst) {}

  /// Another rate from now on; the tokens that are there stay.
  void set_per_s(double per_s) noexcept { per_ns_ = per_s * 1e-9; }

  bool take(std::int64_t now_ns) noexcept {
    if (now_ns > last_ns_) {
      tokens_ = std::min(burst_, tokens_ + static_cast<double>(now_ns - last_ns_) * per_ns_);
      last_ns_ = now_ns;
    }
    if (tokens_ < 1) return false;
    tokens_ -= 1;
    return true;
  }

 private:
  double per_ns_;
  double burst_;
  double tokens_;
  std::int64_t last_ns_ = 0;
};

}  // namespace telenano::link
