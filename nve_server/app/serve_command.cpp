#include "nve_server/app/serve_command.h"

#include <fmt/format.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <thread>
#include <utility>

#include "common/metrics/exporter.h"
#include "common/net/udp.h"
#include "common/rt/steady_clock.h"
#include "nve_server/app/key_watcher.h"
#include "nve_server/app/reload_watcher.h"
#include "nve_server/app/serve_metrics.h"
#include "nve_server/app/serve_security.h"
#include "nve_server/app/server_signals.h"
#include "nve_server/app/service_notify.h"
#include "nve_server/server/server_loop.h"

namespace telenano::app {
namespace {

link::SipKey fresh_secret() {
  std::random_device device;  // the kernel's generator
  const auto word = [&] { return (static_cast<std::uint64_t>(device()) << 32) | device(); };
  return {word(), word()};
}

/// How much may wait for the loop before the kernel drops it, whoever sent it.
std::string buffer_text(std::size_t granted) {
  const std::string text = fmt::format("receive buffer {} KiB", granted / 1024);
  if (granted >= net::Udp::kBufferBytes) return text;
  return text +
         fmt::format(" of {} KiB asked: bursts are lost sooner; raise it with sysctl -w net.core.rmem_max={}",
                     net::Udp::kBufferBytes / 1024, net::Udp::kBufferBytes);
}

/// Prints what goes on, from a thread of its own: the loop neither formats nor writes.
class StatusPrinter {
 public:
  /// `channels` may be null: there are none in the clear.
  StatusPrinter(const server::LoopStatus& status, const security::SecurityCounters* channels,
                std::shared_ptr<spdlog::logger> log)
      : status_(status), channels_(channels), log_(std::move(log)), thread_([this] { run(); }) {}
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
      const std::uint64_t exchanges = status_.exchanges.load(std::memory_order_relaxed);
      const std::uint64_t sessions = status_.sessions.load(std::memory_order_relaxed);
      if (sessions > 0 || exchanges != last_exchanges) {
        log_->info("sessions {}  exchanges/s {:.0f}  drops {}  opened {}  timed out {}", sessions,
                   static_cast<double>(exchanges - last_exchanges) / static_cast<double>(kPeriod.count()),
                   status_.drops.load(std::memory_order_relaxed),
                   status_.opened.load(std::memory_order_relaxed),
                   status_.timed_out.load(std::memory_order_relaxed));
      }
      const std::uint64_t holdings = status_.holdings.load(std::memory_order_relaxed);
      if (holdings != last_holdings) log_->info("the tip went to a session {} times", holdings);
      last_holdings = holdings;
      last_exchanges = exchanges;
      if (channels_ == nullptr) continue;
      // Strangers and forgers are told of, whether or not there are sessions.
      const std::string channels = text_of(*channels_);
      if (channels != last_channels) log_->info("channels: {}", channels);
      last_channels = channels;
    }
  }

  const server::LoopStatus& status_;
  const security::SecurityCounters* channels_;
  std::shared_ptr<spdlog::logger> log_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool done_ = false;
  std::thread thread_;
};

struct ServeOptions {
  std::string scene;
  std::string surfaces;
  std::string listen = "127.0.0.1:5100";
  std::size_t max_sessions = 64;
  std::optional<int> timeout_ms;  // left out: as the scene says
  int resume_s = 30;
  std::string share;  // left out: as the scene's slave must be, else private
  bool busy_poll = false;
  std::string metrics;
  bool metrics_public = false;
  std::string dscp = "ef";
  ServeSecurity security;
};

