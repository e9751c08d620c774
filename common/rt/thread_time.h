#pragma once

#include <time.h>

#include "telenano/common/rt/clock.h"

namespace telenano::rt {

/// Processor time of the thread that asks: what it really worked, not how long a busy machine kept it
/// waiting. For charging work to a budget; never for what the world must be in time for. A system call of
/// about 0.2 µs.
class ThreadTime final : public Clock {
 public:
  std::int64_t now_ns() const noexcept override {
    timespec now{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
  }
};

}  // namespace telenano::rt
