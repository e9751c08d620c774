#include "telenano/master/app/devices/device_monitor.h"

#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <utility>

#include "telenano/common/config/print.h"
#include "telenano/common/rt/steady_clock.h"

namespace telenano::app {

DeviceMonitor::DeviceMonitor(MonitoredLoop loop, std::function<void(const std::string&)> tell)
    : loop_(std::move(loop)),
      tell_(std::move(tell)),
      thread_([this](const std::stop_token& stop) { run(stop); }) {}

void DeviceMonitor::run(const std::stop_token& stop) {
  const rt::SteadyClock clock;
  ticks_ = loop_.ticks();
  moved_ns_ = clock.now_ns();
  while (!stop.stop_requested()) {
    std::this_thread::sleep_for(std::chrono::nanoseconds(kLookNs));
    look_at_loop(clock.now_ns());
    look_at_force();
  }
}

void DeviceMonitor::look_at_loop(std::int64_t now_ns) {
  const std::uint64_t ticks = loop_.ticks();
  const std::int64_t since_ns = now_ns - moved_ns_;
  if (ticks != ticks_) {
    if (told_stuck_) tell_(fmt::format("the loop runs again after {} ms", since_ns / 1'000'000));
    told_stuck_ = false;
    ticks_ = ticks;
    moved_ns_ = now_ns;
    stuck_ns_.store(0, std::memory_order_relaxed);
    return;
  }
  // A loop that has not begun, or that has ended, is not stuck.
  if (ticks == 0 || since_ns < kStuckNs) return;
  stuck_ns_.store(since_ns, std::memory_order_relaxed);
  if (told_stuck_) return;
  told_stuck_ = true;
  const device::CallWatch::Look look =
      loop_.calls != nullptr ? loop_.calls->look() : device::CallWatch::Look{};
  tell_(look.inside()
            ? fmt::format("the loop has been stuck in the SDK function {} for {} ms; the device's own "
                          "watchdog switches the force off",
                          look.name, since_ns / 1'000'000)
            : fmt::format("the loop has not run for {} ms: this machine is too busy or was suspended",
                          since_ns / 1'000'000));
}

void DeviceMonitor::look_at_force() {
  const device::ForceOffCause cause = loop_.force_off();
  if (cause == cause_) return;
  cause_ = cause;
  tell_(cause == device::ForceOffCause::kNone ? std::string("the device is ready again")
                                              : fmt::format("device: {}", device::force_off_text(cause)));
}

void end_without_loop(const device::CallWatch* calls) {
  const device::CallWatch::Look look = calls != nullptr ? calls->look() : device::CallWatch::Look{};
  config::print(
      stderr,
      "telenano-master: the loop does not return{}{}; ended without it; the device's own watchdog has "
      "switched the force off\n",
      look.inside() ? " from the SDK's " : "", look.inside() ? look.name : "");
  std::fflush(nullptr);
  std::_Exit(1);
}

}  // namespace telenano::app
