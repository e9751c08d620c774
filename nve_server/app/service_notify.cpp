#include "nve_server/app/service_notify.h"

#ifdef TELENANO_SYSTEMD
#include <systemd/sd-daemon.h>
#endif

#include <algorithm>
#include <chrono>

namespace telenano::app {

#ifdef TELENANO_SYSTEMD

namespace {

// Of the status line, where no watchdog asks for a quicker one.
constexpr std::int64_t kStatusPeriodUs = 5'000'000;

}  // namespace

ServiceNotify::ServiceNotify(const server::LoopStatus& status) : status_(status) {
  std::uint64_t watchdog_us = 0;
  watched_ = sd_watchdog_enabled(0, &watchdog_us) > 0;
  // Three signs of life in the time allowed, so that a late one is no death.
  period_us_ =
      watched_ ? std::max<std::int64_t>(static_cast<std::int64_t>(watchdog_us) / 3, 1000) : kStatusPeriodUs;
  // > 0: somebody listens.
  if (sd_notify(0, "READY=1\nSTATUS=serving") > 0) thread_ = std::thread([this] { run(); });
}

ServiceNotify::~ServiceNotify() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  wake_.notify_all();
  thread_.join();
  sd_notify(0, "STOPPING=1");
}

void ServiceNotify::run() {
  std::uint64_t last_turns = 0;
  std::unique_lock lock(mutex_);
  while (!wake_.wait_for(lock, std::chrono::microseconds(period_us_), [this] { return done_; })) {
    const std::uint64_t turns = status_.turns.load(std::memory_order_relaxed);
    if (watched_ && turns != last_turns) sd_notify(0, "WATCHDOG=1");
    last_turns = turns;
    sd_notifyf(0, "STATUS=%llu sessions, %llu exchanges",
               static_cast<unsigned long long>(status_.sessions.load(std::memory_order_relaxed)),
               static_cast<unsigned long long>(status_.exchanges.load(std::memory_order_relaxed)));
  }
}

#else

ServiceNotify::ServiceNotify(const server::LoopStatus& status) : status_(status) {}
ServiceNotify::~ServiceNotify() = default;
void ServiceNotify::run() {}

#endif

}  // namespace telenano::app
