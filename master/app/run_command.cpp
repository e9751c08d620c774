#include "master/app/run_command.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <memory>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <thread>

#include "common/base/error.h"
#include "common/base/version.h"
#include "common/link/client_session.h"
#include "common/net/udp.h"
#include "common/recording/recorder.h"
#include "common/recording/summary_builder.h"
#include "common/rt/latest_value.h"
#include "common/rt/periodic_timer.h"
#include "common/rt/realtime_thread.h"
#include "common/rt/steady_clock.h"
#include "master/app/station_file.h"
#include "master/device/sim_device.h"
#include "master/loop/station_loop.h"
#include "master/station/station.h"

namespace telenano::app {
namespace {

struct RunOptions {
  std::string server = "127.0.0.1:5100";
  std::string config_file;
  std::string device = "sim";
  std::string task = "indent";
  std::string script;
  std::optional<double> duration_s;
  std::optional<double> depth_nm;
  std::optional<double> rate_hz;
  std::optional<std::string> method;
  std::optional<double> velocity_scale;
  std::optional<double> force_scale;
  bool allow_unsafe_scaling = false;
  std::string record;
  bool overwrite = false;
  int realtime_priority = 80;
  double connect_timeout_s = 3;
  double give_up_s = 10;
  bool quiet = false;
  std::string command_line;
};

// Signal handlers can reach nothing else.
std::atomic<bool> g_stop{false};
static_assert(std::atomic<bool>::is_always_lock_free);

void catch_signals() {
  g_stop = false;
  struct sigaction action {};
  action.sa_handler = [](int) { g_stop.store(true, std::memory_order_relaxed); };
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  std::signal(SIGXFSZ, SIG_IGN);  // a file that may not grow is a failed write, told in one line, not an end
}

// CLI11's ranges let "nan" through: no comparison fails with it.
void require_numbers(const RunOptions& options) {
  const auto require = [](const char* flag, double value) {
    if (!std::isfinite(value)) throw UserError(fmt::format("{}: {} is no finite number; see --help for its range", flag, value));
  };
  require("--rate", options.rate_hz.value_or(0));
  require("--duration-s", options.duration_s.value_or(0));
  require("--depth-nm", options.depth_nm.value_or(0));
  require("--connect-timeout-s", options.connect_timeout_s);
  require("--give-up-s", options.give_up_s);
}

// Why the loop ended.
enum class Ending : std::uint8_t { kTaskDone, kStopped, kFault, kServerGone };

// Codes of events in a recording besides the station's modes, 0 to 4. Stored in files: never renumber.
constexpr std::uint32_t kEventSilent = 100;
constexpr std::uint32_t kEventSession = 101;  // value: the epoch of the slave's energy book

// What the loop tells the progress line.
struct Progress {
  double time_s = 0;
  double duration_s = 0;
  double tip_height_nm = 0;
  double force_nn = 0;
  double hand_force_n = 0;
  double rtt_us = 0;
  std::int64_t lost = 0;
  double energy_j = 0;
  std::uint32_t mode = 0;
  double silent_s = 0;
};

std::uint64_t random_seed() {
  std::random_device device;
  return (static_cast<std::uint64_t>(device()) << 32) | device();
}

// The file, then the flags, which win.
StationFile station_file(const RunOptions& options) {
  StationFile file = options.config_file.empty() ? StationFile{} : load_station_file(options.config_file);
  station::StationConfig& config = file.station;
  if (options.rate_hz) config.rate_hz = *options.rate_hz;
  if (options.method) config.method = control::parse_method(*options.method);
  if (options.velocity_scale) config.scaling.velocity = *options.velocity_scale;
  if (options.force_scale) config.scaling.force = *options.force_scale;
  if (options.allow_unsafe_scaling) config.allow_unsafe_scaling = true;
  if (options.duration_s) file.task.duration_s = *options.duration_s;
  if (options.depth_nm) file.task.depth_nm = *options.depth_nm;
  finish_station_file(file, options.config_file.empty() ? "command line" : options.config_file);
  return file;
}

// Handshake before there is a station: the slave's limits come with the Welcome.
void connect(link::ClientSession& session, net::Udp& socket, const net::Address& server, double rate_hz,
             const RunOptions& options) {
  const rt::SteadyClock clock;
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer;
  const std::int64_t start_ns = clock.now_ns();
  session.start(start_ns);
  while (session.state() != link::ClientState::kEstablished) {
    const std::int64_t now_ns = clock.now_ns();
    net::Received received;
    while (socket.receive(buffer, received)) {
      if (received.from == server && received.size <= buffer.size()) {
        session.on_datagram(std::span(buffer).first(received.size), now_ns);
      }
    }
    if (session.state() == link::ClientState::kRefused) {
      const link::Refuse& refuse = session.refuse();
      switch (refuse.reason) {
        case link::RefuseReason::kVersion:
          throw RunError(fmt::format("the server at {} speaks protocol version {} to {}, this station {}; update the older one",
                                     options.server, refuse.version_min, refuse.version_max, link::kProtocolVersion));
        case link::RefuseReason::kFull:
          throw RunError(fmt::format("the server at {} has no room for one more session; try again later, or start it "
                                     "with a larger --max-sessions",
                                     options.server));
        case link::RefuseReason::kRate:
          throw RunError(fmt::format("the server at {} does not serve sessions of {} Hz; try a lower --rate",
                                     options.server, rate_hz));
        case link::RefuseReason::kShuttingDown:
          throw RunError(fmt::format("the server at {} is shutting down", options.server));
      }
    }
    if (g_stop) throw RunError("stopped before the server answered");
    if (static_cast<double>(now_ns - start_ns) * 1e-9 > options.connect_timeout_s) {
      const std::uint64_t wrong = session.drops()[link::DropCause::kWrongVersion];
      if (wrong > 0) {
        throw RunError(fmt::format("the server at {} answers in another protocol version than {}; update the older one",
                                   options.server, link::kProtocolVersion));
      }
      throw RunError(fmt::format("no answer from {} within {:g} s; is telenano-nve serve running there, and does the "
                                 "firewall let UDP through?",
                                 options.server, options.connect_timeout_s));
    }
    if (const std::size_t n = session.poll(now_ns, buffer)) socket.send(std::span<const std::uint8_t>(buffer).first(n), server);
    socket.wait_readable(1'000'000);
  }
}

device::IntendedMotion intended_motion(const RunOptions& options, device::TaskOptions task_options, double start_height_nm) {
  const device::Task task = device::parse_task(options.task);
  if (task == device::Task::kScript) {
    if (options.script.empty()) throw UserError("--task script needs --script FILE (CSV: t_s,x_nm,y_nm,z_nm)");
    return device::IntendedMotion::from_csv_file(options.script);
  }
  task_options.start_height_nm = start_height_nm;
  task_options.retract_nm = std::max(task_options.retract_nm, start_height_nm);
  return device::IntendedMotion::for_task(task, task_options);
}

device::SimDeviceConfig sim_device_config(const StationFile& file, double start_height_nm) {
  device::SimDeviceConfig config;
  config.plant = file.plant;
  config.metres_per_nm = file.station.scaling.hand_displacement_m(Vec3::UnitX()).x();
  config.start_height_nm = start_height_nm;
  return config;
}

// Says goodbye for a session that ends before its loop begins, so that the server need not wait for its time-out.
class Farewell {
 public:
  Farewell(link::ClientSession& session, net::Udp& socket, const net::Address& server)
      : session_(session), socket_(socket), server_(server) {}
  ~Farewell() {
    if (!needed_) return;
    std::array<std::uint8_t, link::kMaxDatagramBytes> buffer;
    const std::size_t size = session_.make_bye(link::ByeReason::kStopped, buffer);
    for (int i = 0; i < 3 && size > 0; ++i) socket_.send(std::span<const std::uint8_t>(buffer).first(size), server_);
  }
  Farewell(const Farewell&) = delete;
  Farewell& operator=(const Farewell&) = delete;
  void leave_to_loop() noexcept { needed_ = false; }

