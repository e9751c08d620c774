#include "telenano/nve_server/app/serve/serve_command.h"

#include <fmt/format.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <thread>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/config/completion.h"
#include "telenano/common/metrics/exporter.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/realtime_thread.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/nve_server/app/serve/audit_log.h"
#include "telenano/nve_server/app/serve/drain_watcher.h"
#include "telenano/nve_server/app/serve/key_watcher.h"
#include "telenano/nve_server/app/serve/reload_watcher.h"
#include "telenano/nve_server/app/serve/serve_afm.h"
#include "telenano/nve_server/app/serve/serve_health.h"
#include "telenano/nve_server/app/serve/serve_metrics.h"
#include "telenano/nve_server/app/serve/serve_security.h"
#include "telenano/nve_server/app/serve/serve_web.h"
#include "telenano/nve_server/app/serve/serve_workers.h"
#include "telenano/nve_server/app/serve/server_signals.h"
#include "telenano/nve_server/app/serve/service_notify.h"
#include "telenano/nve_server/web/web_view.h"

namespace telenano::app {
namespace {

link::SipKey fresh_secret() {
  std::random_device device;  // the kernel's generator
  const auto word = [&] { return (static_cast<std::uint64_t>(device()) << 32) | device(); };
  return {word(), word()};
}

/// How much may wait for the loop before the kernel drops it, whoever sent it.
std::string buffer_text(std::size_t granted) {
  std::string text = fmt::format("receive buffer {} KiB", granted / 1024);
  if (granted >= net::Udp::kBufferBytes) return text;
  return text + fmt::format(
                    " of the {} KiB asked for: bursts may be lost; raise the limit with sysctl -w "
                    "net.core.rmem_max={}",
                    net::Udp::kBufferBytes / 1024, net::Udp::kBufferBytes);
}

/// Prints what goes on, from a thread of its own: the loop neither formats nor writes.
class StatusPrinter {
 public:
  StatusPrinter(const Workers& workers, std::shared_ptr<spdlog::logger> log)
      : workers_(workers), log_(std::move(log)), thread_([this] { run(); }) {}
  ~StatusPrinter() {
    {
      const std::lock_guard lock(mutex_);
      done_ = true;
    }
    wake_.notify_all();
    thread_.join();
  }

 private:
  static constexpr std::chrono::seconds kPeriod{5};

  void run() {
    std::uint64_t last_exchanges = 0;
    std::uint64_t last_holdings = 0;
    std::string last_channels;
    std::unique_lock lock(mutex_);
    while (!wake_.wait_for(lock, kPeriod, [this] { return done_; })) {
      const WorkersStatus status = workers_.status();
      const std::uint64_t exchanges = status.exchanges;
      if (status.sessions > 0 || exchanges != last_exchanges) {
        log_->info("sessions {}  exchanges/s {:.0f}  drops {}  opened {}  timed out {}", status.sessions,
                   static_cast<double>(exchanges - last_exchanges) / static_cast<double>(kPeriod.count()),
                   status.drops, status.opened, status.timed_out);
      }
      if (status.holdings != last_holdings) log_->info("the tip went to a session {} times", status.holdings);
      last_holdings = status.holdings;
      last_exchanges = exchanges;
      if (workers_.channels().empty()) continue;
      // Strangers and forgers are told of, whether or not there are sessions.
      const std::string channels = workers_.channels_text();
      if (channels != last_channels) log_->info("channels: {}", channels);
      last_channels = channels;
    }
  }

  const Workers& workers_;
  std::shared_ptr<spdlog::logger> log_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool done_ = false;
  std::thread thread_;
};

struct ServeOptions {
  std::vector<std::string> scenes;
  std::string surfaces;
  std::string listen = "127.0.0.1:5100";
  std::size_t max_sessions = 64;
  std::optional<std::size_t> sessions_per_peer;  // left out: a quarter of all
  std::string local_rights;                      // left out: operate
  std::string local_users;                       // left out: every local user
  std::optional<int> timeout_ms;                 // left out: as the scene says
  int resume_s = 30;
  std::optional<int> drain_s;  // left out: SIGTERM does not drain, and a drain has no end of its own
  bool no_scene_sharing = false;
  std::string share;  // left out: as the scene's slave must be, else private
  std::size_t workers = 1;
  bool busy_poll = false;
  bool low_latency = false;
  int realtime_priority = 0;
  std::string checkpoints;
  std::string audit;
  std::string metrics;
  bool metrics_public = false;
  std::string web;
  bool web_public = false;
  std::size_t web_clients = 8;
  std::string dscp = "ef";
  ServeSecurity security;
  ServeAfm afm;

