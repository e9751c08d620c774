#include "telenano/master/app/devices/calibrate_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/common/config/print.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/master/app/devices/calibration.h"
#include "telenano/master/app/devices/dynamics_text.h"
#include "telenano/master/app/devices/enter_key.h"
#include "telenano/master/app/devices/measure_dynamics.h"
#include "telenano/master/app/devices/session_device.h"
#include "telenano/master/app/station_file.h"
#include "telenano/master/app/stop_signals.h"
#include "telenano/master/device/intended_motion.h"
#include "telenano/master/device/sim_device.h"

namespace telenano::app {
namespace {

struct CalibrateOptions {
  std::string device = device_name(DeviceKind::kOmega);
  std::string config_file;
  std::string out;
  bool home = false;
  bool dynamics = false;
  bool hand_on = false;
  double seconds = 20;
};

constexpr int kTries = 5;
constexpr int kWatchdogMs = 31;  // the longest there is: a pause costs the measurement

/// The device, kept alive with zero force while a person reads and moves.
class Handle {
 public:
  explicit Handle(SessionDevice& opened) : device_(*opened.device), stop_(catch_stop_signals()) {}

  /// Until Enter is pressed; calls `seen` with every position. Returns the last. Throws RunError when the
  /// device fails, at the end of the input, and on a signal.
  template <class Seen>
  Vec3 until_enter(const Seen& seen) {
    device::DeviceReading reading;
    std::int64_t last_ns = clock_.now_ns();
    for (;;) {
      const std::int64_t now_ns = clock_.now_ns();
      device_.advance(now_ns - last_ns);
      last_ns = now_ns;
      device_.read(reading);
      device_.write_force(Vec3::Zero());
      if (stop_.load()) throw RunError("calibrate: stopped; nothing was written");
      if (reading.status == device::DeviceStatus::kFailed)
        throw RunError(fmt::format("calibrate: {}", device::force_off_text(reading.cause)));
      if (reading.status != device::DeviceStatus::kHoming) seen(reading.hand_pos_h_m);
      if (!enter_pressed(1)) continue;
      if (reading.status != device::DeviceStatus::kHoming) return reading.hand_pos_h_m;
      config::print(stderr, "{}\n", kNotCalibratedYet);
    }
  }
  Vec3 until_enter() {
    return until_enter([](const Vec3&) {});
  }

