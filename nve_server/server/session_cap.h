#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace telenano::server {

/// How many sessions may be active on several workers together. Any thread; never waits.
class SessionCap {
 public:
  explicit SessionCap(std::size_t max) : max_(static_cast<std::int64_t>(max)) {}

  /// Takes one place; false: all are taken.
  bool take() noexcept {
    std::int64_t now = active_.load(std::memory_order_relaxed);
    while (now < max_) {
      if (active_.compare_exchange_weak(now, now + 1, std::memory_order_relaxed)) return true;
    }
    return false;
  }
  void give_back(std::int64_t n) noexcept { active_.fetch_sub(n, std::memory_order_relaxed); }
  std::int64_t active() const noexcept { return active_.load(std::memory_order_relaxed); }

 private:
  const std::int64_t max_;
  std::atomic<std::int64_t> active_{0};
};

}  // namespace telenano::server
