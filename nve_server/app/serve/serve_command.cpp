#include "telenano/nve_server/app/serve/serve_command.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <memory>
#include <optional>
#include <random>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/config/completion.h"
#include "telenano/common/metrics/exporter.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/realtime_thread.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/nve_server/app/serve/audit_log.h"
#include "telenano/nve_server/app/serve/key_watcher.h"
#include "telenano/nve_server/app/serve/reload_watcher.h"
#include "telenano/nve_server/app/serve/serve_afm.h"
#include "telenano/nve_server/app/serve/serve_health.h"
#include "telenano/nve_server/app/serve/serve_log.h"
#include "telenano/nve_server/app/serve/serve_metrics.h"
#include "telenano/nve_server/app/serve/serve_options.h"
#include "telenano/nve_server/app/serve/serve_security.h"
#include "telenano/nve_server/app/serve/serve_web.h"
#include "telenano/nve_server/app/serve/serve_workers.h"
#include "telenano/nve_server/app/serve/server_signals.h"
#include "telenano/nve_server/app/serve/service_notify.h"
#include "telenano/nve_server/app/serve/status_printer.h"
#include "telenano/nve_server/web/web_view.h"

namespace telenano::app {
namespace {

link::SipKey fresh_secret() {
  std::random_device device;  // the kernel's generator
  const auto word = [&] { return (static_cast<std::uint64_t>(device()) << 32) | device(); };
  return {word(), word()};
}

/// What a session may be silent for: the least that one of the scenes asks for.
std::uint32_t timeout_of(const std::vector<server::ServedScene>& scenes) {
  std::uint32_t least_ms = scenes.front().timeout_ms;
  for (const server::ServedScene& scene : scenes) least_ms = std::min(least_ms, scene.timeout_ms);
  return least_ms;
}

/// The scenes, or the AFM's slave. Throws StoppedWhileLoading.
std::vector<server::ServedScene> load(ServeOptions& options, const SceneLoader& load_scene,
                                      const rt::Clock& clock, const ServerSignals& signals,
                                      const std::shared_ptr<spdlog::logger>& log) {
  std::vector<server::ServedScene> scenes;
  if (options.afm.wanted()) {
    scenes.push_back(options.afm.start(clock, signals.stop, options.realtime_priority,
                                       [log](const std::string& text) { log->info("afm: {}", text); }));
  } else {
    for (const std::string& scene : options.scenes) scenes.push_back(load_scene(scene, options.surfaces));
  }
  for (server::ServedScene& scene : scenes) {
    if (!options.no_scene_sharing) break;
    scene.to_fetch.reset();
    scene.why_no_fetch = "--no-scene-sharing";
  }
  return scenes;
}

server::ServerConfig server_config(const ServeOptions& options,
                                   const std::vector<server::ServedScene>& scenes) {
  server::ServerConfig config;
  config.secret = fresh_secret();
  const std::int64_t timeout_ms = options.timeout_ms ? *options.timeout_ms : std::int64_t{timeout_of(scenes)};
  config.table.timeout_ns = timeout_ms * 1'000'000;
  config.table.resume_ns = options.resume_s * std::int64_t{1'000'000'000};
  const bool one_tip = options.share == "one-tip" || (options.share.empty() && scenes.front().one_tip_only);
  config.share = one_tip ? server::Share::kOneTip : server::Share::kPrivate;
  return config;
}

web::WebViewConfig web_config(const ServeOptions& options, const Workers& workers,
                              const std::shared_ptr<web::TipSlots>& tip_slots, const SceneHeights& heights,
                              const std::shared_ptr<spdlog::logger>& log) {
  web::WebViewConfig config;
  config.address = options.web;
  config.anybody = options.web_public;
  config.clients_max = options.web_clients;
  const auto state =
      std::make_shared<WebState>(workers, tip_slots, options.afm.wanted(),
                                 heights && !options.afm.wanted() ? heights() : surface::HeightGrid{});
  config.heights = [state] { return state->heights(); };
  config.state = [state] { return state->next(); };
  config.tell = [log](const std::string& text) { log->info("{}", text); };
  return config;
}

void keep_awake(std::optional<rt::CpuAwake>& awake, spdlog::logger& log) {
  awake.emplace();
  if (awake->held()) {
    log.info("processors are kept awake (/dev/cpu_dma_latency)");
  } else {
    log.warn(
        "--low-latency: /dev/cpu_dma_latency: {}; give this user write access by a udev rule, or run "
        "with --busy-poll; serving without",
        std::strerror(awake->error()));
  }
}

/// The loops, until a signal ends them, and what goes on beside them.
void run_workers(const ServeOptions& options, Workers& workers, ServerSignals& signals,
                 std::optional<AuditLog>& audit, const std::shared_ptr<spdlog::logger>& log) {
  std::optional<KeyWatcher> watcher;
  if (options.security.is_secure()) {
    watcher.emplace(
        options.security.key_list_path(), workers.channels(),
        [&](const std::string& text) { log->warn(text); }, [&](const std::string& text) { log->info(text); });
  }
  const ReloadWatcher reloader(signals.reload, [&] {
    log->info("SIGHUP: {}; the scene stays as it was loaded: restart to serve another one",
              watcher ? "reading the list of keys" : "there are no keys to read");
    if (watcher) watcher->reload();
    if (audit) audit->reopen();
  });
  const StatusPrinter printer(workers, log);
  const ServiceNotify service(workers.loops());
  workers.run(signals, [&log](const rt::RealtimeReport& report) {
    log->info("{}", report.text);
    if (!report.advice.empty()) log->warn("{}", report.advice);
  });
}

void serve(ServeOptions& options, const SceneLoader& load_scene, const SceneHeights& heights) {
  const WorkersConfig workers_config = checked_workers(options);
  const int dscp = net::parse_dscp(options.dscp, "--dscp");
  const rt::SteadyClock clock;
  // Before the scene: a taken port is the quicker answer.
  Workers workers(workers_config, clock);
  const bool marked = dscp == 0 || workers.set_dscp(dscp);

  auto log =
      std::make_shared<spdlog::logger>("telenano-nve", std::make_shared<spdlog::sinks::stderr_sink_mt>());
  log->set_pattern("%H:%M:%S %n: %v");
  ServerSignals& signals = catch_server_signals();
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
    scenes = load(options, load_scene, clock, signals, log);
  } catch (const StoppedWhileLoading&) {
    log->info("stopped while the scene was loaded");
    return;
  }
  const server::ServerConfig config = server_config(options, scenes);
  const bool one_tip = config.share == server::Share::kOneTip;
  // What is shared or shown is of one scene only (checked_workers).
  server::ServedScene& scene = scenes.front();
  std::shared_ptr<web::TipSlots> tip_slots;
  if (!options.web.empty()) {
    tip_slots = std::make_shared<web::TipSlots>();
    scene.make_slave = watched(scene.make_slave, tip_slots);
  }
  workers.prepare(options.security, config, scenes);
  prepared.store(true, std::memory_order_release);
  const bool secure = options.security.is_secure();

  std::optional<AuditLog> audit;
  if (!options.audit.empty()) {
    audit.emplace(options.audit, workers.audit_queues(), secure ? options.security.key_list_path() : "",
                  workers.grant_names(), clock, [log](const std::string& text) { log->warn(text); });
    audit->start({names_of(options), net::to_string(workers.local()), secure, one_tip});
  }
  std::optional<web::WebView> web_view;
  if (tip_slots) web_view.emplace(web_config(options, workers, tip_slots, heights, log));
  log_served(*log, options, workers, scenes, one_tip);
  std::optional<rt::CpuAwake> awake;
  if (options.low_latency) keep_awake(awake, *log);
  if (options.busy_poll && !workers.nic_busy_poll())
    log->info("--busy-poll: spinning without SO_BUSY_POLL, which needs CAP_NET_ADMIN; this does no harm");
  if (!marked) log->warn("--dscp {}: this system does not allow marking; datagrams are sent unmarked", dscp);
  run_workers(options, workers, signals, audit, log);

  audit.reset();
  options.afm.stop();
  log_stopped(*log, workers, secure);
}

/// Who may connect, and how many.
void add_admission_flags(CLI::App& command, ServeOptions& options) {
  command.add_option("--max-sessions", options.max_sessions, "Maximum number of sessions at the same time")
      ->capture_default_str()
      ->check(CLI::Range(1, static_cast<int>(link::SessionTable::kCapacityMax)));
  command
      .add_option("--sessions-per-peer", options.sessions_per_peer,
                  "Maximum number of sessions per key, or per IP address if unencrypted (default: a quarter "
                  "of --max-sessions, at least 4)")
      ->check(CLI::Range(1, static_cast<int>(link::SessionTable::kCapacityMax)));
  command
      .add_option("--local-rights", options.local_rights,
                  "Rights of local users without a key (unencrypted only): observe | operate (default) | "
                  "administer (may take a shared tip from anyone)")
      ->check(CLI::IsMember(std::vector<std::string>(net::kRightsNames.begin(), net::kRightsNames.end())));
  command
      .add_option("--local-users", options.local_users,
                  "Accept only these users of this machine, on loopback, each with a right, e.g. "
                  "lab:operate,root:administer; the kernel identifies the user")
      ->type_name("USER:RIGHT,...");
}

/// How a session is served, from its beginning to its end.
void add_session_flags(CLI::App& command, ServeOptions& options) {
  command.add_flag("--no-scene-sharing", options.no_scene_sharing,
                   "Do not let stations download the scene (description and scan)");
  command
      .add_option("--timeout-ms", options.timeout_ms,
                  "Silence of a station after which its tip is retracted (default: set by the scene)")
      ->check(CLI::Range(10, 60000));
  command
      .add_option("--resume-s", options.resume_s,
                  "How long a station that went silent can still resume its session")
      ->capture_default_str()
      ->check(CLI::Range(0, 3600));
  command
      .add_option("--share", options.share,
                  "private: each session has its own tip and sample (default); one-tip: one session moves "
                  "the tip, the others observe")
      ->check(CLI::IsMember({"private", "one-tip"}));
}

/// What makes replies faster, at a price.
void add_latency_flags(CLI::App& command, ServeOptions& options) {
  CLI::Option* const busy_poll =
      command.add_flag("--busy-poll", options.busy_poll,
                       "Spin instead of sleeping: the lowest latency, but keeps one core busy");
  // A real-time thread that spins would be throttled: 50 ms without a reply in each second.
  command
      .add_option(
          "--rt-priority", options.realtime_priority,
          "SCHED_FIFO priority of the serving threads, and of the thread that reads an AFM's force and "
          "moves its tip, so that other programs delay neither; 0: normal scheduling")
      ->capture_default_str()
      ->check(CLI::Range(0, 99))
      ->excludes(busy_poll);
  command.add_flag(
      "--low-latency", options.low_latency,
      "Keep the processors out of deep sleep while serving: they wake faster, but produce more heat");
}

/// What is kept in files.
void add_file_flags(CLI::App& command, ServeOptions& options) {
  command
      .add_option("--save-surface", options.surfaces,
                  "Save each session's surface with its marks in this folder (SCENE-NUMBER.gsf, next free "
                  "number), every 2 s and at the end of the session")
      ->type_name("DIR");
  command
      .add_option("--audit", options.audit,
                  "Append one JSON line to this file for each session, refusal, change of the shared tip's "
                  "holder and fault; SIGHUP reopens the file")
      ->type_name("FILE");
}

/// What is shown over HTTP.
void add_page_flags(CLI::App& command, ServeOptions& options) {
  command
      .add_option("--metrics", options.metrics,
                  "Serve Prometheus metrics at HOST:PORT, e.g. 127.0.0.1:9464 (port 0: any free port), and "
                  "/healthz and /readyz for monitoring")
      ->type_name("HOST:PORT");
  command.add_flag("--metrics-public", options.metrics_public,
                   "Allow --metrics on a non-loopback address, where anyone can read it");
  command
      .add_option("--web", options.web,
                  "Show the running sessions in a browser, read-only, at HOST:PORT, e.g. 127.0.0.1:8080; "
                  "prints an address with a one-time token")
      ->type_name("HOST:PORT");
  command.add_flag("--web-public", options.web_public,
                   "Allow --web on a non-loopback address, where pictures and token are sent unencrypted");
  command.add_option("--web-clients", options.web_clients, "Maximum number of browsers at the same time")
      ->capture_default_str()
      ->check(CLI::Range(1, 64));
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
  // In the order of the help.
  add_admission_flags(*command, *options);
  add_session_flags(*command, *options);
  add_latency_flags(*command, *options);
  add_file_flags(*command, *options);
  add_page_flags(*command, *options);
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