 private:
  device::HapticDevice& device_;
  const std::atomic<bool>& stop_;
  rt::SteadyClock clock_;
};

std::string ask_push(Handle& handle, const char* direction, double shortest_m) {
  for (int attempt = 0; attempt < kTries; ++attempt) {
    config::print(stderr, "Hold the handle still near the middle, then press Enter.\n");
    const Vec3 from_d_m = handle.until_enter();
    config::print(stderr, "Push it {} and hold it there, then press Enter.\n", direction);
    const Push push = judge_push(handle.until_enter() - from_d_m, shortest_m);
    if (push.problem.empty()) {
      config::print(stderr, "That is the device's {}.\n", push.axis);
      return push.axis;
    }
    config::print(stderr, "Again, please: {}.\n", push.problem);
  }
  throw RunError("calibrate: five pushes had no clear direction; nothing was written");
}

/// `use`: what to do with the file.
void write_result(const std::string& text, const std::string& path, const std::string& use) {
  if (path.empty()) {
    config::print(stdout, "{}", text);
    return;
  }
  if (std::filesystem::exists(path))
    throw UserError(path + ": already exists; choose another name for --out");
  std::ofstream file(path);
  file << text;
  file.close();
  if (!file) throw RunError(path + ": cannot be written");
  config::print(stderr, "written to {}; {}\n", path, use);
}

SessionDevice simulated_device(const CalibrateOptions& options, const StationFile& file) {
  device::SimDeviceConfig config;
  config.plant = file.plant;
  config.plant.period_s = 1 / calibration::MeasurementConfig{}.rate_hz;
  if (!options.hand_on) config.plant.grip_stiffness_n_m = config.plant.grip_damping_n_s_m = 0;
  SessionDevice opened;
  opened.device = std::make_unique<device::SimDevice>(
      config, device::IntendedMotion({{0, Vec3(0, 0, config.start_height_nm)}}));
  opened.description =
      options.hand_on ? "simulated, a simulated hand holds it" : "simulated, nobody holds it";
  return opened;
}

void calibrate_dynamics(const CalibrateOptions& options) {
  const DeviceSpec spec = parse_device_spec(options.device);
  const bool sim = spec.kind == DeviceSpec::Kind::kSim;
  if (!device_row(spec.kind).shows_force)
    throw UserError("calibrate --dynamics --device " + options.device +
                    ": only a device that shows forces can be measured: " +
                    any_of_text(device_names([](const DeviceRow& row) { return row.shows_force; })));
  if (!sim && options.hand_on)
    throw UserError("--hand-on works only with --device sim, whose simulated hand can hold the handle");
  StationFile file = options.config_file.empty() ? StationFile{} : load_station_file(options.config_file);
  if (!file.device.watchdog_ms) file.device.watchdog_ms = kWatchdogMs;
  calibration::MeasurementConfig config;
  config.seconds_per_axis = options.seconds;
  SessionDevice opened =
      sim ? simulated_device(options, file) : open_session_device(spec, file.device, options.home, nullptr);
  config::print(stderr, "device: {}\n", opened.description);
  for (const std::string& note : opened.notes) config::print(stderr, "note: {}\n", note);
  config.force_max_n = std::min(config.force_max_n, opened.device->info().force_max_n);
  if (!sim) {
    config::print(
        stderr,
        "The handle will move by itself for {:.0f} s, up to 3 cm each way, with at most {:g} N an axis.\n"
        "Put it near the middle of its range, let go of it, keep hands off until the end, press Enter.\n",
        3 * (config.seconds_per_axis + 1), config.force_max_n);
  }
  constexpr int kWait_ms = 20;
  const DeviceDynamics axes = measure_dynamics(
      *opened.device, opened.calls, config,
      sim ? std::function<bool()>() : [] { return enter_pressed(kWait_ms); });
  config::print(stderr, "{}", dynamics_table(axes));
  const double certain_n_s_m = certain_damping_n_s_m(axes);
  if (certain_n_s_m > 0) {
    config::print(stderr, "damping, lower bound: {:.3g} N s/m\n", certain_n_s_m);
  } else {
    config::print(stderr, "the lower bound of the damping is 0: measure again with a larger --seconds\n");
  }
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  write_result(dynamics_toml(options.device, axes, config.seconds_per_axis,
                             std::chrono::duration_cast<std::chrono::seconds>(now).count()),
               options.out,
               options.config_file.empty() ? "put its lines into the [device] table of your station file"
                                           : "put its lines into [device] of " + options.config_file);
}

void calibrate_axes(const CalibrateOptions& options) {
  const DeviceSpec spec = parse_device_spec(options.device);
  const bool omega = spec.kind == DeviceSpec::Kind::kOmega;
  if (!device_row(spec.kind).has_own_axes)
    throw UserError("calibrate --device " + options.device +
                    ": this device has no axes of its own to find, expected " +
                    any_of_text(device_names([](const DeviceRow& row) { return row.has_own_axes; })));
  StationFile file = options.config_file.empty() ? StationFile{} : load_station_file(options.config_file);
  // The device's own frame is what is looked at.
  file.device.axes = device::AxisMap{};
  file.device.centre_m = Vec3::Zero();
  SessionDevice opened = open_session_device(spec, file.device, options.home, nullptr);
  config::print(stderr, "device: {}\n", opened.description);
  for (const std::string& note : opened.notes) config::print(stderr, "note: {}\n", note);
  if (!omega) config::print(stderr, "Keep its deadman button pressed while you push.\n");
  Handle handle(opened);
  const double shortest_m = omega ? 0.02 : 0.005;
  std::array<std::string, 3> names;
  const std::array<const char*, 3> directions = {"to the right", "away from you", "up"};
  for (std::size_t i = 0; i < 3; ++i) names[i] = ask_push(handle, directions[i], shortest_m);
  const device::AxisMap axes = device::AxisMap::parse(names, "calibrate: the three pushes");
  ReachedBox box;
  if (omega) {
    config::print(stderr,
                  "Move the handle to the ends of its range, left and right, near and far, down and up, then "
                  "press Enter.\n");
    handle.until_enter([&](const Vec3& pos_d_m) { box.add(pos_d_m); });
    if (box.half_m() < 0.005)
      throw RunError(fmt::format("calibrate: the handle was moved by only {:.1f} mm; nothing was written",
                                 2e3 * box.half_m()));
  }
  write_result(calibration_toml(options.device, axes, omega ? &box : nullptr), options.out,
               "use it with run --config " + options.out);
}

void calibrate(const CalibrateOptions& options) {
  if (!options.out.empty() && std::filesystem::exists(options.out))
    throw UserError(options.out + ": already exists; choose another name for --out");
  if (options.dynamics) {
    calibrate_dynamics(options);
  } else {
    calibrate_axes(options);
  }
}

}  // namespace

CLI::App* add_calibrate_command(CLI::App& app) {
  auto options = std::make_shared<CalibrateOptions>();
  CLI::App* const command = app.add_subcommand(
      "calibrate", "Find a haptic device's axes, signs and workspace, or measure its damping and mass");
  command->add_option("--device", options->device, "Haptic device to calibrate")
      ->capture_default_str()
      ->type_name(choices_text(
          device_names([](const DeviceRow& row) { return row.has_own_axes || row.shows_force; })));
  command->add_option("--station,--config", options->config_file,
                      "Station file (TOML); serial, watchdog_ms and [simulated_device] are used");
  command->add_option("--out", options->out,
                      "Write the [device] table to this new file instead of standard output");
  command->add_flag("--home", options->home,
                    "Let the omega calibrate itself with its motors: IT MOVES, keep hands and objects clear");
  CLI::Option* const dynamics = command->add_flag(
      "--dynamics", options->dynamics,
      "Measure damping, mass, friction, latency and encoder resolution with small forces: THE HANDLE MOVES");
  command->add_option("--seconds", options->seconds, "Duration of --dynamics for each axis, 10 to 300 s")
      ->capture_default_str()
      ->check(CLI::Range(10.0, 300.0))
      ->needs(dynamics);
  command
      ->add_flag("--hand-on", options->hand_on,
                 "With --dynamics --device sim: let the simulated hand hold the handle; the measurement then "
                 "refuses")
      ->needs(dynamics);
  command->footer(
      "You push the handle to the right, away from you and up, pressing Enter before and after each push; an "
      "omega is\nthen moved through its whole range. The device shows no force. The result is the [device] "
      "table of a station file.\nWith --dynamics you let go of the handle: forces of at most 1.5 N move it "
      "around its rest position, one axis\nafter the other. The result contains the lower bound of the "
      "damping as [device] damping_n_s_m, which the\nenergy limit uses, and all measured values with their "
      "95 % intervals.");
  command->callback([options] { calibrate(*options); });
  return command;
}

}  // namespace telenano::app