  /// The one that sessions begin in; empty: none was given.
  std::string scene() const { return scenes.empty() ? "" : scenes.front(); }
};

/// What is kept, shared or shown of one scene only.
void check_several(const ServeOptions& options) {
  if (options.scenes.size() < 2) return;
  for (std::size_t i = 1; i < options.scenes.size(); ++i) {
    if (std::find(options.scenes.begin(), options.scenes.begin() + static_cast<std::ptrdiff_t>(i),
                  options.scenes[i]) != options.scenes.begin() + static_cast<std::ptrdiff_t>(i))
      throw UserError("--scene " + options.scenes[i] + ": given twice; give each scene once");
  }
  if (options.afm.wanted())
    throw UserError(
        "--scene: given several times, but an AFM has one sample: the one under its tip; leave it out");
  if (options.share == "one-tip")
    throw UserError(
        "--share one-tip: with several --scene each session has a tip of its own; serve one scene, or leave "
        "this out");
  if (!options.checkpoints.empty())
    throw UserError("--checkpoint: keeps sessions of one scene; serve one --scene, or leave this out");
  if (!options.web.empty()) throw UserError("--web: shows one scene; serve one --scene, or leave this out");
}

std::vector<server::ServedScene> load_scenes(const ServeOptions& options, const SceneLoader& load_scene) {
  std::vector<server::ServedScene> scenes;
  for (const std::string& scene : options.scenes) scenes.push_back(load_scene(scene, options.surfaces));
  return scenes;
}

/// What a session may be silent for: the least that one of the scenes asks for.
std::uint32_t timeout_of(const std::vector<server::ServedScene>& scenes) {
  std::uint32_t least_ms = scenes.front().timeout_ms;
  for (const server::ServedScene& scene : scenes) least_ms = std::min(least_ms, scene.timeout_ms);
  return least_ms;
}

/// For the log: what is served.
std::string names_of(const ServeOptions& options) {
  std::string names = options.afm.served(options.scene());
  for (std::size_t i = 1; i < options.scenes.size(); ++i) names += ", " + options.scenes[i];
  return names;
}

void serve(ServeOptions& options, const SceneLoader& load_scene, const SceneHeights& heights) {
  check_several(options);
  options.afm.check(options.scene(), options.share, options.workers);
  const net::Address address = net::parse_address(options.listen, "--listen");
  options.security.check(options.listen, net::is_loopback(address));
  if (!options.local_rights.empty() && options.security.is_secure())
    throw UserError(
        "--local-rights: with --keys every station has the rights of its key (telenano-nve keys new "
        "--rights); omit --local-rights");
  std::optional<LocalUserList> local_users;
  if (!options.local_users.empty()) {
    if (options.security.is_secure() || !options.local_rights.empty())
      throw UserError("--local-users: lists who may connect without a key; omit --keys and --local-rights");
    local_users = LocalUserList::parse(options.local_users);
  }
  if (!options.checkpoints.empty()) {
    if (options.afm.wanted())
      throw UserError(
          "--checkpoint: an AFM's tip and sample cannot be moved to another server; omit --checkpoint");
    if (options.share == "one-tip")
      throw UserError("--checkpoint: a shared tip cannot be saved; omit --share one-tip or --checkpoint");
    CheckpointKeeper::require_folder(options.checkpoints);
  }
  const int dscp = net::parse_dscp(options.dscp, "--dscp");
  const rt::SteadyClock clock;
  // Before the scene: a taken port is the quicker answer.
  WorkersConfig workers_config{address, options.workers, options.max_sessions, options.busy_poll,
                               options.realtime_priority};
  workers_config.sessions_per_peer =
      options.sessions_per_peer.value_or(default_sessions_per_peer(options.max_sessions));
  if (!options.local_rights.empty()) workers_config.local_rights = *net::parse_rights(options.local_rights);
  workers_config.local_users = std::move(local_users);
  workers_config.audit = !options.audit.empty();
  workers_config.checkpoints = !options.checkpoints.empty();
  Workers workers(workers_config, clock);
  const bool marked = dscp == 0 || workers.set_dscp(dscp);

  auto log =
      std::make_shared<spdlog::logger>("telenano-nve", std::make_shared<spdlog::sinks::stderr_sink_mt>());
  log->set_pattern("%H:%M:%S %n: %v");
  ServerSignals& signals = catch_server_signals(options.drain_s.has_value());
  // Before the scene too: who asks for /readyz is told that it starts. The channels come with the scene.
  std::atomic<bool> prepared{false};
  std::optional<metrics::Exporter> exporter;
  if (!options.metrics.empty()) {
    exporter.emplace(
        options.metrics, options.metrics_public,
        [&](metrics::Page& page) {
          const bool known = prepared.load(std::memory_order_acquire);
          write_metrics(workers.loops(), known ? workers.channels() : std::vector<security::DtlsServer*>(),
                        page);
          options.afm.write_metrics(page);
        },
        health_pages(workers.loops(), options.max_sessions, signals, clock));
    log->info("metrics at {}", exporter->url());
  }
  std::vector<server::ServedScene> scenes;
  try {
    if (options.afm.wanted()) {
      scenes.push_back(options.afm.start(clock, signals.stop,
                                         [log](const std::string& text) { log->info("afm: {}", text); }));
    } else {
      scenes = load_scenes(options, load_scene);
    }
  } catch (const StoppedWhileLoading&) {
    log->info("stopped while the scene was loaded");
    return;
  }
  for (server::ServedScene& scene : scenes) {
    if (!options.no_scene_sharing) break;
    scene.to_fetch.reset();
    scene.why_no_fetch = "--no-scene-sharing";
  }
  // What is kept, shared or shown is of one scene only (check_several).
  server::ServedScene& scene = scenes.front();
  server::ServerConfig config;
  config.secret = fresh_secret();
  const std::int64_t timeout_ms = options.timeout_ms ? *options.timeout_ms : std::int64_t{timeout_of(scenes)};
  config.table.timeout_ns = timeout_ms * 1'000'000;
  config.table.resume_ns = options.resume_s * std::int64_t{1'000'000'000};
  const bool one_tip = options.share == "one-tip" || (options.share.empty() && scene.one_tip_only);
  config.share = one_tip ? server::Share::kOneTip : server::Share::kPrivate;
  std::shared_ptr<web::TipSlots> tip_slots;
  if (!options.web.empty()) {
    tip_slots = std::make_shared<web::TipSlots>();
    scene.make_slave = watched(scene.make_slave, tip_slots);
  }
  std::optional<CheckpointKeeper> keeper;
  if (!options.checkpoints.empty()) {
    keeper.emplace(CheckpointKeeper::Config{options.checkpoints,
                                            {scene.hash, scene.physics},
                                            scene.make_slave,
                                            options.resume_s * std::int64_t{1000},
                                            [log](const std::string& text) { log->warn("{}", text); },
                                            [log](const std::string& text) { log->info("{}", text); },
                                            &signals.drain},
                   workers.mail());
  }
  workers.prepare(options.security, config, scenes, keeper ? &*keeper : nullptr);
  if (keeper) keeper->start();
  prepared.store(true, std::memory_order_release);
  const bool secure = options.security.is_secure();

  std::optional<AuditLog> audit;
  if (!options.audit.empty()) {
    audit.emplace(options.audit, workers.audit_queues(), secure ? options.security.key_list_path() : "",
                  workers.grant_names(), clock, [log](const std::string& text) { log->warn(text); });
    audit->start({names_of(options), net::to_string(workers.local()), secure, one_tip});
  }
  std::optional<web::WebView> web_view;
  if (tip_slots) {
    web::WebViewConfig web_config;
    web_config.address = options.web;
    web_config.anybody = options.web_public;
    web_config.clients_max = options.web_clients;
    const auto state =
        std::make_shared<WebState>(workers, tip_slots, options.afm.wanted(),
                                   heights && !options.afm.wanted() ? heights() : surface::HeightGrid{});
    web_config.heights = [state] { return state->heights(); };
    web_config.state = [state] { return state->next(); };
    web_config.tell = [log](const std::string& text) { log->info("{}", text); };
    web_view.emplace(std::move(web_config));
  }

  log->info("serving {} on {}{}{}{}", names_of(options), net::to_string(workers.local()),
            secure ? ", encrypted" : "", one_tip ? ", one tip for all" : "",
            options.workers > 1 ? ", " + std::to_string(options.workers) + " workers" : "");
  for (const server::ServedScene& one : scenes) {
    if (one.to_fetch)
      log->info("stations may fetch the scene: {} bytes, {:016x}", one.to_fetch->offer.bytes,
                one.to_fetch->offer.name());
    else if (!one.why_no_fetch.empty())
      log->info("stations cannot fetch the scene: {}", one.why_no_fetch);
  }
  log->info("{}", buffer_text(workers.receive_buffer_bytes()));
  std::optional<rt::CpuAwake> awake;
  if (options.low_latency) {
    awake.emplace();
    if (awake->held()) {
      log->info("processors are kept awake (/dev/cpu_dma_latency)");
    } else {
      log->warn(
          "--low-latency: /dev/cpu_dma_latency: {}; give this user write access by a udev rule, or run "
          "with --busy-poll; serving without",
          std::strerror(awake->error()));
    }
  }
  if (options.busy_poll && !workers.nic_busy_poll())
    log->info("--busy-poll: spinning without SO_BUSY_POLL, which needs CAP_NET_ADMIN; this does no harm");
  if (!marked) log->warn("--dscp {}: this system does not allow marking; datagrams are sent unmarked", dscp);
  {
    std::optional<KeyWatcher> watcher;
    if (secure) {
      watcher.emplace(
          options.security.key_list_path(), workers.channels(),
          [&](const std::string& text) { log->warn(text); },
          [&](const std::string& text) { log->info(text); });
    }
    const ReloadWatcher reloader(signals.reload, [&] {
      log->info("SIGHUP: {}; the scene stays as it was loaded: restart to serve another one",
                watcher ? "reading the list of keys" : "there are no keys to read");
      if (watcher) watcher->reload();
      if (audit) audit->reopen();
    });
    const DrainWatcher drainer({&signals.drain, &signals.stop, options.drain_s, workers.loops(),
                                [&](const std::string& text) { log->info(text); }},
                               clock);
    signals.serves = true;
    const StatusPrinter printer(workers, log);
    const ServiceNotify service(workers.loops());
    workers.run(signals, [&log](const rt::RealtimeReport& report) {
      log->info("{}", report.text);
      if (!report.advice.empty()) log->warn("{}", report.advice);
    });
  }

  keeper.reset();
  audit.reset();
  options.afm.stop();
  const server::ServerCounters counters = workers.counters();
  const link::DropCounters dropped = workers.drops();
  std::string drops;
  for (std::size_t i = 1; i < link::kDropCauseCount; ++i) {
    const auto cause = static_cast<link::DropCause>(i);
    if (dropped[cause] == 0) continue;
    drops +=
        std::string(drops.empty() ? "" : ", ") + link::name(cause) + " " + std::to_string(dropped[cause]);
  }
  log->info("stopped: {} exchanges in {} sessions ({} resumed{}); dropped: {}", counters.exchanges,
            counters.opened, counters.resumed,
            counters.moved_in > 0 ? ", " + std::to_string(counters.moved_in) + " by another worker" : "",
            drops.empty() ? "none" : drops);
  if (counters.taken_up > 0 || counters.handed_out > 0)
    log->info("checkpoints: {} sessions taken up, {} handed out", counters.taken_up, counters.handed_out);
  if (counters.scene_chunks > 0) log->info("{} pieces of the scene were fetched", counters.scene_chunks);
  if (counters.deferred > 0 || counters.cut > 0)
    log->info("beyond their share of the server: {} commands waited for later ones, {} steps were cut",
              counters.deferred, counters.cut);
  if (counters.switched > 0) log->info("switches of a session to another scene: {}", counters.switched);
  if (counters.recovered > 0) log->info("{} lost commands were repeated in time", counters.recovered);
  if (secure) log->info("channels: {}", workers.channels_text());
  if (workers.refused_local_users() > 0)
    log->info("--local-users: {} datagrams of others", workers.refused_local_users());
}

}  // namespace

CLI::App* add_serve_command(CLI::App& app, SceneLoader load_scene, int& exit_code, SceneHeights heights) {
  auto options = std::make_shared<ServeOptions>();
  CLI::App* const command = app.add_subcommand("serve", "Serve a scene to stations over UDP");
  command
      ->add_option(
          "--scene", options->scenes,
          "Scene for --slave nve: a file (TOML) or the name of a supplied scene, e.g. flakes. May be given "
          "several times: a session begins in the first, and its station may choose another")
      ->type_name(config::kSceneOrFile)
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->allow_extra_args(false);
  options->afm.add_flags(*command);
  command->add_option("--listen", options->listen, "HOST:PORT to listen on; port 0: any free port")
      ->capture_default_str();
  command->add_option("--max-sessions", options->max_sessions, "Maximum number of sessions at the same time")
      ->capture_default_str()
      ->check(CLI::Range(1, static_cast<int>(link::SessionTable::kCapacityMax)));
  command
      ->add_option("--sessions-per-peer", options->sessions_per_peer,
                   "Maximum number of sessions per key, or per IP address if unencrypted (default: a quarter "
                   "of --max-sessions, at least 4)")
      ->check(CLI::Range(1, static_cast<int>(link::SessionTable::kCapacityMax)));
  command
      ->add_option("--local-rights", options->local_rights,
                   "Rights of local users without a key (unencrypted only): observe | operate (default) | "
                   "administer (may take a shared tip from anyone)")
      ->check(CLI::IsMember(std::vector<std::string>(net::kRightsNames.begin(), net::kRightsNames.end())));
  command
      ->add_option("--local-users", options->local_users,
                   "Accept only these users of this machine, on loopback, each with a right, e.g. "
                   "lab:operate,root:administer; the kernel identifies the user")
      ->type_name("USER:RIGHT,...");
  command
      ->add_option("--workers", options->workers,
                   "Number of serving threads; a station's address and port decide which thread serves it")
      ->capture_default_str()
      ->check(CLI::Range(1, 64));
  command->add_flag("--no-scene-sharing", options->no_scene_sharing,
                    "Do not let stations download the scene (description and scan)");
  command
      ->add_option("--timeout-ms", options->timeout_ms,
                   "Silence of a station after which its tip is retracted (default: set by the scene)")
      ->check(CLI::Range(10, 60000));
  command
      ->add_option("--resume-s", options->resume_s,
                   "How long a station that went silent can still resume its session")
      ->capture_default_str()
      ->check(CLI::Range(0, 3600));
  command
      ->add_option(
          "--drain-seconds", options->drain_s,
          "On SIGTERM, refuse new sessions and exit when the last one ends, or after this many seconds; a "
          "second SIGTERM exits at once. SIGUSR1 drains without a time limit, even without this flag")
      ->check(CLI::Range(1, 86400));
  command
      ->add_option("--share", options->share,
                   "private: each session has its own tip and sample (default); one-tip: one session moves "
                   "the tip, the others observe")
      ->check(CLI::IsMember({"private", "one-tip"}));
  CLI::Option* const busy_poll =
      command->add_flag("--busy-poll", options->busy_poll,
                        "Spin instead of sleeping: the lowest latency, but each worker keeps one core busy");
  // A real-time thread that spins would be throttled: 50 ms without a reply in each second.
  command
      ->add_option("--rt-priority", options->realtime_priority,
                   "SCHED_FIFO priority of the serving threads, so that other programs do not delay replies; "
                   "0: normal scheduling")
      ->capture_default_str()
      ->check(CLI::Range(0, 99))
      ->excludes(busy_poll);
  command->add_flag(
      "--low-latency", options->low_latency,
      "Keep the processors out of deep sleep while serving: they wake faster, but produce more heat");
  command
      ->add_option("--save-surface", options->surfaces,
                   "Save each session's surface with its marks in this folder (SCENE-NUMBER.gsf, next free "
                   "number), every 2 s and at the end of the session")
      ->type_name("DIR");
  command
      ->add_option("--checkpoint", options->checkpoints,
                   "Save each session's tip, marks and energy account in this folder, every second and at "
                   "the end; only this user may have access to it. After a restart, or on another server "
                   "with the same folder and scene, the sessions continue")
      ->type_name("DIR");
  command
      ->add_option("--audit", options->audit,
                   "Append one JSON line to this file for each session, refusal, change of the shared tip's "
                   "holder and fault; SIGHUP reopens the file")
      ->type_name("FILE");
  command
      ->add_option("--metrics", options->metrics,
                   "Serve Prometheus metrics at HOST:PORT, e.g. 127.0.0.1:9464 (port 0: any free port), and "
                   "/healthz and /readyz for monitoring")
      ->type_name("HOST:PORT");
  command->add_flag("--metrics-public", options->metrics_public,
                    "Allow --metrics on a non-loopback address, where anyone can read it");
  command
      ->add_option("--web", options->web,
                   "Show the running sessions in a browser, read-only, at HOST:PORT, e.g. 127.0.0.1:8080; "
                   "prints an address with a one-time token")
      ->type_name("HOST:PORT");
  command->add_flag("--web-public", options->web_public,
                    "Allow --web on a non-loopback address, where pictures and token are sent unencrypted");
  command->add_option("--web-clients", options->web_clients, "Maximum number of browsers at the same time")
      ->capture_default_str()
      ->check(CLI::Range(1, 64));
  command
      ->add_option("--dscp", options->dscp,
                   "DSCP marking of outgoing packets, for routers that use it: ef (46, expedited "
                   "forwarding), none, 0-63")
      ->capture_default_str();
  options->security.add_flags(*command);
  command->callback([options, load = std::move(load_scene), heights = std::move(heights), &exit_code] {
    serve(*options, load, heights);
    exit_code = 0;
  });
  return command;
}

}  // namespace telenano::app
