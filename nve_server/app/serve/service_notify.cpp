#include "telenano/nve_server/app/serve/service_notify.h"

#ifdef TELENANO_SYSTEMD
#include <systemd/sd-daemon.h>
#endif

#include <algorithm>
#include <chrono>
#include <utility>

namespace telenano::app {

#ifdef TELENANO_SYSTEMD

namespace {

// Of the status line, where no watchdog asks for a quicker one.
constexpr std::int64_t kStatusPeriodUs = 5'000'000;

}  // namespace

void notify_start_goes_on(const std::string& status) noexcept {
  sd_notifyf(0, "EXTEND_TIMEOUT_USEC=30000000\nSTATUS=%s", status.c_str());
}

ServiceNotify::ServiceNotify(std::vector<const server::LoopStatus*> loops) : loops_(std::move(loops)) {
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
  // No loop turns any more, and an AFM's tip may take its three seconds to go up: who ends in order is not killed for that.
  sd_notify(0, watched_ ? "STOPPING=1\nWATCHDOG_USEC=15000000" : "STOPPING=1");
}

void ServiceNotify::run() {
  std::vector<std::uint64_t> last_turns(loops_.size(), 0);
  std::unique_lock lock(mutex_);
  while (!wake_.wait_for(lock, std::chrono::microseconds(period_us_), [this] { return done_; })) {
    bool all_turn = true;
    std::uint64_t sessions = 0, exchanges = 0;
    for (std::size_t i = 0; i < loops_.size(); ++i) {
      const std::uint64_t turns = loops_[i]->turns.load(std::memory_order_relaxed);
      all_turn = all_turn && turns != last_turns[i];
      last_turns[i] = turns;
      sessions += loops_[i]->sessions.load(std::memory_order_relaxed);
      exchanges += loops_[i]->exchanges.load(std::memory_order_relaxed);
    }
    if (watched_ && all_turn) sd_notify(0, "WATCHDOG=1");
    sd_notifyf(0, "STATUS=%llu sessions, %llu exchanges", static_cast<unsigned long long>(sessions),
               static_cast<unsigned long long>(exchanges));
  }
}

#else

void notify_start_goes_on(const std::string&) noexcept {}

ServiceNotify::ServiceNotify(std::vector<const server::LoopStatus*> loops) : loops_(std::move(loops)) {}
ServiceNotify::~ServiceNotify() = default;
void ServiceNotify::run() {}

#endif

}  // namespace telenano::app
