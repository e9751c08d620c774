#include "telenano/master/app/run/run_session.h"
#include "telenano/master/app/recordings/free_recording.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/control/method_choice.h"
#include "telenano/common/link/client_session.h"
#include "telenano/common/metrics/exporter.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/recording/recorder.h"
#include "telenano/common/rt/realtime_thread.h"
#include "telenano/common/surface/height_view.h"
#include "telenano/master/app/devices/device_monitor.h"
#include "telenano/master/app/devices/session_device.h"
#include "telenano/master/app/failure_text.h"
#include "telenano/master/app/link_probe.h"
#include "telenano/master/app/plan/station_plan.h"
#include "telenano/master/app/run/early_thread.h"
#include "telenano/master/app/run/keep_awake.h"
#include "telenano/master/app/run/mark_rows.h"
#include "telenano/master/app/run/real_time_session.h"
#include "telenano/master/app/run/run_metrics.h"
#include "telenano/master/app/run/run_recorder.h"
#include "telenano/master/app/run/run_text.h"
#include "telenano/master/app/run/scene_wait.h"
#include "telenano/master/app/run/server_scene.h"
#include "telenano/master/app/run/session_file.h"
#include "telenano/master/app/run/twin_cost.h"
#include "telenano/master/app/station_file.h"
#include "telenano/master/app/stop_signals.h"
#include "telenano/master/app/view/session_view.h"
#include "telenano/master/connection/connect.h"
#include "telenano/master/connection/server_link.h"
#include "telenano/master/device/sim_device.h"
#include "telenano/master/scene/scene_keeper.h"
#include "telenano/master/station/station.h"
#include "telenano/master/twin/load_twin.h"

