#include "telenano/common/rt/periodic_timer.h"

#include <time.h>

#include <algorithm>

#include "telenano/common/rt/steady_clock.h"

namespace telenano::rt {
namespace {

std::int64_t now_ns() noexcept {
  return SteadyClock{}.now_ns();
}

void relax() noexcept {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#endif
}

void sleep_until(std::int64_t deadline_ns) noexcept {
  const timespec deadline{deadline_ns / 1'000'000'000, deadline_ns % 1'000'000'000};
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, nullptr) != 0) {
    if (now_ns() >= deadline_ns) return;  // a signal came; the deadline is absolute, so sleeping on is exact
  }
}

}  // namespace

PeriodicTimer::PeriodicTimer(const PeriodicTimerConfig& config) noexcept
    : config_(config), schedule_(0, config.period_ns) {
  config_.period_ns = schedule_.period_ns();
  config_.spin_ns = std::clamp<std::int64_t>(config_.spin_ns, 0, config_.period_ns);
  restart();
}

void PeriodicTimer::restart() noexcept {
  schedule_ = TickSchedule(now_ns() + config_.period_ns, config_.period_ns);
}

Tick PeriodicTimer::wait() noexcept {
  const std::int64_t due_ns = schedule_.due_ns();
  std::int64_t time_ns = now_ns();
  if (time_ns > due_ns) ++stats_.overruns;
  if (due_ns - time_ns > config_.spin_ns) {
    sleep_until(due_ns - config_.spin_ns);
    time_ns = now_ns();
  }
  while (time_ns < due_ns) {
    relax();
    time_ns = now_ns();
  }
  const Tick tick = schedule_.take(time_ns);
  ++stats_.ticks;
  stats_.missed += static_cast<std::uint64_t>(tick.missed);
  stats_.lateness.add(tick.lateness_ns);
  return tick;
}

}  // namespace telenano::rt
