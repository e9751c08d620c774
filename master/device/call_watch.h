#pragma once

#include <atomic>
#include <cstdint>

namespace telenano::device {

/// Says in which call of a foreign library a thread is, to another thread, without a clock and without
/// waiting. The count is odd inside a call: one that stays odd and the same between two looks is stuck.
class CallWatch {
 public:
  /// `name` is a literal.
  void enter(const char* name) noexcept {
    name_.store(name, std::memory_order_relaxed);
    count_.fetch_add(1, std::memory_order_release);
  }
  void leave() noexcept { count_.fetch_add(1, std::memory_order_release); }

  struct Look {
    std::uint64_t count = 0;
    const char* name = "";
    bool inside() const noexcept { return (count & 1u) != 0; }
  };
  Look look() const noexcept {
    Look look;
    look.count = count_.load(std::memory_order_acquire);
    look.name = name_.load(std::memory_order_relaxed);
    return look;
  }

 private:
  std::atomic<std::uint64_t> count_{0};
  std::atomic<const char*> name_{""};
};

}  // namespace telenano::device
