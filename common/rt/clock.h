#pragma once

#include <cstdint>

namespace telenano::rt {

/// Seam: the only source of time. Nanoseconds from an arbitrary origin, never going back.
class Clock {
 public:
  virtual ~Clock() = default;
  virtual std::int64_t now_ns() const noexcept = 0;
};

/// Time that stands still until it is told to move: whole sessions run in it, faster than real time.
class VirtualClock final : public Clock {
 public:
  std::int64_t now_ns() const noexcept override { return now_ns_; }
  void advance_to(std::int64_t now_ns) noexcept {
    if (now_ns > now_ns_) now_ns_ = now_ns;
  }

 private:
  std::int64_t now_ns_ = 0;
};

}  // namespace telenano::rt
