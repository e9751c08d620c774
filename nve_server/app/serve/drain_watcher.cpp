#include "telenano/nve_server/app/serve/drain_watcher.h"

#include <chrono>
#include <utility>

#include "telenano/nve_server/app/serve/service_notify.h"

namespace telenano::app {
namespace {

constexpr std::int64_t kRestNs = 200'000'000;  // what a drain may be noticed later by

std::string sessions_text(std::uint64_t sessions) {
  return std::to_string(sessions) + (sessions == 1 ? " session" : " sessions");
}

}  // namespace

DrainRule::State DrainRule::look(bool all_drain, std::uint64_t occupied, std::int64_t now_ns) noexcept {
  if (!std::exchange(began_, true)) since_ns_ = now_ns;
  // A session on its way from one worker to another is for a moment nobody's: so twice.
  const bool empty = all_drain && occupied == 0;
  if (std::exchange(was_empty_, empty) && empty) return State::kEmpty;
  return now_ns - since_ns_ >= most_ns_ ? State::kLate : State::kGoesOn;
}

DrainWatcher::DrainWatcher(Config config, const rt::Clock& clock)
    : config_(std::move(config)), clock_(clock), thread_([this] { run(); }) {}

DrainWatcher::~DrainWatcher() {
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void DrainWatcher::run() {
  constexpr auto kRelaxed = std::memory_order_relaxed;
  std::optional<std::int64_t> most_ns;
  if (config_.most_s) most_ns = *config_.most_s * std::int64_t{1'000'000'000};
  DrainRule rule(most_ns);
  bool told = false;
  std::unique_lock lock(mutex_);
  // A signal handler cannot wake it: so it looks, seldom until there is something to watch.
  const auto until_next = [&] {
    return std::chrono::nanoseconds(config_.drain->load(kRelaxed) ? DrainRule::kLookNs : kRestNs);
  };
  while (!wake_.wait_for(lock, until_next(), [this] { return done_; })) {
    if (!config_.drain->load(kRelaxed) || config_.stop->load(kRelaxed)) continue;
    bool all_drain = true;
    std::uint64_t occupied = 0;
    std::uint64_t active = 0;
    for (const server::LoopStatus* const loop : config_.loops) {
      // First this one: it is stored after the others.
      all_drain = loop->draining.load(std::memory_order_acquire) && all_drain;
      occupied += loop->occupied.load(kRelaxed);
      active += loop->sessions.load(kRelaxed);
    }
    if (!std::exchange(told, true)) {
      if (config_.most_s) notify_end_takes(*config_.most_s);
      config_.tell("draining: no new sessions; " + sessions_text(active) + " may go on" +
                   (config_.most_s ? " for " + std::to_string(*config_.most_s) + " s" : ""));
    }
    switch (rule.look(all_drain, occupied, clock_.now_ns())) {
      case DrainRule::State::kGoesOn:
        continue;
      case DrainRule::State::kEmpty:
        config_.tell("drained: the last session is gone");
        break;
      case DrainRule::State::kLate:
        config_.tell("drained: the time is over, " + sessions_text(active) + " must end");
        break;
    }
    config_.stop->store(true, kRelaxed);
  }
}

}  // namespace telenano::app
