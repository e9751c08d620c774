#include "telenano/master/app/devices/measure_dynamics.h"

#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>

#include "telenano/common/base/error.h"
#include "telenano/common/config/print.h"
#include "telenano/common/rt/periodic_timer.h"
#include "telenano/common/rt/realtime_thread.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/master/app/devices/device_monitor.h"
#include "telenano/master/app/devices/enter_key.h"
#include "telenano/master/app/stop_signals.h"

namespace telenano::app {
namespace {

using calibration::AxisDynamics;
using calibration::CallTime;
using calibration::DynamicsMeasurement;
using calibration::MeasurementEnd;

/// Tells a percentage on one line of a terminal, or a line each quarter elsewhere.
class ProgressLine {
 public:
  /// What ends its line before another one is told.
  const char* line_end() const { return terminal_ ? "\n" : ""; }
  void show(int percent) {
    const int now = terminal_ ? percent : percent / 25 * 25;
    if (now == shown_) return;
    shown_ = now;
    if (terminal_) {
      config::print(stderr, "\rmeasuring: {} %{}", now, now == 100 ? "\n" : " ");
    } else {
      config::print(stderr, "measuring: {} %\n", now);
    }
  }

 private:
  bool terminal_ = ::isatty(STDERR_FILENO) != 0;
  int shown_ = -1;
};

/// One device, one measurement, one thread that runs it.
class Loop {
 public:
  Loop(device::HapticDevice& device, const calibration::MeasurementConfig& config)
      : device_(device), measurement_(config), period_ns_(std::llround(1e9 / config.rate_hz)) {}

  /// Zero force until begin(), so that a device's watchdog hears of it from its first force on; then the measurement.
  void run(const std::atomic<bool>& stopped, const std::stop_token& stop) noexcept {
    const bool real_time = device_.info().moves_by_itself;
    rt::PeriodicTimer timer({.period_ns = period_ns_});
    const rt::SteadyClock clock;
    std::int64_t last_ns = clock.now_ns();
    std::int64_t simulated_ns = 0;
    while (measurement_.end() == MeasurementEnd::kRunning) {
      simulated_ns += period_ns_;
      if (real_time) timer.wait();
      // The calls have times of their own: this thread may lose its processor before, between and in them.
      const auto now_ns = [&] { return real_time ? clock.now_ns() : simulated_ns; };
      const std::int64_t read_ns = now_ns();
      device_.advance(real_time ? read_ns - last_ns : period_ns_);
      last_ns = read_ns;
      device_.read(reading_);
      const CallTime read = since(read_ns, now_ns());
      status_.store(reading_.status, std::memory_order_relaxed);
      if (stopped.load(std::memory_order_relaxed) || refused_.load(std::memory_order_relaxed) ||
          stop.stop_requested())
        measurement_.stop();
      const Vec3 force_h_n =
          begun_.load(std::memory_order_relaxed) ? measurement_.force(read, reading_) : Vec3::Zero();
      const std::int64_t write_ns = now_ns();
      const Vec3 shown_h_n = device_.write_force(force_h_n);
      measurement_.applied(since(write_ns, now_ns()), shown_h_n);
      percent_.store(static_cast<int>(100 * measurement_.done()), std::memory_order_relaxed);
      complete_.store(measurement_.axis(), std::memory_order_release);
      ticks_.fetch_add(1, std::memory_order_relaxed);
    }
    device_.write_force(Vec3::Zero());
    if (measurement_.end() == MeasurementEnd::kDone) complete_.store(3, std::memory_order_release);
    over_.store(true, std::memory_order_release);
  }

  static CallTime since(std::int64_t begin_ns, std::int64_t end_ns) noexcept {
    return {1e-9 * static_cast<double>(begin_ns), 1e-9 * static_cast<double>(end_ns)};
  }

