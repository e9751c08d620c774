#include "telenano/master/app/devices/calibrate_command.h"

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/master/app/devices/calibration.h"
#include "telenano/master/app/devices/session_device.h"
#include "telenano/master/app/station_file.h"
#include "telenano/master/app/stop_signals.h"

namespace telenano::app {
namespace {

struct CalibrateOptions {
  std::string device = "omega";
  std::string config_file;
  std::string out;
  bool home = false;
};

constexpr int kTries = 5;

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
      if (!entered()) continue;
      if (reading.status != device::DeviceStatus::kHoming) return reading.hand_pos_h_m;
      fmt::print(stderr,
                 "The device is not calibrated: move its handle to its calibration point (or start with "
                 "--home), then press Enter.\n");
    }
  }
  Vec3 until_enter() {
    return until_enter([](const Vec3&) {});
  }

 private:
  /// Waits a millisecond at most.
  static bool entered() {
    pollfd input{STDIN_FILENO, POLLIN, 0};
    if (::poll(&input, 1, 1) <= 0) return false;
    char c = 0;
    if (::read(STDIN_FILENO, &c, 1) != 1)
      throw RunError("calibrate: the input has ended; nothing was written");
    return c == '\n';
  }

  device::HapticDevice& device_;
  const std::atomic<bool>& stop_;
  rt::SteadyClock clock_;
};

std::string ask_push(Handle& handle, const char* direction, double shortest_m) {
  for (int attempt = 0; attempt < kTries; ++attempt) {
    fmt::print(stderr, "Hold the handle still near the middle, then press Enter.\n");
    const Vec3 from_d_m = handle.until_enter();
    fmt::print(stderr, "Push it {} and hold it there, then press Enter.\n", direction);
    const Push push = judge_push(handle.until_enter() - from_d_m, shortest_m);
    if (push.problem.empty()) {
      fmt::print(stderr, "That is the device's {}.\n", push.axis);
      return push.axis;
    }
    fmt::print(stderr, "Again, please: {}.\n", push.problem);
  }
  throw RunError("calibrate: five pushes could not be told apart; nothing was written");
}

void write_result(const std::string& text, const std::string& path) {
  if (path.empty()) {
    fmt::print("{}", text);
    return;
  }
  if (std::filesystem::exists(path)) throw UserError(path + ": exists already; give --out another name");
  std::ofstream file(path);
  file << text;
  file.close();
  if (!file) throw RunError(path + ": cannot be written");
  fmt::print(stderr, "written to {}; use it with run --config {}\n", path, path);
}

void calibrate(const CalibrateOptions& options) {
  const DeviceSpec spec = parse_device_spec(options.device);
  const bool omega = spec.kind == DeviceSpec::Kind::kOmega;
  if (!omega && spec.kind != DeviceSpec::Kind::kHid)
    throw UserError("calibrate --device " + options.device + ": only omega and hid have axes of their own");
  if (!options.out.empty() && std::filesystem::exists(options.out))
    throw UserError(options.out + ": exists already; give --out another name");
  StationFile file = options.config_file.empty() ? StationFile{} : load_station_file(options.config_file);
  // The device's own frame is what is looked at.
  file.device.axes = device::AxisMap{};
  file.device.centre_m = Vec3::Zero();
  SessionDevice opened = open_session_device(spec, file.device, options.home, nullptr);
  fmt::print(stderr, "device: {}\n", opened.description);
  for (const std::string& note : opened.notes) fmt::print(stderr, "note: {}\n", note);
  if (!omega) fmt::print(stderr, "Keep its deadman button pressed while you push.\n");
  Handle handle(opened);
  const double shortest_m = omega ? 0.02 : 0.005;
  std::array<std::string, 3> names;
  const std::array<const char*, 3> directions = {"to the right", "away from you", "up"};
  for (std::size_t i = 0; i < 3; ++i) names[i] = ask_push(handle, directions[i], shortest_m);
  const device::AxisMap axes = device::AxisMap::parse(names, "calibrate: the three pushes");
  ReachedBox box;
  if (omega) {
    fmt::print(stderr,
               "Move the handle to the ends of its range, left and right, near and far, down and up, then "
               "press Enter.\n");
    handle.until_enter([&](const Vec3& pos_d_m) { box.add(pos_d_m); });
    if (box.half_m() < 0.005)
      throw RunError(fmt::format(
          "calibrate: the handle was moved through {:.1f} mm only; nothing was written", 2e3 * box.half_m()));
  }
  write_result(calibration_toml(options.device, axes, omega ? &box : nullptr), options.out);
}

}  // namespace

CLI::App* add_calibrate_command(CLI::App& app) {
  auto options = std::make_shared<CalibrateOptions>();
  CLI::App* const command =
      app.add_subcommand("calibrate", "Find a device's axes, signs and workspace by pushing it about");
  command->add_option("--device", options->device, "What is calibrated")
      ->capture_default_str()
      ->type_name("{omega,hid}");
  command->add_option("--station,--config", options->config_file,
                      "Station file (TOML), for serial and watchdog_ms");
  command->add_option("--out", options->out,
                      "Write the [device] table to this new file instead of standard output");
  command->add_flag(
      "--home", options->home,
      "Let the omega calibrate itself by its motors: IT MOVES, keep hands and things out of its way");
  command->footer(
      "Asks for three pushes, right, away and up, each between two presses of Enter, and on an omega for a "
      "way\n"
      "through its whole range. No force is shown. Prints the [device] table of a station file.");
  command->callback([options] { calibrate(*options); });
  return command;
}

}  // namespace telenano::app
