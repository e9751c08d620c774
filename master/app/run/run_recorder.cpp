#include "telenano/master/app/run/run_recorder.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <utility>

#include "telenano/common/base/base64.h"
#include "telenano/common/base/version.h"
#include "telenano/common/config/print.h"
#include "telenano/master/app/plan/station_plan.h"
#include "telenano/master/app/run/run_text.h"
#include "telenano/master/app/scene_files.h"
#include "telenano/master/connection/server_link.h"

namespace telenano::app {

std::unique_ptr<recording::Recorder> make_recorder(
    const RunOptions& options, const StationFile& file, const link::Welcome& welcome, const LinkDelay& link,
    const SessionDevice& opened, const device::DeviceInfo& device, const std::string& planned,
    std::uint64_t nonce_seed, const std::string& scene_before, const std::string* bundle,
    const station::TwinRunConfig* twin, std::uint64_t twin_scene_hash,
    std::function<void(std::vector<recording::MarkRow>& rows)> marks) {
  if (options.record.empty()) return nullptr;
  const std::string scene_name = slave_limits(welcome).scene_name;
  recording::Configuration about;
  const bool simulated = opened.description.empty();
  about.title = fmt::format("{} on {}", simulated ? options.task : opened.device->info().name, scene_name);
  about.program = std::string("telenano-master ") + kVersion;
  about.git_commit = kGitCommit;
  about.command_line = options.command_line;
  about.scene_name = scene_name;
  about.scene_hash = fmt::format("{:016x}", welcome.scene_hash);
  if (const auto local = find_scene(scene_name, about.scene_hash)) {
    about.scene_text = local->text;
    about.extra.emplace_back("scene_path", local->path);
    about.extra.emplace_back("surface.force", local->force);
  } else {
    about.extra.emplace_back("surface.force", "unknown");  // who said nothing had another ground
  }
  if (bundle != nullptr) about.extra.emplace_back("scene_bundle", to_base64(*bundle));
  about.station_text = file.text.empty() ? "defaults" : file.text;
  if (!scene_before.empty()) about.extra.emplace_back("continued_from", scene_before);
  about.seed = fmt::format("{}", nonce_seed);
  about.rate_hz = file.station.rate_hz;
  for (auto& setting : describe(file.station, file.plant)) about.extra.push_back(std::move(setting));
  for (auto& setting : describe_link(file)) about.extra.push_back(std::move(setting));
  for (auto& setting : describe_device(device)) about.extra.push_back(std::move(setting));
  about.extra.emplace_back("features", fmt::format("{:x}", welcome.feature_bits));
  if (twin != nullptr) {
    about.extra.emplace_back("twin.scene_hash", fmt::format("{:016x}", twin_scene_hash));
    about.extra.emplace_back("twin.ring_s", fmt::format("{:.17g}", twin->ring_s));
  }
  about.extra.emplace_back("slave_timeout_ms", fmt::format("{}", welcome.timeout_ms));
  about.extra.emplace_back("scaling_chosen", planned.empty() ? "given" : planned);
  about.extra.emplace_back("round_trip_median_s", fmt::format("{:.9g}", link.median_s));
  about.extra.emplace_back("round_trip_p99_s", fmt::format("{:.9g}", link.p99_s));
  about.extra.emplace_back("device", simulated ? "sim" : opened.description);
  describe(file.device, about.extra);
  if (simulated) about.extra.emplace_back("task", options.task);
  about.extra.emplace_back("server", options.server);
  about.extra.emplace_back("security", connection::describe_security(options));
  about.extra.emplace_back("protocol_version", fmt::format("{}", welcome.version));
  about.extra.emplace_back("surface_z_w_nm", fmt::format("{:.17g}", welcome.surface_z_w_nm));
  about.extra.emplace_back("start_pos_w_nm",
                           fmt::format("{:.17g} {:.17g} {:.17g}", welcome.start_pos_w_nm.x(),
                                       welcome.start_pos_w_nm.y(), welcome.start_pos_w_nm.z()));
  about.extra.emplace_back("coupling_stiffness_n_m", fmt::format("{:.17g}", welcome.coupling_stiffness_n_m));
  about.extra.emplace_back("coupling_damping_n_s_m", fmt::format("{:.17g}", welcome.coupling_damping_n_s_m));
  about.extra.emplace_back("slave_fault_names", slave_fault_names());
  about.extra.emplace_back("station_fault_names", station_fault_names());
  recording::RecorderOptions recorder_options;
  recorder_options.path = options.record;
  recorder_options.overwrite = options.overwrite;
  recorder_options.newest_marks = std::move(marks);
  recorder_options.on_failure = [new_line =
                                     isatty(STDERR_FILENO) != 0 && !options.quiet](const std::string& text) {
    config::print(stderr, "{}telenano-master: warning: {}; the session goes on\n", new_line ? "\n" : "",
                  text);
  };
  return std::make_unique<recording::Recorder>(recorder_options, about);
}

}  // namespace telenano::app