  void begin() noexcept { begun_.store(true, std::memory_order_relaxed); }
  /// As of the last tick.
  device::DeviceStatus status() const noexcept { return status_.load(std::memory_order_relaxed); }
  bool over() const noexcept { return over_.load(std::memory_order_acquire); }
  /// Grows while it runs; 0 once it is over.
  std::uint64_t ticks() const noexcept { return over() ? 0 : ticks_.load(std::memory_order_relaxed); }
  int percent() const noexcept { return percent_.load(std::memory_order_relaxed); }
  /// How many axes are measured, 0 to 3: their tracks change no more.
  int complete() const noexcept { return complete_.load(std::memory_order_acquire); }
  /// What was measured cannot be used: no further force.
  void refuse() noexcept { refused_.store(true, std::memory_order_relaxed); }
  const DynamicsMeasurement& measurement() const noexcept { return measurement_; }
  const device::DeviceReading& reading() const noexcept { return reading_; }

 private:
  device::HapticDevice& device_;
  DynamicsMeasurement measurement_;
  std::int64_t period_ns_;
  device::DeviceReading reading_;
  std::atomic<bool> begun_{false};
  std::atomic<device::DeviceStatus> status_{device::DeviceStatus::kOk};
  std::atomic<int> percent_{0};
  std::atomic<int> complete_{0};
  std::atomic<bool> refused_{false};
  std::atomic<std::uint64_t> ticks_{0};
  std::atomic<bool> over_{false};
};

std::string why_it_ended(const Loop& loop) {
  const MeasurementEnd end = loop.measurement().end();
  if (end != MeasurementEnd::kDevice || loop.reading().cause == device::ForceOffCause::kNone)
    return calibration::end_text(end);
  return fmt::format("{}: {}", calibration::end_text(end), device::force_off_text(loop.reading().cause));
}

}  // namespace

DeviceDynamics measure_dynamics(device::HapticDevice& device, const device::CallWatch* calls,
                                const calibration::MeasurementConfig& config,
                                const std::function<bool()>& is_ready) {
  const std::atomic<bool>& stop = catch_stop_signals();
  Loop loop(device, config);
  ProgressLine progress;
  DeviceDynamics axes;
  int judged = 0;
  std::string why_not;
  // As soon as an axis is measured: whoever holds the handle hears of it before the next one.
  const auto judge = [&] {
    while (judged < loop.complete() && why_not.empty()) {
      AxisDynamics& found = axes[static_cast<std::size_t>(judged)];
      found = calibration::identify_axis(loop.measurement().track(judged));
      if (found.verdict != calibration::DynamicsVerdict::kGood)
        why_not = fmt::format("axis {}: {}", "xyz"[judged], calibration::verdict_text(found.verdict));
      ++judged;
    }
    if (!why_not.empty()) loop.refuse();
  };
  {
    rt::RealtimeThread thread({}, [&](const std::stop_token& token) { loop.run(stop, token); });
    // Why there is no force is the measurement's own end to tell.
    std::optional<DeviceMonitor> monitor;
    if (device.info().moves_by_itself) {
      monitor.emplace(
          MonitoredLoop{[&loop] { return loop.ticks(); }, [] { return device::ForceOffCause::kNone; }, calls},
          [&progress](const std::string& text) {
            config::print(stderr, "{}telenano-master: warning: {}\n", progress.line_end(), text);
          });
    }
    const auto give_up_if_stuck = [&] {
      if (stop.load() && monitor && monitor->stuck_ns() > kGiveUpStuckNs) end_without_loop(calls);
    };
    while (is_ready && !loop.over()) {
      give_up_if_stuck();
      if (loop.status() == device::DeviceStatus::kFailed) break;  // said at once, not after Enter
      if (!is_ready()) continue;
      if (loop.status() != device::DeviceStatus::kHoming) break;
      config::print(stderr, "{}\n", kNotCalibratedYet);
    }
    loop.begin();
    while (!loop.over()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      give_up_if_stuck();
      progress.show(loop.percent());
      judge();
    }
    thread.join();
  }
  judge();
  if (why_not.empty() && loop.measurement().end() != MeasurementEnd::kDone) why_not = why_it_ended(loop);
  if (!why_not.empty()) throw RunError(fmt::format("calibrate: {}; nothing was written", why_not));
  return axes;
}

}  // namespace telenano::app