namespace telenano::app {
namespace {

// The link is measured for so long before the session begins: enough for a median, too short to be noticed.
constexpr double kProbeS = 0.02;
constexpr int kProbeMin = 5;
constexpr int kProbeMax = 40;
// Steps that are kept until the server has made them; twice what is felt without its word.
constexpr double kTwinRingS = 4;
// Of a slave's state, as much as a server gives (server::ServerConfig::snapshot_bytes_most).
constexpr std::size_t kSnapshotBytesMost = std::size_t{16} << 20;
// For a twin nothing can begin without the scene: 4 MB at the server's 464 kB/s, and reading it.
constexpr double kTwinSceneWaitS = 20;
// So long for a twin that nobody asked for: what a scan of 256² takes to look at the first time on a slow
// machine, once (SceneCache keeps it). A lesser method for the whole session is worse than these seconds
// before it.
constexpr double kFirstSceneWaitS = 8;
// A scene that comes for the first time: 265 kB take 0.7 s over 20 ms. What takes longer comes later.
constexpr double kSceneWaitS = 2;
constexpr const char* kRecordingInWindow = "session.h5";  // of one that begins there
constexpr std::chrono::milliseconds kLineAgain(200);
constexpr std::chrono::milliseconds kLineAgainInLog(2000);

// CLI11's ranges let "nan" through: no comparison fails with it.
void require_numbers(const RunOptions& options) {
  const auto require = [](const char* flag, double value) {
    if (!std::isfinite(value))
      throw UserError(fmt::format("{}: {} is no finite number; see --help for its range", flag, value));
  };
  require("--rate", options.rate_hz.value_or(0));
  require("--duration-s", options.duration_s.value_or(0));
  require("--depth-nm", options.depth_nm.value_or(0));
  require("--compand", options.compand.value_or(1));
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

// The file, then the flags, which win.
StationFile station_file(const RunOptions& options) {
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
  if (!options.send_hz.empty()) file.send_hz = parse_send_hz(options.send_hz);
  if (options.depth_nm) file.task.depth_nm = *options.depth_nm;
  finish_station_file(file, options.config_file.empty() ? "command line" : options.config_file);
  return file;
}

device::IntendedMotion intended_motion(const RunOptions& options, device::TaskOptions task_options,
                                       double start_height_nm) {
  const device::Task task = device::parse_task(options.task);
  if (task == device::Task::kScript) {
    if (options.script.empty())
      throw UserError("--task script needs --script FILE (CSV: t_s,x_nm,y_nm,z_nm)");
    return device::IntendedMotion::from_csv_file(options.script);
  }
  task_options.start_height_nm = start_height_nm;
  task_options.retract_nm = std::max(task_options.retract_nm, start_height_nm);
  return device::IntendedMotion::for_task(task, task_options);
}

/// Who only looks on holds the hand still for as long as the task takes: one that the scale of the session
/// has no room for must not end an observer.
device::IntendedMotion hand_motion(const RunOptions& options, const device::TaskOptions& task_options,
                                   double start_height_nm, bool only_looks_on) {
  device::IntendedMotion motion = intended_motion(options, task_options, start_height_nm);
  if (!only_looks_on) return motion;
  const Vec3 start_nm(0, 0, start_height_nm);
  return device::IntendedMotion({{0, start_nm}, {motion.duration_s(), start_nm}});
}

/// What a person can choose in the window besides the task that the session begins with, which is number 0.
std::vector<SimTask> add_tasks(device::SimDevice& hand, const RunOptions& options,
                               device::TaskOptions task_options, double start_height_nm,
                               const rt::LatestValue<device::PointerState>* pointer) {
  task_options.start_height_nm = start_height_nm;
  task_options.retract_nm = std::max(task_options.retract_nm, start_height_nm);
  const std::array<std::pair<device::Task, const char*>, 4> known = {
      {{device::Task::kPosition, "hold above the surface"},
       {device::Task::kContact, "just in contact"},
       {device::Task::kIndent, "press, pull off"},
       {device::Task::kScan, "lines in light contact"}}};
  std::vector<SimTask> tasks;
  const auto tell = [&](const std::string& name, const char* about, int number, bool free = false) {
    tasks.push_back({name, about, hand.reach_nm(number), free});
  };
  const auto first = std::find_if(known.begin(), known.end(), [&](const auto& task) {
    return device::task_name(task.first) == options.task;
  });
  tell(options.task, first == known.end() ? "the way of the file" : first->second, 0);
  for (const auto& [task, about] : known) {
    if (first != known.end() && task == first->first) continue;
    tell(std::string(device::task_name(task)), about,
         hand.add_task(device::IntendedMotion::for_task(task, task_options)));
  }
  if (pointer != nullptr) tell("free hand", "your mouse leads it", hand.add_free_task(*pointer), true);
  return tasks;
}

/// As many as there are tasks.
std::vector<control::CompandingConfig> companding_of_tasks(const StationFile& file,
                                                           const std::vector<SimTask>& tasks) {
  std::vector<control::CompandingConfig> all;
  for (const SimTask& task : tasks) all.push_back(companding_of(file, task.free ? "hand" : task.name));
  return all;
}

/// A window that was opened to look around stays when the first task is done; one that was told which task,
/// or for how long, goes with it.
bool stays_open(const RunOptions& options, const SessionView& view, bool simulated) {
  return simulated && view.has_window() && !options.task_given && !options.duration_s;
}

device::SimDeviceConfig sim_device_config(const StationFile& file, double start_height_nm) {
  device::SimDeviceConfig config;
  config.plant = file.plant;
  config.metres_per_nm = file.station.scaling.hand_displacement_m(Vec3::UnitX()).x();
  config.start_height_nm = start_height_nm;
  return config;
}

// How long a reply is held back at the station; 0 if the newest is taken at once.
double playout_delay_s(const StationFile& file) {
  const link::PlayoutConfig& playout = file.link.playout;
  return playout.mode == link::PlayoutConfig::Mode::kNewest ? 0
                                                            : 1e-9 * static_cast<double>(playout.delay_ns);
}

// How the session will run, and what of the wishes this server or link does not give.
void tell_terms(const StationFile& file, const link::Welcome& welcome, const LinkDelay& link,
                const std::string& scene_name, const station::ScalingCheck& check, const std::string& planned,
                const device::DeviceInfo& device) {
  const control::Method method = file.station.method;
  fmt::print(stderr, "session {:016x} on scene '{}', method {}{}, {}\n", welcome.session_id, scene_name,
             control::method_name(method),
             !file.chooses_method               ? ""
             : method == control::Method::kTwin ? " (the server's scene runs here too)"
                                                : " (by the round trip)",
             check.text);
  const control::Method used = station::usable_method(method, welcome.feature_bits);
  if (used != method) {
    fmt::print(stderr, "note: this server does not offer what method {} needs; running {}\n",
               control::method_name(method), control::method_name(used));
  }
  if (!planned.empty()) fmt::print(stderr, "scaling {}\n", planned);
  if (device.has_force) fmt::print(stderr, "{}\n", damping_text(file, device));
  if (file.redundancy > 0 && (welcome.feature_bits & link::kFeatureRedundancy) == 0)
    fmt::print(stderr, "note: this server does not take repeated commands; running without redundancy\n");
  const double playout_s = playout_delay_s(file);
  if (file.link.playout.mode == link::PlayoutConfig::Mode::kConstant && playout_s < link.p99_s) {
    fmt::print(stderr,
               "note: playout_delay_ms {:g} is less than the link's round trip (p99 {:.1f} ms): what "
               "comes later is not felt\n",
               playout_s * 1e3, link.p99_s * 1e3);
  }
  if (!check.note.empty()) fmt::print(stderr, "note: {}\n", check.note);
  const control::CompandingConfig& companding = file.station.companding;
  if (companding.on() && method == control::Method::kTwin) {
    fmt::print(
        stderr,
        "companding: attraction before contact up to {:g} times as strong, tasks {}; a hand may get {:.3g} "
        "mJ more of it\n",
        companding.gain, file.companding_tasks,
        1e3 * file.station.scaling.hand_energy_j(companding.most_aj()));
  } else if (companding.on()) {
    fmt::print(stderr, "note: companding is felt with method twin only: forces are shown as they are\n");
  }
}

// What is told of a shared tip before the session begins, and what is asked for.
std::uint32_t tip_wish(const RunOptions& options, const std::string& server, bool shared) {
  if (!shared && options.observe) {
    throw RunError(fmt::format(
        "--observe: the server at {} gives each session its own tip, so there is no shared tip to "
        "observe; start the server with --share one-tip",
        server));
  }
  if (!shared && options.take_over && !options.quiet)
    fmt::print(stderr, "note: --take-over: this server gives each session a tip of its own\n");
  if (shared && !options.quiet) {
    fmt::print(stderr, "note: this server's tip is shared: {}\n",
               options.observe
                   ? options.duration_s ? "observing it" : "observing it, until you stop this with Ctrl-C"
               : options.take_over ? "asking for it"
                                   : "taking it if it is free, else observing (--take-over asks for it)");
  }
  if (options.observe) return link::kFlagHandOver;
  return options.take_over ? std::uint32_t{link::kFlagTakeOver} : 0u;
}

station::TwinRunConfig twin_config(double rate_hz) {
  station::TwinRunConfig twin;
  twin.rate_hz = rate_hz;
  twin.ring_s = kTwinRingS;
  twin.look_s = station::kLookAgain_s;
  return twin;
}

std::size_t snapshot_room(const control::LocalSlave& twin) {
  return std::min(twin.snapshot_bytes_max(), kSnapshotBytesMost);
}

/// Says what of the wish for a twin this server does not give.
void use_twin(std::vector<std::unique_ptr<control::LocalSlave>> twins, const link::Welcome& welcome,
              const station::StationConfig& config, station::Station& station, bool quiet) {
  const bool same = twins[0]->scene_hash() == welcome.scene_hash;
  if (!same && !quiet)
    fmt::print(stderr, "note: --scene is another scene than the server's: no twin, method model instead\n");
  station.use_twin(std::make_unique<station::TwinRun>(twin_config(config.rate_hz), std::move(twins[0]),
                                                      std::move(twins[1])));
}

/// Why a tick has no room for this twin; empty: it has.
std::string too_slow(control::LocalSlave& twin, double rate_hz) {
  const double cost_s = twin_step_cost_s(twin, rate_hz);
  if (cost_s <= kTwinShareOfTick / rate_hz) return "";
  return fmt::format(
      "a step of this scene takes {:.0f} us here, more than a third of the tick's {:.0f} us; a lower --rate "
      "leaves room for it",
      1e6 * cost_s, 1e6 / rate_hz);
}

using Twins = std::vector<std::unique_ptr<control::LocalSlave>>;

/// Twins of the server's scene; none, and `why`: there can be none in this session. `wanted`: somebody has
/// asked for the twin; else it is the rule's first choice, nobody waits for it but some seconds, the first
/// time, and what takes its place is the rule's next. The session stays awake meanwhile.
Twins find_twins(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
                 const LinkDelay& link, double rate_hz, bool wanted, bool quiet,
                 scene_store::SceneKeeper& keeper, const std::atomic<bool>& stop, std::string& why) {
  Twins twins;
  if (!session.logs_steps()) {
    why = "this server keeps no log of steps (a real AFM or an older program)";
    return twins;
  }
  if (!wanted && link.median_s > control::MethodChoice::kTwinMost_s) {
    why = fmt::format("the round trip is {:.0f} ms, more than {:.0f} ms", 1e3 * link.median_s,
                      1e3 * control::MethodChoice::kTwinMost_s);
    return twins;
  }
  if (session.welcome().scene.empty()) {
    why = "this server does not share its scene; name it by --scene";
    return twins;
  }
  keeper.start();
  wait_for_scene(session, way, server, keeper, SceneWait::kLookedAt, kSceneWaitS, stop);
  if (!keeper.settled() && !stop) {
    if (!quiet)
      fmt::print(stderr, "note: making the server's scene ready here, which takes longer the first time\n");
    wait_for_scene(session, way, server, keeper, SceneWait::kLookedAt,
                   wanted ? kTwinSceneWaitS : kFirstSceneWaitS, stop);
  }
  const auto scene = keeper.scene();
  if (scene && scene->same_physics) {
    const KeepAwake awake(session, way, server, keeper.pipe());
    twins = twin::decode_twins(scene->bundle, 2);
    why = too_slow(*twins[0], rate_hz);
    if (!why.empty()) twins.clear();
  } else if (scene) {
    why = "this program's physics give the server's scene other bits (another version?)";
  } else if (!keeper.settled()) {
    why = "the server's scene is still being made ready; a later session has it";
  } else {
    why = "the server's scene cannot be fetched; name it by --scene";
  }
  return twins;
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

/// One line of what takes the twin's place, and why.
void tell_no_twin(const std::string& why, bool wanted) {
  fmt::print(stderr, "note: no twin, {}: {}\n",
             wanted ? "method model instead" : "a method by the round trip instead", why);
}

scene_store::SceneKeeperOptions scene_options(const RunOptions& options) {
  scene_store::SceneKeeperOptions scene;
  if (!options.quiet) {
    scene.say = [new_line = isatty(STDERR_FILENO) != 0](const std::string& text) {
      fmt::print(stderr, "{}note: {}\n", new_line ? "\n" : "", text);
    };
  }
  return scene;
}

/// The surface of the scene that is here, each time that it is another one than `shown`; without heights: a
/// plane again.
std::optional<surface::HeightGrid> newest_scene_ground(const scene_store::SceneKeeper& keeper,
                                                       std::shared_ptr<const surface::HeightGrid>& shown) {
  const auto ground = keeper.ground();
  if (ground == shown) return std::nullopt;
  const bool flat = ground == nullptr || ground->z_nm.empty();
  const bool was_flat = shown == nullptr || shown->z_nm.empty();
  shown = ground;
  if (flat && was_flat) return std::nullopt;
  return flat ? surface::HeightGrid{} : *ground;
}

/// The surface with its marks as the twin has it, where it keeps some, else that of the scene that is here:
/// each time that it is another one. A flat one without marks is a plane as it is.
std::function<std::optional<surface::HeightGrid>()> newest_ground(const scene_store::SceneKeeper& keeper,
                                                                  const station::Station& station) {
  return [&keeper, &station, shown = std::shared_ptr<const surface::HeightGrid>(),
          seen = std::pair<const surface::HeightView*, std::uint64_t>()]() mutable
         -> std::optional<surface::HeightGrid> {
    const station::TwinRun* const twin = station.twin();
    const surface::HeightView* const marked = twin != nullptr ? twin->heights() : nullptr;
    const std::pair now(marked, marked != nullptr ? marked->version() : 0);
    if (marked != nullptr && (now.second > 0 || seen.second > 0)) {
      if (now == seen) return std::nullopt;
      seen = now;
      return marked->heights();
    }
    return newest_scene_ground(keeper, shown);
  };
}

/// What the recording is told of marks, of the same samples as newest_ground().
MarkRows::Sample marked_sample(const scene_store::SceneKeeper& keeper, const station::Station& station) {
  return {[&station]() -> const surface::HeightView* {
            const station::TwinRun* const twin = station.twin();
            return twin != nullptr ? twin->heights() : nullptr;
          },
          [&keeper] {
            const auto scene = keeper.scene();
            return scene ? scene->checked.ground : surface::HeightGrid{};
          }};
}

/// What lasts while a session goes from one of the server's scenes to another.
struct SessionParts {
  const RunOptions& options;
  const std::atomic<bool>& stop;
  const StationFile& file;
  bool simulated;
  scene_store::SceneKeeper& scene;
  SessionView& view;
  std::optional<NextRun>& next;
  SessionDevice& opened;
  connection::ServerList& servers;
  SessionFile& session_file;
  bool wants_twin;
  bool last_run;
  bool resumed = false;
  std::size_t step_ring;  ///< that is asked for where there may be a twin
  link::ClientConfig& client_config;
  std::optional<link::ClientSession>& session;
  std::optional<connection::Farewell>& farewell;
  std::vector<SceneChoice> scenes{};
  // From scene to scene.
  bool looks_for_twin;
  Twins twins{};
  std::string no_twin{};
  std::string record;          ///< file of the next recording; empty: none
  std::string metrics{};       ///< address
  std::string scene_before{};  ///< name of the one that was left; empty: this is the first
  std::optional<station::Station> station{};
  EarlyThread starter{};
  std::optional<KeepAwake> awake{};  ///< between the loops of two scenes
};

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

/// The session at one scene; its exit code, or nothing: it goes on at another one.
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
                     kSceneWaitS, stop);
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
  parts.starter.call([&] { awake.emplace(session, way, server, scene.pipe()); });
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
  if (!options.quiet) tell_terms(file, welcome, link, slave.scene_name, check, planned, device_info);
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
    throw UserError("--undo-marks-at: the server's sample keeps no marks, or it cannot take them back");
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
        SessionTender tender(session, way.datagram(), server, scene.pipe());
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
    parts.starter.call([&] { parts.awake.emplace(session, way, server, scene.pipe()); });
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

/// Before the session begins at another scene: a file of the first one's is of no use, and a log of steps that was given
/// up there may be of use here.
void go_on(SessionParts& parts) {
  parts.awake.reset();
  parts.last_run = parts.resumed = false;
  parts.twins.clear();
  parts.no_twin.clear();
  parts.looks_for_twin = parts.step_ring > 0;
  if (parts.looks_for_twin && parts.client_config.step_ring == 0) connect_again(parts, parts.step_ring);
}

}  // namespace

int run_session(const RunOptions& options, std::optional<NextRun>& next) {
  const std::atomic<bool>& stop = catch_stop_signals();
  require_numbers(options);
  StationFile file = station_file(options);
  const station::StationConfig& config = file.station;
  const DeviceSpec spec = parse_device_spec(options.device.value_or(file.device.kind));
  const bool simulated = spec.kind == DeviceSpec::Kind::kSim;
  // What is wrong with a task, a script or a device is found before a server is asked.
  if (simulated) intended_motion(options, file.task, 0);
  // Forks, so before whatever has threads, keys or sockets.
  scene_store::SceneKeeper scene(scene_options(options));
  SessionView view(options.view, spec.kind == DeviceSpec::Kind::kMouse);
  if (view.has_window()) next.emplace();
  SessionDevice opened = open_session_device(spec, file.device, options.home, view.pointer());
  if (!simulated) add_pedals(opened, file.pedal);
  if (!options.quiet && !simulated) {
    fmt::print(stderr, "device: {}\n", opened.description);
    for (const std::string& note : opened.notes) fmt::print(stderr, "note: {}\n", note);
  }
  const int dscp = net::parse_dscp(options.dscp, "--dscp");
  connection::ServerList servers(options);
  if (dscp != 0 && !servers.set_dscp(dscp))
    fmt::print(stderr, "note: --dscp {}: this system does not let datagrams be marked\n", options.dscp);
  if (options.practice) {
    servers.practise(*options.practice);
    const std::string text = link::practice_text(*options.practice);
    if (!options.quiet && !text.empty()) fmt::print(stderr, "practice link: {}\n", text);
  }
  link::ClientConfig client_config;
  client_config.rate_hz = static_cast<std::uint32_t>(config.rate_hz);
  client_config.nonce_seed = connection::random_nonce_seed();
  SessionFile session_file(options.session_file);
  client_config.resume_token = session_file.token();
  client_config.redundancy = static_cast<std::size_t>(file.redundancy);
  // Only a replay needs to know in which order the slave stepped.
  if (options.record.empty()) client_config.feature_bits &= ~std::uint64_t{link::kFeatureStepHistory};
  // The scene is run here too. Whether it is the server's own, the Welcome says.
  Twins twins;
  std::string no_twin;
  const bool last_run = client_config.resume_token != 0;
  const bool wants_twin = file.station.method == control::Method::kTwin && !file.chooses_method;
  if (!options.scene.empty()) {
    twins = twin::load_twins(options.scene, 2);
    no_twin = too_slow(*twins[0], config.rate_hz);
    if (!no_twin.empty()) twins.clear();
  }
  // Where nobody has said which, the sample itself is the first choice. Who only looks on feels nothing, but
  // sees by it the marks that others make.
  const bool looks_on = options.observe && (view.wanted() || !options.record.empty());
  bool looks_for_twin =
      options.scene.empty() && (wants_twin || (file.chooses_method && (!options.observe || looks_on)));
  if (looks_for_twin || !twins.empty())
    client_config.step_ring = static_cast<std::size_t>(kTwinRingS * config.rate_hz);
  if (!twins.empty()) client_config.snapshot_bytes = snapshot_room(*twins[0]);
  std::optional<link::ClientSession> opened_session;
  std::optional<connection::Farewell> farewell;
  connection::connect_to_any(opened_session, client_config, servers, config.rate_hz, stop,
                             [&](const std::string& why) {
                               if (!options.quiet) fmt::print(stderr, "note: {}\n", why);
                             });
  // Until the loop begins the session is this server's.
  connection::ServerLink& way = servers.link();
  const net::Address server = servers.address();
  farewell.emplace(*opened_session, way.datagram(), server);
  const bool resumed = opened_session->resumed_unknown_account();
  const std::vector<SceneChoice> scenes = list_scenes(*opened_session, way, server, scene.pipe(), stop);
  if (!scenes.empty() && !options.quiet)
    fmt::print(stderr, "note: this server has {} scenes: {} (--server-scene NAME)\n", scenes.size(),
               names_of(scenes));
  if (!options.server_scene.empty())
    choose_scene(*opened_session, way, server, scene.pipe(), options.server_scene, scenes, stop);
  SessionParts parts{.options = options,
                     .stop = stop,
                     .file = file,
                     .simulated = simulated,
                     .scene = scene,
                     .view = view,
                     .next = next,
                     .opened = opened,
                     .servers = servers,
                     .session_file = session_file,
                     .wants_twin = wants_twin,
                     .last_run = last_run,
                     .resumed = resumed,
                     .step_ring = client_config.step_ring,
                     .client_config = client_config,
                     .session = opened_session,
                     .farewell = farewell,
                     .scenes = scenes,
                     .looks_for_twin = looks_for_twin,
                     .twins = std::move(twins),
                     .no_twin = no_twin,
                     .record = options.record};
  while (true) {
    if (const std::optional<int> exit_code = run_at_scene(parts)) return *exit_code;
    go_on(parts);
  }
}

}  // namespace telenano::app