void serve(const ServeOptions& options, const SceneLoader& load_scene) {
  const net::Address address = net::parse_address(options.listen, "--listen");
  options.security.check(options.listen, net::is_loopback(address));
  const int dscp = net::parse_dscp(options.dscp, "--dscp");
  net::Udp socket = net::Udp::listen(address);  // before the scene: a taken port is the quicker answer
  const bool marked = dscp == 0 || socket.set_dscp(dscp);
  const rt::SteadyClock clock;
  const std::unique_ptr<security::DtlsServer> secure =
      options.security.is_secure() ? options.security.make(options.max_sessions, socket, clock) : nullptr;
  server::ServedScene scene = load_scene(options.scene, options.surfaces);
  server::ServerConfig config;
  config.secret = fresh_secret();
  config.table.capacity = options.max_sessions;
  const std::int64_t timeout_ms = options.timeout_ms ? *options.timeout_ms : std::int64_t{scene.timeout_ms};
  config.table.timeout_ns = timeout_ms * 1'000'000;
  config.table.resume_ns = options.resume_s * std::int64_t{1'000'000'000};
  const bool one_tip = options.share == "one-tip" || (options.share.empty() && scene.one_tip_only);
  config.share = one_tip ? server::Share::kOneTip : server::Share::kPrivate;
  server::Server server(config, std::move(scene));

  server::LoopStatus status;
  const security::SecurityCounters* const channels = secure ? &secure->counters() : nullptr;
  std::optional<metrics::Exporter> exporter;
  if (!options.metrics.empty()) {
    exporter.emplace(options.metrics, options.metrics_public,
                     [&](metrics::Page& page) { write_metrics(status, channels, page); });
  }

  auto log =
      std::make_shared<spdlog::logger>("telenano-nve", std::make_shared<spdlog::sinks::stderr_sink_mt>());
  log->set_pattern("%H:%M:%S %n: %v");
  ServerSignals& signals = catch_server_signals();
  log->info("serving {} on {}{}{}", options.scene, net::to_string(socket.local()),
            secure ? ", encrypted" : "", one_tip ? ", one tip for all" : "");
  log->info("{}", buffer_text(socket.receive_buffer_bytes()));
  if (exporter) log->info("metrics at {}", exporter->url());
  if (!marked)
    log->warn("--dscp {}: this system does not let datagrams be marked; they are sent unmarked", dscp);
  {
    std::optional<KeyWatcher> watcher;
    if (secure) {
      watcher.emplace(
          options.security.key_list_path(), *secure, [&](const std::string& text) { log->warn(text); },
          [&](const std::string& text) { log->info(text); });
    }
    const ReloadWatcher reloader(signals.reload, [&] {
      log->info("SIGHUP: {}; the scene stays as it was loaded: restart to serve another one",
                watcher ? "reading the list of keys" : "there are no keys to read");
      if (watcher) watcher->reload();
    });
    const StatusPrinter printer(status, channels, log);
    const ServiceNotify service(status);
    server::LoopOptions loop_options;
    loop_options.busy_poll = options.busy_poll;
    loop_options.shutdown.at_once = &signals.at_once;
    server::run_loop(
        server, secure ? static_cast<net::Datagram&>(*secure) : socket, clock,
        [&](std::int64_t timeout_ns) { socket.wait_readable(timeout_ns); }, signals.stop, loop_options,
        status);
  }

  std::string drops;
  for (std::size_t i = 1; i < link::kDropCauseCount; ++i) {
    const auto cause = static_cast<link::DropCause>(i);
    if (server.drops()[cause] == 0) continue;
    drops += std::string(drops.empty() ? "" : ", ") + link::name(cause) + " " +
             std::to_string(server.drops()[cause]);
  }
  log->info("stopped: {} exchanges in {} sessions ({} resumed); dropped: {}", server.counters().exchanges,
            server.counters().opened, server.counters().resumed, drops.empty() ? "none" : drops);
  if (server.counters().recovered > 0)
    log->info("{} lost commands were repeated in time", server.counters().recovered);
  if (secure) log->info("channels: {}", text_of(secure->counters()));
}

}  // namespace

CLI::App* add_serve_command(CLI::App& app, SceneLoader load_scene, int& exit_code) {
  auto options = std::make_shared<ServeOptions>();
  CLI::App* const command = app.add_subcommand("serve", "Serve sessions of a scene over UDP");
  command
      ->add_option("--scene", options->scene,
                   "Scene: a file (TOML), or the name of one that came with the program, e.g. flakes")
      ->required();
  command->add_option("--listen", options->listen, "HOST:PORT; port 0 takes any free one")
      ->capture_default_str();
  command->add_option("--max-sessions", options->max_sessions, "Sessions at once")
      ->capture_default_str()
      ->check(CLI::Range(1, 256));
  command
      ->add_option("--timeout-ms", options->timeout_ms,
                   "Silence after which a session's slave retracts; left out: as the scene says")
      ->check(CLI::Range(10, 60000));
  command->add_option("--resume-s", options->resume_s, "How long a silent session can be resumed")
      ->capture_default_str()
      ->check(CLI::Range(0, 3600));
  command
      ->add_option(
          "--share", options->share,
          "private: each session has a tip and a sample of its own (default); one-tip: one session moves "
          "the tip, the others observe")
      ->check(CLI::IsMember({"private", "one-tip"}));
  command->add_flag("--busy-poll", options->busy_poll,
                    "Spin instead of sleeping: quickest answers, one core busy");
  command
      ->add_option("--save-surface", options->surfaces,
                   "Folder for each session's marked surface (SCENE-NUMBER.gsf), written when it ends")
      ->type_name("DIR");
  command
      ->add_option("--metrics", options->metrics,
                   "Answer Prometheus at HOST:PORT, e.g. 127.0.0.1:9464; port 0 takes any free one")
      ->type_name("HOST:PORT");
  command->add_flag("--metrics-public", options->metrics_public,
                    "Let --metrics listen off loopback, where anybody can read it");
  command
      ->add_option(
          "--dscp", options->dscp,
          "Marking of what is sent, for routers that look at it: ef (46, expedited forwarding), none, 0-63")
      ->capture_default_str();
  options->security.add_flags(*command);
  command->callback([options, load = std::move(load_scene), &exit_code] {
    serve(*options, load);
    exit_code = 0;
  });
  return command;
}

}  // namespace telenano::app
