#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/config/slave_limits_file.h"
#include "telenano/common/control/companding.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/metrics/exporter.h"
#include "telenano/common/recording/recorder.h"
#include "telenano/common/rt/realtime_thread.h"
#include "telenano/master/app/devices/device_monitor.h"
#include "telenano/master/app/link_probe.h"
#include "telenano/master/app/run/keep_awake.h"
#include "telenano/master/app/run/mark_rows.h"
#include "telenano/master/app/run/real_time_session.h"
#include "telenano/master/app/run/run_options.h"
#include "telenano/master/app/run/run_text.h"
#include "telenano/master/app/run/session_parts.h"
#include "telenano/master/app/station_file.h"
#include "telenano/master/app/view/session_view.h"
#include "telenano/master/station/station.h"

namespace telenano::app {

/// A session at one of the server's scenes, from the plan of its scaling to its summary. The scene has been prepared
/// (scene_preparation.h), and the session is kept awake until the loop begins: a terminal that takes no more text,
/// planning, a recording's file or a window may take longer than the server waits.
class SceneSession {
 public:
  /// All that comes before the loop, in the order of these functions below. Throws UserError and RunError.
  SceneSession(SessionParts& parts, const RunOptions& options, const LinkDelay& link);

  /// The exit code, or nothing: the session goes on at another scene. Throws RunError.
  std::optional<int> run();

 private:
  const station::StationConfig& config() const noexcept { return file_.station; }
  link::ClientSession& session() noexcept { return *parts_.session; }
  SessionDevice& opened() noexcept { return parts_.opened; }

  void keep_awake();
  void tell_welcome();
  void plan();
  void make_simulated_hand();
  void choose_companding();
  std::unique_ptr<recording::Recorder> new_recorder(const RunOptions& run);
  void make_station();
  void make_loop();
  void follow_scaling();
  void show();
  void ask_for_undo();
  void export_metrics();

  // While the loop runs.
  std::string record_from_now();
  void run_loop_thread(const std::stop_token& end);
  void look(const DeviceMonitor& monitor);
  std::string watch(rt::RealtimeThread& thread);
  std::string run_loop();

  // After it.
  std::string failure();
  void conclude();
  view_model::SessionEnd session_end();

  SessionParts& parts_;
  const RunOptions& options_;
  const LinkDelay& link_;
  StationFile file_;
  const bool terminal_;
  std::optional<KeepAwake> awake_;
  link::Welcome welcome_;
  std::uint32_t wish_ = 0;  // about a shared tip
  int delay_samples_ = 0;   // of the loop
  config::SlaveLimits slave_;
  device::DeviceInfo device_info_;
  std::string planned_;  // what choose_scaling() says
  station::SlavePort port_;
  station::ScalingCheck check_;
  std::vector<SimTask> tasks_;
  std::vector<control::CompandingConfig> companding_;  // by task
  double session_s_ = 0;
  station::TwinRunConfig twin_settings_;
  bool has_twin_ = false;
  std::uint64_t twin_scene_hash_ = 0;
  MarkRows mark_rows_;
  std::unique_ptr<recording::Recorder> recorder_;
  std::string recorded_;  // its file
  std::optional<MarkRows::Session> marks_;
  std::optional<RealTimeSession> live_;
  std::optional<metrics::Exporter> exporter_;
  Progress told_;
  std::chrono::steady_clock::time_point shown_;
  bool concluded_ = false;  // once: a window may stay open after it
};

}  // namespace telenano::app
