#pragma once

#include <cstdint>

#include "telenano/common/rt/log_histogram.h"

namespace telenano::rt {

/// What a tick must know of its own time.
struct Tick {
  std::int64_t index = 0;        ///< of the deadline, counted from the start; jumps by 1 + missed
  std::int64_t deadline_ns = 0;  ///< of this index: start + index * period
  std::int64_t woke_ns = 0;      ///< when the tick really starts
  std::int64_t lateness_ns = 0;  ///< woke minus the first deadline due: skipping hides no delay
  std::int64_t missed = 0;       ///< deadlines that passed without a tick just before this one
};

/// The arithmetic of absolute deadlines at start + i * period, without any clock: no drift, and after a delay
/// the deadlines that have passed are skipped and counted, never run in a burst (a burst would command old
/// positions in no time, which is a velocity step at the hand).
class TickSchedule {
 public:
  TickSchedule(std::int64_t start_ns, std::int64_t period_ns) noexcept
      : start_ns_(start_ns), period_ns_(period_ns > 0 ? period_ns : 1) {}

  /// The deadline to wait for.
  std::int64_t due_ns() const noexcept { return start_ns_ + next_ * period_ns_; }
  std::int64_t period_ns() const noexcept { return period_ns_; }

  /// The tick that runs now; `now_ns` is at or after due_ns().
  Tick take(std::int64_t now_ns) noexcept {
    Tick tick;
    tick.woke_ns = now_ns;
    tick.lateness_ns = now_ns - due_ns();
    tick.missed = tick.lateness_ns > 0 ? tick.lateness_ns / period_ns_ : 0;
    tick.index = next_ + tick.missed;
    tick.deadline_ns = start_ns_ + tick.index * period_ns_;
    next_ = tick.index + 1;
    return tick;
  }

 private:
  std::int64_t start_ns_;
  std::int64_t period_ns_;
  std::int64_t next_ = 0;
};

struct PeriodicTimerConfig {
  std::int64_t period_ns = 1'000'000;
  /// The last stretch before a deadline is spent spinning: it hides the wake-up latency of a sleeping core. 0
  /// sleeps all the way. Keep it well below the period: a real-time thread that never sleeps is stopped 50 ms
  /// each second.
  std::int64_t spin_ns = 60'000;
};

struct PeriodicTimerStats {
  std::uint64_t ticks = 0;
  std::uint64_t overruns = 0;  ///< ticks whose work was not done at the next deadline
  std::uint64_t missed = 0;    ///< deadlines skipped, for whatever reason
  LogHistogram lateness;       ///< of every tick run
};

/// Wakes the calling thread at absolute deadlines of the monotonic clock: sleeps, then spins. One thread. The
/// first deadline is one period after the construction, or after restart().
///
/// for (;;) { const Tick tick = timer.wait(); step(); }
class PeriodicTimer {
 public:
  explicit PeriodicTimer(const PeriodicTimerConfig& config) noexcept;

  /// Counts from now on: call it when there was reason to pause (a handshake, a person), so that the pause is
  /// neither lateness nor missed ticks. Index starts again from 0.
  void restart() noexcept;

  /// Waits for the next deadline (not at all when it has passed). Not ended by signals: at most one period.
  Tick wait() noexcept;

  const PeriodicTimerStats& stats() const noexcept { return stats_; }
  const PeriodicTimerConfig& config() const noexcept { return config_; }

 private:
  PeriodicTimerConfig config_;
  TickSchedule schedule_;
  PeriodicTimerStats stats_;
};

}  // namespace telenano::rt
