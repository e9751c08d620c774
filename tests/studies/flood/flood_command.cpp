#include "tests/studies/flood/flood_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <array>
#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "telenano/common/base/error.h"
#include "tests/studies/flood/flood_station.h"
#include "tests/studies/flood/flooder.h"

namespace telenano::studies {
namespace {

struct FloodOptions {
  std::string server;
  double seconds = 10;
  double rate_per_s = 200000;
  double rate_hz = 1000;
  std::uint64_t seed = 1;
  bool echo = false;
};

/// What any server would do at least: every datagram goes back to where it came from.
class Echo {
 public:
  Echo() : socket_(net::Udp::listen(net::parse_address("127.0.0.1:0", "echo"))), thread_([this] { run(); }) {}
  ~Echo() {
    stop_ = true;
    thread_.join();
  }
  Echo(const Echo&) = delete;
  Echo& operator=(const Echo&) = delete;
  net::Address address() const noexcept { return socket_.local(); }

 private:
  void run() {
    std::array<std::uint8_t, 2048> bytes{};
    net::Received received;
    while (!stop_.load(std::memory_order_relaxed)) {
      socket_.wait_readable(50'000'000);
      while (!stop_.load(std::memory_order_relaxed) && socket_.receive(bytes, received))
        socket_.send({bytes.data(), std::min(received.size, bytes.size())}, received.from);
    }
  }

  net::Udp socket_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

void print(const char* name, const StationRun& run, std::uint64_t flood) {
  const auto us = [](std::int64_t ns) { return 1e-3 * static_cast<double>(ns); };
  fmt::print("{},{:.3f},{:.0f},{},{},{:.4f},{},{},{:.4f},{},{:.1f},{:.1f},{:.1f}\n", name, run.seconds,
             static_cast<double>(flood) / run.seconds, run.ticks, run.missed_ticks, 100 * run.missed(),
             run.asked, run.answered, 100 * run.lost(), run.sessions, us(run.round_trip.percentile_ns(0.5)),
             us(run.round_trip.percentile_ns(0.99)), us(run.round_trip.max_ns()));
  std::fflush(stdout);
}

using Station = StationRun (*)(const net::Address&, double, double, Flooder*);

void alone_and_flooded(const std::string& name, Station station, const net::Address& to,
                       const FloodOptions& o) {
  print((name + "_alone").c_str(), station(to, o.rate_hz, o.seconds, nullptr), 0);
  Flooder flooder(to, o.rate_per_s, o.seed);
  const std::uint64_t before = flooder.sent();
  const StationRun run = station(to, o.rate_hz, o.seconds, &flooder);
  print((name + "_flooded").c_str(), run, flooder.sent() - before);
}

void run(const FloodOptions& o) {
  const net::Address server = net::parse_address(o.server, "--server");
  if (!net::is_loopback(server))
    throw UserError("--server " + o.server + ": a flood goes to this machine only, e.g. 127.0.0.1:5100");
  fmt::print(
      "phase,seconds,flood_per_s,ticks,missed_ticks,missed_percent,asked,answered,lost_percent,sessions,rtt_"
      "p50_us,rtt_p99_us,"
      "rtt_max_us\n");
  alone_and_flooded("session", run_station, server, o);
  if (!o.echo) return;
  const Echo echo;
  alone_and_flooded("echo", run_pinger, echo.address(), o);
}

}  // namespace

void add_flood_command(CLI::App& app) {
  auto o = std::make_shared<FloodOptions>();
  CLI::App* const c = app.add_subcommand(
      "flood",
      "Measure a session with a server on this machine, first undisturbed, then while random, truncated, "
      "forged and replayed datagrams arrive from other sockets; one CSV row per case");
  c->add_option("--server", o->server, "HOST:PORT of telenano-nve serve on loopback, without --keys")
      ->required();
  c->add_option("--seconds", o->seconds, "Duration of each row, s")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 86400.0));
  c->add_option("--rate", o->rate_per_s, "Hostile datagrams per second; the rate reached is reported")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 1e7));
  c->add_option("--rate-hz", o->rate_hz, "Command rate of the session, Hz")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 8000.0));
  c->add_option("--seed", o->seed, "Random seed of the hostile bytes")->capture_default_str();
  c->add_flag("--echo", o->echo, "Measure a bare echo as well, for comparison");
  c->callback([o] { run(*o); });
}

}  // namespace telenano::studies
