#include "telenano/master/app/run/run_settings.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <string>
#include <system_error>

#include "telenano/common/base/error.h"

namespace telenano::app {
namespace {

// CLI11's ranges let "nan" through: no comparison fails with it.
void require_numbers(const RunOptions& options) {
  const auto require = [](const char* flag, double value) {
    if (!std::isfinite(value))
      throw UserError(fmt::format("{}: {} is not a finite number; see --help for its range", flag, value));
  };
  require("--rate", options.rate_hz.value_or(0));
  require("--duration-s", options.duration_s.value_or(0));
  require("--depth-nm", options.depth_nm.value_or(0));
  require("--compand", options.compand.value_or(1));
  require("--reply-deadband", options.reply_deadband_permille.value_or(0));
  require("--undo-marks-at", options.undo_marks_at_s.value_or(0));
  require("--connect-timeout-s", options.connect_timeout_s);
  require("--give-up-s", options.give_up_s);
}

double parse_send_hz(const std::string& text) {
  if (text == "auto") return 0;
  double hz = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), hz);
  if (error != std::errc() || end != text.data() + text.size() || !(hz >= 20 && hz <= 8000))
    throw UserError(
        fmt::format("--send-hz '{}': expected auto, or datagrams a second from 20 to 8000", text));
  return hz;
}

}  // namespace

StationFile station_file(const RunOptions& options) {
  require_numbers(options);
  StationFile file = options.config_file.empty() ? StationFile{} : load_station_file(options.config_file);
  station::StationConfig& config = file.station;
  if (options.rate_hz) config.rate_hz = *options.rate_hz;
  if (options.method) {
    file.choose(*options.method);
  } else if (!options.scene.empty()) {
    file.choose("twin");
  }
  if (options.velocity_scale) file.scaling.velocity = *options.velocity_scale;
  if (options.force_scale) file.scaling.force = *options.force_scale;
  if (options.compand) config.companding.gain = *options.compand;
  if (options.allow_unsafe_scaling) config.allow_unsafe_scaling = true;
  if (options.duration_s) file.task.duration_s = *options.duration_s;
  if (options.redundancy) file.redundancy = *options.redundancy;
  if (options.reply_deadband_permille) file.kept_reply_deadband_permille = options.reply_deadband_permille;
  if (!options.send_hz.empty()) file.send_hz = parse_send_hz(options.send_hz);
  if (options.depth_nm) file.task.depth_nm = *options.depth_nm;
  finish_station_file(file, options.config_file.empty() ? "command line" : options.config_file);
  return file;
}

}  // namespace telenano::app
