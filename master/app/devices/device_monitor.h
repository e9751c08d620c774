#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>

#include "telenano/master/device/call_watch.h"
#include "telenano/master/device/haptic_device.h"

namespace telenano::app {

/// What the monitor looks at; all may be asked from its thread at any time.
struct MonitoredLoop {
  std::function<std::uint64_t()> ticks;              ///< grows while the loop runs
  std::function<device::ForceOffCause()> force_off;  ///< why the device shows no force
  const device::CallWatch* calls = nullptr;          ///< of a device that calls a vendor's library
};

/// Watches the loop from a thread of its own and tells a person, within 100 ms: that it is stuck, and in
/// which call of the vendor's library; that it runs again; why the device shows no force, and that it does
/// again. A stuck loop cannot be helped from outside: the device's own watchdog takes the force away.
class DeviceMonitor {
 public:
  static constexpr std::int64_t kLookNs = 15'000'000;
  static constexpr std::int64_t kStuckNs = 40'000'000;

  /// `tell` is called from the monitor's thread, one line at a time.
  DeviceMonitor(MonitoredLoop loop, std::function<void(const std::string&)> tell);

  /// How long the loop has been stuck, as of the last look; 0 while it runs.
  std::int64_t stuck_ns() const noexcept { return stuck_ns_.load(std::memory_order_relaxed); }

 private:
  void run(const std::stop_token& stop);
  void look_at_loop(std::int64_t now_ns);
  void look_at_force();

  MonitoredLoop loop_;
  std::function<void(const std::string&)> tell_;
  std::uint64_t ticks_ = 0;
  std::int64_t moved_ns_ = 0;
  bool told_stuck_ = false;
  device::ForceOffCause cause_ = device::ForceOffCause::kNone;
  std::atomic<std::int64_t> stuck_ns_{0};
  std::jthread thread_;
};

/// A vendor's library that does not come back keeps the loop's thread for ever. Once a person has asked for
/// the end and the loop has been stuck for this long, nothing more can be waited for.
inline constexpr std::int64_t kGiveUpStuckNs = 2'000'000'000;
/// Ends the program without that thread, exit code 1; what is to be kept is saved before. Null: no library.
[[noreturn]] void end_without_loop(const device::CallWatch* calls);

}  // namespace telenano::app
