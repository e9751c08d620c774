#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "telenano/common/rt/log_histogram.h"
#include "tests/studies/bench/pinned_thread.h"
#include "tests/studies/bench/server_bench.h"

namespace telenano::studies {

/// When groups of stations send: each once a period, evenly spread over it. What is too late by a period is
/// not sent any more, as a station's own timer leaves out the ticks that it missed.
class PacedTimes {
 public:
  PacedTimes(const PacedOptions& options, std::size_t groups, std::int64_t start_ns) noexcept
      : start_ns_(start_ns),
        period_ns_(1'000'000'000 / options.rate_hz),
        groups_(static_cast<std::int64_t>(groups)) {}

  std::int64_t start_ns() const noexcept { return start_ns_; }
  std::int64_t period_ns() const noexcept { return period_ns_; }
  std::int64_t due_ns(std::int64_t tick, std::size_t group) const noexcept {
    return start_ns_ + tick * period_ns_ + static_cast<std::int64_t>(group) * period_ns_ / groups_;
  }
  /// When that was due which the group sent then.
  std::int64_t due_of_ns(std::int64_t sent_ns, std::size_t group) const noexcept {
    return due_ns((sent_ns - due_ns(0, group)) / period_ns_, group);
  }

 private:
  std::int64_t start_ns_, period_ns_, groups_;
};

/// What was sent and answered, as a whole and second by second.
class PacedRecord {
 public:
  explicit PacedRecord(const PacedOptions& options);

  void begin(const PacedTimes& times) noexcept;
  void sent(std::size_t commands, std::int64_t late_ns) noexcept;
  void left_out(std::size_t commands) noexcept { left_out_ += commands; }
  /// Nothing that was sent before begin().
  void answered(std::size_t group, std::int64_t sent_ns, std::int64_t came_ns) noexcept;
  PacedResult result(std::int64_t end_ns, std::int64_t server_cpu_ns) const;

 private:
  void end_second() noexcept;

  PacedTimes times_;
  rt::LogHistogram service_, since_due_, late_, of_this_second_;
  std::vector<double> p99_of_seconds_us_;
  std::int64_t second_ends_ns_ = 0;
  std::uint64_t commands_ = 0, left_out_ = 0;
};

/// Sends at these times for as long as the options say: `take(group)` fetches what came for a group, true if
/// anything did, `send(group, now_ns)` sends its commands and returns how many. `server_cpu_ns()`: what the
/// server's thread has spent so far.
template <class Take, class Send, class CpuNs>
PacedResult run_at_times(const PacedOptions& options, std::size_t groups, PacedRecord& account, Take take,
                         Send send, CpuNs server_cpu_ns) {
  constexpr std::int64_t kFirstNs = 1'000'000;
  constexpr std::int64_t kLastAnswersNs = 200'000'000;
  const auto now = [] { return clock_ns(CLOCK_MONOTONIC); };
  const auto ticks = static_cast<std::int64_t>(options.seconds * options.rate_hz);
  const std::int64_t cpu_before_ns = server_cpu_ns();
  const PacedTimes times(options, groups, now() + kFirstNs);
  account.begin(times);
  for (std::int64_t tick = 0; tick < ticks; ++tick) {
    for (std::size_t group = 0; group < groups; ++group) {
      take(group);
      const std::int64_t due_ns = times.due_ns(tick, group);
      std::int64_t now_ns = now();
      while (now_ns < due_ns) now_ns = now();
      if (now_ns >= due_ns + times.period_ns()) {
        account.left_out(options.in_group(group, groups));
        continue;
      }
      account.sent(send(group, now_ns), now_ns - due_ns);
    }
  }
  const std::int64_t end_ns = now();
  const std::int64_t cpu_ns = server_cpu_ns() - cpu_before_ns;
  while (now() < end_ns + kLastAnswersNs) {
    bool any = false;
    for (std::size_t group = 0; group < groups; ++group) any |= take(group);
    if (!any && now() > end_ns + kLastAnswersNs / 4) break;
  }
  return account.result(end_ns, cpu_ns);
}

}  // namespace telenano::studies
