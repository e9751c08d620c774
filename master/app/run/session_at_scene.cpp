#include "telenano/master/app/run/session_at_scene.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <thread>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/control/method_choice.h"
#include "telenano/common/metrics/exporter.h"
#include "telenano/common/recording/recorder.h"
#include "telenano/common/rt/realtime_thread.h"
#include "telenano/master/app/devices/device_monitor.h"
#include "telenano/master/app/failure_text.h"
#include "telenano/master/app/link_probe.h"
#include "telenano/master/app/plan/station_plan.h"
#include "telenano/master/app/recordings/free_recording.h"
#include "telenano/master/app/run/keep_awake.h"
#include "telenano/master/app/run/mark_rows.h"
#include "telenano/master/app/run/real_time_session.h"
#include "telenano/master/app/run/run_metrics.h"
#include "telenano/master/app/run/run_recorder.h"
#include "telenano/master/app/run/run_text.h"
#include "telenano/master/app/run/scene_wait.h"
#include "telenano/master/app/run/session_terms.h"
#include "telenano/master/app/run/shown_ground.h"
#include "telenano/master/app/run/sim_hand.h"
#include "telenano/master/app/stop_signals.h"

namespace telenano::app {
namespace {

// The link is measured for so long before the session begins: enough for a median, too short to be noticed.
constexpr double kProbeS = 0.02;

constexpr int kProbeMin = 5;
constexpr int kProbeMax = 40;

constexpr const char* kRecordingInWindow = "session.h5";  // of one that begins there

constexpr std::chrono::milliseconds kLineAgain(200);
constexpr std::chrono::milliseconds kLineAgainInLog(2000);

/// A window that was opened to look around stays when the first task is done; one that was told which task,
/// or for how long, goes with it.
bool stays_open(const RunOptions& options, const SessionView& view, bool simulated) {
  return simulated && view.has_window() && !options.task_given && !options.duration_s;
}

std::vector<std::string> scene_names(const std::vector<SceneChoice>& scenes) {
  std::vector<std::string> names;
  for (const SceneChoice& scene : scenes) names.push_back(scene.name);
  return names;
}

std::vector<std::uint64_t> scene_hashes(const std::vector<SceneChoice>& scenes) {
  std::vector<std::uint64_t> hashes;
  for (const SceneChoice& scene : scenes) hashes.push_back(scene.hash);
  return hashes;
}

/// The session once more, with the same slave and another wish about the log of steps.
void connect_again(SessionParts& parts, std::size_t step_ring) {
  connection::ServerLink& way = parts.servers.link();
  parts.client_config.step_ring = step_ring;
  parts.client_config.resume_token = parts.session->resume_token();
  parts.client_config.nonce_seed = connection::random_nonce_seed();
  if (parts.farewell) parts.farewell->leave_to_loop();
  parts.session.emplace(parts.client_config);
  connection::connect(*parts.session, way, parts.servers.address(), parts.file.station.rate_hz,
                      parts.servers.access(), parts.stop);
  parts.farewell.emplace(*parts.session, way.datagram(), parts.servers.address());
}

/// HOST:PORT, so that the next scene of the session is found where this one is.
std::string address_of(const std::string& url) {
  const std::size_t begin = url.find("//") + 2;
  return url.substr(begin, url.find('/', begin) - begin);
}

/// The options as they are for the scene at hand: what was asked for the first one only is over, and a recording is of
/// one scene.
RunOptions options_here(const SessionParts& parts) {
  RunOptions options = parts.options;
  if (parts.scene_before.empty()) return options;
  options.record = parts.record;
  options.overwrite = false;
  options.metrics = parts.metrics;
  options.undo_marks_at_s.reset();
  return options;
}

}  // namespace

std::optional<int> run_at_scene(SessionParts& parts) {
  const RunOptions options = options_here(parts);
  const std::atomic<bool>& stop = parts.stop;
  StationFile file = parts.file;
  const station::StationConfig& config = file.station;
  const bool simulated = parts.simulated;
  const bool last_run = parts.last_run;
  const bool resumed = parts.resumed;
  const bool wants_twin = parts.wants_twin;
  scene_store::SceneKeeper& scene = parts.scene;
  SessionView& view = parts.view;
  SessionDevice& opened = parts.opened;
  connection::ServerList& servers = parts.servers;
  SessionFile& session_file = parts.session_file;
  std::optional<link::ClientSession>& opened_session = parts.session;
  std::optional<connection::Farewell>& farewell = parts.farewell;
  const std::vector<SceneChoice>& scenes = parts.scenes;
  Twins& twins = parts.twins;
  std::string& no_twin = parts.no_twin;
  connection::ServerLink& way = servers.link();
  const net::Address server = servers.address();
  if (farewell) farewell->leave_to_loop();  // to this one, which may be another server's
  farewell.emplace(*opened_session, way.datagram(), server);
  const LinkDelay link =
      measure_link(*opened_session, way, server, config.rate_hz,
                   std::clamp(static_cast<int>(kProbeS * config.rate_hz), kProbeMin, kProbeMax),
                   options.connect_timeout_s, stop);
  const auto get_ready = [&] {
    if (parts.looks_for_twin) {
      twins = find_twins(*opened_session, way, server, link, config.rate_hz, wants_twin, options.quiet, scene,
                         stop, no_twin);
      if (stop && view.has_window()) return;
      if (!twins.empty()) {
        opened_session->make_room_for_snapshot(snapshot_room(*twins[0]));
      } else if (opened_session->logs_steps()) {
        // Whether steps are logged is agreed on with the session: on with the same slave, without the log.
        connect_again(parts, 0);
      }
    }
    scene.start();
    if (view.wanted() || !options.record.empty())
      wait_for_scene(*opened_session, way, server, scene,
                     view.has_window() ? SceneWait::kGround
                     : view.wanted()   ? SceneWait::kLookedAt
                                       : SceneWait::kBytes,
                     kSceneWaitS, config.rate_hz, stop);
  };
  {
    const link::Welcome first = opened_session->welcome();
    view.wait_for(
        {parts.looks_for_twin
             ? "The server's sample is made ready here, so that it can be felt without the link's delay. "
               "The first time this takes some seconds."
             : "The server's sample is on its way, so that it can be drawn.",
         options.server, slave_limits(first), first.start_pos_w_nm,
         [&scene, shown = std::shared_ptr<const surface::HeightGrid>()]() mutable {
           return newest_scene_ground(scene, shown);
         },
         stop_as_by_signal},
        [&] { parts.starter.call(get_ready); });
  }
  // A person has closed the window: nothing was begun, and the session's Bye goes with `farewell`.
  if (stop && view.has_window()) {
    fmt::print(stderr, "stopped by the operator\n");
    return 0;
  }
  link::ClientSession& session = *opened_session;
  // Until the loop begins: a terminal that takes no more text, planning, a recording's file or a window may
  // keep this thread for longer than the server waits.
  std::optional<KeepAwake> awake;
  parts.starter.call([&] { awake.emplace(session, way, server, scene.pipe(), config.rate_hz); });
  if (!no_twin.empty() && !options.quiet && !options.observe) tell_no_twin(no_twin, !file.chooses_method);
  if (wants_twin && twins.empty()) file.station.method = control::Method::kModel;

  const link::Welcome welcome = session.welcome();
  if (!options.quiet && last_run) {
    fmt::print(stderr, "{}\n",
               resumed ? "resuming the session of the last run"
                       : "the session of the last run is gone; this is a new one");
  }
  session_file.keep(welcome.resume_token);
  const std::uint32_t wish =
      tip_wish(options, servers.name(), (welcome.feature_bits & link::kFeatureSharing) != 0);
  // With play-out the controller sees the buffer's delay, not the link's.
  const int delay_samples =
      control::loop_delay_samples(std::max(link.median_s, playout_delay_s(file)), 1 / config.rate_hz);
  if (file.chooses_method) {
    const double answer_s = std::max(link.median_s, playout_delay_s(file));
    file.station.method = control::MethodChoice::at_start({answer_s, 0, true, !twins.empty()});
  }
  const config::SlaveLimits slave = slave_limits(welcome);
  const device::DeviceInfo device_info =
      simulated ? device::sim_device_info(file.plant) : opened.device->info();
  const std::string planned = choose_scaling(file, device_info, slave, delay_samples);
  const station::SlavePort port = slave_port(slave);
  const station::ScalingCheck check = station::check_scaling(config, device_info, port, delay_samples);
  if (!check.safe && !config.allow_unsafe_scaling) {
    throw UserError(check.text + "; " + check.advice);
  }

  std::vector<SimTask> tasks;
  const double start_height_nm = welcome.start_pos_w_nm.z() - welcome.surface_z_w_nm;
  if (simulated) {
    auto device = std::make_unique<device::SimDevice>(
        sim_device_config(file, start_height_nm),
        hand_motion(options, file.task, start_height_nm, options.observe && !view.has_window()));
    if (view.has_window()) tasks = add_tasks(*device, options, file.task, start_height_nm, view.pointer());
    opened.motion = device.get();
    opened.device = std::move(device);
    add_pedals(opened, file.pedal);
  }
  const std::vector<control::CompandingConfig> companding = companding_of_tasks(file, tasks);
  file.station.companding = companding_of(file, simulated ? std::string_view(options.task) : "hand");
  const SessionHand hand{*opened.device, opened.motion, options.duration_s.value_or(0)};
  // Who only looks on has no task that could be over: until stopped, or for as long as was said.
  const bool has_task = hand.motion != nullptr && !(options.observe && !options.duration_s);
  const double session_s = has_task ? hand.motion->motion_duration_s() : hand.duration_s;
  const station::TwinRunConfig twin_settings = twin_config(config.rate_hz);
  MarkRows mark_rows;
  const bool has_twin = !twins.empty();
  const std::uint64_t twin_scene_hash = has_twin ? twins[0]->scene_hash() : 0;
  const auto new_recorder = [&](const RunOptions& run) {
    return make_recorder(run, file, welcome, link, opened, device_info, planned,
                         parts.client_config.nonce_seed, parts.scene_before, scene.bundle().get(),
                         has_twin ? &twin_settings : nullptr, twin_scene_hash,
                         [&mark_rows](std::vector<recording::MarkRow>& rows) { mark_rows.newest(rows); });
  };
  std::unique_ptr<recording::Recorder> recorder = new_recorder(options);
  std::string recorded = options.record;
  if (!options.quiet)
    tell_terms(file, welcome, link, slave.scene_name, check, planned, device_info, !options.record.empty());
  if (!parts.station) {
    parts.station.emplace(config, device_info, port);
  } else {
    parts.station->go_to_scene(config, port, nullptr, welcome.scene_hash);
  }
  station::Station& station = *parts.station;
  if (!twins.empty()) use_twin(std::move(twins), welcome, config, station, options.quiet);
  const MarkRows::Session marks(mark_rows, marked_sample(scene, station));
  RealTimeSession live(hand, servers, servers.as(), session, station, recorder.get(), options.give_up_s,
                       session_s, stop, file.link);
  live.set_scenes(scene_hashes(scenes));
  if (servers.size() > 1) live.set_servers(servers);
  if (options.practice) live.set_practice(servers);
  if (file.chooses_method) live.choose_method();
  live.set_companding(companding);
  // A scale that a person gave is kept.
  if (!planned.empty() && !file.scaling.force && !config.allow_unsafe_scaling) {
    control::ScalingPlanInput input = plan_input(file, device_info, slave, delay_samples);
    input.velocity_scale = config.scaling.velocity;
    live.follow_scaling({input, config.scaling.force});
  }
  if (view_model::ViewRequestHandler* const requests =
          view.begin({config, device_info, slave, welcome.feature_bits, delay_samples, scene_names(scenes),
                      options.server, options.record, tasks, file.plant.workspace_half_m, options.give_up_s,
                      newest_ground(scene, station), options.practice}))
    live.show_on(*requests, stays_open(options, view, simulated));
  live.set_tip_wish(wish);
  if (options.undo_marks_at_s && (welcome.feature_bits & link::kFeatureUndo) == 0)
    throw UserError("--undo-marks-at: the server's sample keeps no marks, or the server cannot undo them");
  if (options.undo_marks_at_s) live.undo_at(*options.undo_marks_at_s);
  live.set_scene_pipe(scene.pipe());
  std::optional<metrics::Exporter> exporter;
  if (!options.metrics.empty()) {
    exporter.emplace(options.metrics, options.metrics_public,
                     [&live](metrics::Page& page) { write_metrics(live.progress(), page); });
    if (!options.quiet && parts.scene_before.empty()) fmt::print(stderr, "metrics at {}\n", exporter->url());
    parts.metrics = address_of(exporter->url());
  }
  // A person at the window wants one from now on.
  const auto begin_recording = [&]() -> std::string {
    if (recorder != nullptr) return recorded;
    RunOptions from_now = options;
    from_now.record = free_recording(kRecordingInWindow);
    recorder = new_recorder(from_now);
    recorded = from_now.record;
    live.record_from_now(*recorder);
    return recorded;
  };
  farewell->leave_to_loop();
  const bool terminal = isatty(STDERR_FILENO) != 0;
  // What follows the loop's end, once: a window may stay open after it.
  bool concluded = false;
  const auto conclude = [&] {
    if (std::exchange(concluded, true)) return;
    if (terminal && !options.quiet) fmt::print(stderr, "\n");
    if (recorder) recorder->close();
    if (live.undo_text() != nullptr) fmt::print("{}\n", live.undo_text());
    if (live.ending() != Ending::kOtherScene) session_file.remove();  // ended by a Bye, one way or the other
    if (!parts.scene_before.empty() || live.ending() == Ending::kOtherScene)
      fmt::print(stderr, "sample '{}'\n", slave.scene_name);
    print_summary(live.summary(), live.timer_stats(), recorder.get(), recorded);
    print_sending(live.progress());
  };
  // A window does not vanish under a person's eyes because the server did, or because the task is done. A run
  // that was told how long it takes, or whose window nobody opened at a terminal, is nobody's to close.
  const auto session_end = [&]() -> view_model::SessionEnd {
    if (live.ending() == Ending::kOtherScene) return {};
    const std::string failure = failure_text(live, station, session, options, servers, config.rate_hz);
    const bool person = isatty(STDIN_FILENO) != 0 && live.ending() != Ending::kStopped;
    if (options.close_at_end || options.duration_s || stop.load() || (failure.empty() && !person)) return {};
    conclude();
    if (!failure.empty())
      fmt::print(stderr, "telenano-master: {}; the window stays until you close it\n", failure);
    std::vector<std::string> lines = end_lines(failure, live.summary());
    if (recorder) lines.push_back(fmt::format("recording {}: {} rows", recorded, recorder->rows_written()));
    return {!failure.empty(), lines};
  };
  std::string frames;
  const ServerNames server_list{connection::server_names(options.server), servers.current()};
  rt::RealtimeConfig realtime;
  realtime.priority = options.realtime_priority;
  realtime.cpu = options.realtime_cpu;
  realtime.hold_cpu_awake = options.cpu_awake;
  {
    std::optional<rt::RealtimeThread> started;
    parts.starter.call([&] {
      started.emplace(realtime, [&](const std::stop_token& end) {
        awake.reset();
        live.run();
        if (live.ending() != Ending::kOtherScene) return;
        // The session goes on: until another thread tends it, which may take a picture or two, this one does.
        const rt::SteadyClock clock;
        loop::SessionTender tender(session, way.datagram(), server, scene.pipe(), clock, config.rate_hz);
        while (!end.stop_requested()) {
          tender.turn();
          way.wait_readable(1'000'000);
        }
      });
    });
    rt::RealtimeThread& thread = *started;
    if (!options.quiet) {
      fmt::print(stderr, "loop: {:g} Hz, {}\n", config.rate_hz, thread.report().text);
      if (!thread.report().advice.empty()) fmt::print(stderr, "{}\n", thread.report().advice);
    }
    const DeviceMonitor monitor({[&live] { return live.finished() ? 0 : live.ticks(); },
                                 [&live] { return live.progress().force_off; }, opened.calls},
                                [&options, terminal](const std::string& text) {
                                  fmt::print(stderr, "{}telenano-master: warning: {}\n",
                                             terminal && !options.quiet ? "\n" : "", text);
                                });
    Progress told;
    auto shown = std::chrono::steady_clock::now();
    const auto look = [&] {
      if (stop.load() && monitor.stuck_ns() > kGiveUpStuckNs) {
        if (recorder) recorder->close();
        end_without_loop(opened.calls);
      }
      const Progress progress = live.progress();
      if (progress.resume_token != 0) session_file.keep(progress.resume_token);
      if (!options.quiet) print_changes(told, progress, terminal);
      if (!options.quiet) print_server(told, progress, server_list, terminal);
      told = progress;
      const auto now = std::chrono::steady_clock::now();
      if (options.quiet || now - shown < (terminal ? kLineAgain : kLineAgainInLog)) return;
      shown = now;
      print_progress(progress, session_s, terminal);
    };
    if (view.wanted()) {
      frames =
          view.run(live, !thread.report().fifo,
                   {look, session_end, [&stop] { return stop.load(); },
                    [&live] { return live.finished() && live.ending() == Ending::kOtherScene; },
                    [&recorder]() -> const recording::Recorder* { return recorder.get(); }, begin_recording});
      if (view.again_wanted()) parts.next->ask(parts.scene_before.empty() ? "" : slave.scene_name);
    }
    while (!live.finished()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      look();
    }
    thread.request_stop();
    thread.join();
  }
  // A recording is closed meanwhile, and a summary told.
  if (live.ending() == Ending::kOtherScene)
    parts.starter.call([&] { parts.awake.emplace(session, way, server, scene.pipe(), config.rate_hz); });
  conclude();
  if (!frames.empty() && !options.quiet) fmt::print(stderr, "{}\n", frames);
  if (live.ending() == Ending::kOtherScene) {
    parts.scene_before = slave.scene_name;
    parts.record = free_recording(recorded);
    return std::nullopt;
  }
  if (live.ending() == Ending::kStopped) fmt::print(stderr, "stopped by the operator\n");
  const std::string failure = failure_text(live, station, session, options, servers, config.rate_hz);
  if (!failure.empty()) throw RunError(failure);
  if (recorder && recorder->failed()) return 1;
  return 0;
}

void go_on(SessionParts& parts) {
  parts.awake.reset();
  parts.last_run = parts.resumed = false;
  parts.twins.clear();
  parts.no_twin.clear();
  parts.looks_for_twin = parts.step_ring > 0;
  if (parts.looks_for_twin && parts.client_config.step_ring == 0) connect_again(parts, parts.step_ring);
}

}  // namespace telenano::app