 private:
  link::ClientSession& session_;
  net::Udp& socket_;
  net::Address server_;
  bool needed_ = true;
};

void print_progress(const Progress& p, bool terminal) {
  std::string line = fmt::format("{:5.1f}/{:.1f} s  {:<8} tip {:8.2f} nm  force {:8.2f} nN  hand {:6.2f} N  energy {:7.2f} mJ  "
                                 "RTT {:5.0f} us  lost {}",
                                 p.time_s, p.duration_s, station::mode_name(static_cast<station::Mode>(p.mode)),
                                 p.tip_height_nm, p.force_nn, p.hand_force_n, p.energy_j * 1e3, p.rtt_us, p.lost);
  if (p.silent_s > 0.1) line += fmt::format("  server silent for {:.1f} s: force is zero", p.silent_s);
  if (terminal) {
    fmt::print(stderr, "\r{:<150}", line);
    std::fflush(stderr);
  } else {
    fmt::print(stderr, "{}\n", line);
  }
}

// `recorder` may be null. Overruns and missed ticks as the timer counted them: it knows them for certain.
void print_summary(recording::Summary summary, const rt::PeriodicTimerStats& timer, const recording::Recorder* recorder,
                   const std::string& path) {
  summary.overruns = static_cast<std::int64_t>(timer.overruns);
  summary.missed_ticks = static_cast<std::int64_t>(timer.missed);
  if (recorder != nullptr) summary.rows_dropped = recorder->rows_dropped();
  fmt::print(stderr, "summary of {:.1f} s\n{}", summary.duration_s, recording::summary_text(summary));
  if (recorder == nullptr) return;
  fmt::print(stderr, "  {:<36} {}: {} rows{}{}\n", "recording", path, recorder->rows_written(),
             recorder->failed() ? "; stopped early: " : "", recorder->failed() ? recorder->failure() : "");
}

int run(const RunOptions& options) {
  if (options.device != "sim") {
    throw UserError(fmt::format("--device {}: unknown device; this build has: sim", options.device));
  }
  catch_signals();
  require_numbers(options);
  const StationFile file = station_file(options);
  const station::StationConfig& config = file.station;
  intended_motion(options, file.task, 0);  // a bad task or script is found before a server is asked
  const net::Address server = net::parse_address(options.server, "--server");
  if (!net::is_loopback(server)) {
    throw UserError(fmt::format("--server {}: sessions off loopback would travel in the clear, and this version cannot "
                                "encrypt; use a loopback address or a tunnel that ends there",
                                options.server));
  }
  net::Udp socket = net::Udp::open_for(server);
  link::ClientConfig client_config;
  client_config.rate_hz = static_cast<std::uint32_t>(config.rate_hz);
  client_config.nonce_seed = random_seed();
  link::ClientSession session(client_config);
  connect(session, socket, server, config.rate_hz, options);
  Farewell farewell(session, socket, server);

  const link::Welcome welcome = session.welcome();
  const double start_height_nm = welcome.start_pos_w_nm.z() - welcome.surface_z_w_nm;
  const device::IntendedMotion motion = intended_motion(options, file.task, start_height_nm);
  device::SimDevice device(sim_device_config(file, start_height_nm), motion);
  const station::SlavePort port{welcome.coupling_stiffness_n_m, welcome.coupling_damping_n_s_m, welcome.force_max_nn};
  // A command of tick k is answered for tick k+1: one sample of delay.
  const station::ScalingCheck check = station::check_scaling(config, device.info(), port, 1);
  if (!check.safe && !config.allow_unsafe_scaling) {
    throw UserError(check.text + "; " + check.advice);
  }
  const std::string scene_name(welcome.scene_name.text.data(),
                               strnlen(welcome.scene_name.text.data(), welcome.scene_name.text.size()));
  std::unique_ptr<recording::Recorder> recorder;
  if (!options.record.empty()) {
    recording::Configuration about;
    about.title = fmt::format("{} on {}", options.task, scene_name);
    about.program = std::string("telenano-master ") + kVersion;
    about.git_commit = kGitCommit;
    about.command_line = options.command_line;
    about.scene_name = scene_name;
    about.scene_hash = fmt::format("{:016x}", welcome.scene_hash);
    about.station_text = file.text.empty() ? "defaults" : file.text;
    about.seed = fmt::format("{}", client_config.nonce_seed);
    about.rate_hz = config.rate_hz;
    about.extra = describe(config, file.plant);
    about.extra.emplace_back("task", options.task);
    about.extra.emplace_back("server", options.server);
    about.extra.emplace_back("protocol_version", fmt::format("{}", welcome.version));
    about.extra.emplace_back("surface_z_w_nm", fmt::format("{:.17g}", welcome.surface_z_w_nm));
    about.extra.emplace_back("start_pos_w_nm", fmt::format("{:.17g} {:.17g} {:.17g}", welcome.start_pos_w_nm.x(),
                                                           welcome.start_pos_w_nm.y(), welcome.start_pos_w_nm.z()));
    about.extra.emplace_back("coupling_stiffness_n_m", fmt::format("{:.17g}", welcome.coupling_stiffness_n_m));
    about.extra.emplace_back("coupling_damping_n_s_m", fmt::format("{:.17g}", welcome.coupling_damping_n_s_m));
    std::string fault_names;  // of the bits of station_faults, the lowest first
    for (std::uint32_t bit = 0; std::strcmp(station::fault_name(1u << bit), "none") != 0; ++bit) {
      fault_names += fmt::format("{}{}", bit == 0 ? "" : "; ", station::fault_name(1u << bit));
    }
    about.extra.emplace_back("station_fault_names", fault_names);
    recording::RecorderOptions recorder_options;
    recorder_options.path = options.record;
    recorder_options.overwrite = options.overwrite;
    recorder_options.on_failure = [new_line = isatty(STDERR_FILENO) != 0 && !options.quiet](const std::string& text) {
      fmt::print(stderr, "{}telenano-master: warning: {}; the session goes on\n", new_line ? "\n" : "",
                 text);
    };
    recorder = std::make_unique<recording::Recorder>(recorder_options, about);
  }

  if (!options.quiet) {
    fmt::print(stderr, "session {:016x} on scene '{}', method {}, {}\n", welcome.session_id, scene_name,
               control::method_name(config.method), check.text);
  }
  station::Station station(config, device.info(), port);
  const rt::SteadyClock steady_clock;
  loop::StationLoop loop(device, socket, server, session, station, &steady_clock);
  recording::SummaryBuilder summary({config.rate_hz, welcome.surface_z_w_nm});
  rt::LatestValue<Progress> latest;
  std::atomic<bool> finished{false};
  Ending ending = Ending::kTaskDone;

  rt::PeriodicTimerConfig timer_config;
  timer_config.period_ns = std::llround(1e9 / config.rate_hz);
  rt::PeriodicTimerStats timer_stats;
  const double duration_s = motion.duration_s();

  const auto body = [&](std::stop_token) {
    const rt::SteadyClock clock;
    rt::PeriodicTimer timer(timer_config);
    recording::Sample sample;
    std::int64_t stop_ticks = 0;
    std::int64_t after_task_ticks = 0;
    bool silent_noted = false;
    station::Mode last_mode = station::Mode::kIdle;
    std::uint64_t last_sessions = session.sessions();
    std::uint32_t last_epoch = session.welcome().epoch;
    for (;;) {
      const rt::Tick tick = timer.wait();
      const std::int64_t elapsed_ns = timer_config.period_ns * (1 + tick.missed);
      device.advance(elapsed_ns);
      if (g_stop.load(std::memory_order_relaxed)) {
        loop.set_buttons(device::kButtonStop);
        ++stop_ticks;
      }
      if (!device.motion_started() && station.mode() == station::Mode::kEngaged) device.start_motion();
      loop.tick(tick.woke_ns, static_cast<double>(elapsed_ns) * 1e-9, sample);
      sample.lateness_us = static_cast<double>(tick.lateness_ns) * 1e-3;
      sample.overruns = static_cast<std::int64_t>(timer.stats().overruns);
      sample.step_us = static_cast<double>(clock.now_ns() - tick.woke_ns) * 1e-3;
      summary.add(sample);
      if (recorder) {
        recorder->push(sample);
        if (station.mode() != last_mode) {
          recorder->push(recording::make_event(sample.tick, sample.time_s, static_cast<std::uint32_t>(station.mode()),
                                               station::mode_name(station.mode()), sample.station_faults));
          last_mode = station.mode();
        }
        if (session.sessions() != last_sessions) {
          const std::uint32_t epoch = session.welcome().epoch;
          recorder->push(recording::make_event(sample.tick, sample.time_s, kEventSession,
                                               epoch == last_epoch ? "session resumed" : "session resumed in a new epoch",
                                               epoch));
          last_sessions = session.sessions();
          last_epoch = epoch;
        }
      }
      Progress p;
      p.time_s = device.motion_time_s();
      p.duration_s = duration_s;
      p.tip_height_nm = sample.tip_pos_w_nm[2] - welcome.surface_z_w_nm;
      p.force_nn = sample.force_w_nn[2];
      p.hand_force_n = loop.trace().commanded_force_h_n.norm();
      p.rtt_us = sample.rtt_us;
      p.lost = sample.lost;
      p.energy_j = sample.energy_j;
      p.mode = sample.station_mode;
      p.silent_s = std::min(sample.reply_age_ms * 1e-3, sample.time_s);  // before the first reply: since the start
      latest.store(p);

      if (stop_ticks > 20) {  // the stop has reached the server, the hand is free
        ending = Ending::kStopped;
        break;
      }
      if (stop_ticks == 0 && station.mode() == station::Mode::kStopped && ++after_task_ticks > 20) {
        ending = Ending::kFault;
        break;
      }
      if (device.motion_done() && static_cast<double>(++after_task_ticks) > 0.2 * config.rate_hz) break;
      if (p.silent_s > options.give_up_s) {
        ending = Ending::kServerGone;
        break;
      }
      if (p.silent_s > 0.1 && !silent_noted && recorder) {
        recorder->push(recording::make_event(sample.tick, sample.time_s, kEventSilent, "server silent"));
      }
      silent_noted = p.silent_s > 0.1;
    }
    device.write_force(Vec3::Zero());
    loop.say_bye(ending == Ending::kTaskDone ? link::ByeReason::kDone : link::ByeReason::kStopped);
    timer_stats = timer.stats();
    finished = true;
  };

  farewell.leave_to_loop();
  rt::RealtimeConfig realtime;
  realtime.priority = options.realtime_priority;
  {
    rt::RealtimeThread thread(realtime, body);
    if (!options.quiet) {
      fmt::print(stderr, "loop: {:g} Hz, {}\n", config.rate_hz, thread.report().text);
      if (!thread.report().advice.empty()) fmt::print(stderr, "{}\n", thread.report().advice);
    }
    const bool terminal = isatty(STDERR_FILENO) != 0;
    int waited = 0;
    while (!finished) {
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      if (!options.quiet && ++waited % (terminal ? 4 : 40) == 0) print_progress(latest.load(), terminal);
    }
    thread.join();
    if (terminal && !options.quiet) fmt::print(stderr, "\n");
  }
  if (recorder) recorder->close();

  print_summary(summary.finish(), timer_stats, recorder.get(), options.record);
  switch (ending) {
    case Ending::kTaskDone: break;
    case Ending::kStopped: fmt::print(stderr, "stopped by the operator\n"); break;
    case Ending::kFault:
      throw RunError(fmt::format("the station stopped itself: {}; the force is zero",
                                 station::fault_name(station.latched_faults())));
    case Ending::kServerGone:
      throw RunError(fmt::format("the server at {} has been silent for {:g} s; the force is zero", options.server,
                                 options.give_up_s));
  }
  if (recorder && recorder->failed()) return 1;
  return 0;
}

}  // namespace

CLI::App* add_run_command(CLI::App& app, const std::string& command_line, int& exit_code) {
  auto options = std::make_shared<RunOptions>();
  options->command_line = command_line;
  CLI::App* const command = app.add_subcommand("run", "Run one session with a server: feel its sample");
  command->add_option("--server", options->server, "HOST:PORT of telenano-nve serve")->capture_default_str();
  command->add_option("--config", options->config_file, "Station file (TOML); flags win over it");
  command->add_option("--device", options->device, "Haptic device: sim")->capture_default_str();
  command->add_option("--task", options->task, "position | contact | indent | scan | script")->capture_default_str();
  command->add_option("--script", options->script, "CSV with t_s,x_nm,y_nm,z_nm for --task script; z above the surface");
  command->add_option("--duration-s", options->duration_s, "Length of the task (default 10)")->check(CLI::Range(0.5, 3600.0));
  command->add_option("--depth-nm", options->depth_nm, "Intended depth of --task indent (default 5)")
      ->check(CLI::Range(0.0, 1000.0));
  command->add_option("--rate", options->rate_hz, "Hz of the station's loop (default 1000)")->check(CLI::Range(100.0, 8000.0));
  command->add_option("--method", options->method, "How the port is kept passive: none | ks | ks-clamp (default)");
  command->add_option("--velocity-scale", options->velocity_scale, "alpha_v, tip metres per hand metre (default 1e-6)");
  command->add_option("--force-scale", options->force_scale, "alpha_F, hand newtons per tip newton (default 2e7)");
  command->add_flag("--allow-unsafe-scaling", options->allow_unsafe_scaling,
                    "Run beyond the scaling that the device can show passively; force limits stay");
  command->add_option("--record", options->record, "Write a recording (HDF5) to this file");
  command->add_flag("--overwrite", options->overwrite, "Replace the recording if it exists");
  command->add_option("--rt-priority", options->realtime_priority, "SCHED_FIFO priority of the loop; 0 = ordinary")
      ->capture_default_str()
      ->check(CLI::Range(0, 99));
  command->add_option("--connect-timeout-s", options->connect_timeout_s, "How long to wait for the server's first answer")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 60.0));
  command->add_option("--give-up-s", options->give_up_s, "End the session after so much silence")
      ->capture_default_str()
      ->check(CLI::Range(0.5, 86400.0));
  command->add_flag("--quiet", options->quiet, "No progress, only the summary");
  command->footer(
      "Exit code: 0 the task is done, or stopped by a signal; 1 failed while running: no server, server silent for too\n"
      "long, the station stopped itself, recording incomplete (a full disk does not end the session); 2 wrong usage or\n"
      "configuration, nothing was written.");
  command->callback([options, &exit_code] { exit_code = run(*options); });
  return command;
}

}  // namespace telenano::app
