#include "tests/studies/relay/relay_command.h"

#include <fmt/format.h>
#include <sys/prctl.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <memory>
#include <string>

#include "telenano/common/config/print.h"
#include "telenano/common/rt/steady_clock.h"
#include "tests/studies/relay/relay.h"
#include "tests/studies/relay/relay_options.h"

namespace telenano::studies {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;
// A signal that comes between the look at the flag and the wait must not be slept over for long.
constexpr std::int64_t kLongestWait_ns = 50'000'000;

// Signal handlers can reach nothing else.
std::atomic<bool> g_stop{false};

void catch_stop_signals() {
  g_stop = false;
  struct sigaction action {};
  action.sa_handler = [](int) { g_stop.store(true, std::memory_order_relaxed); };
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

std::string in_words(const net::ImpairmentCounts& now, const net::ImpairmentCounts& before) {
  return fmt::format("{} in, {} out, {} lost", now.sent - before.sent, now.delivered - before.delivered,
                     now.lost - before.lost);
}

void print_summary(const Relay& relay) {
  fmt::print(
      "direction,sent,delivered,lost_chance,lost_outage,lost_trace,lost_rate,lost_room,duplicated,reordered,"
      "corrupted,truncated,too_long,not_sent,late_p50_us,late_p99_us,late_max_us\n");
  const auto row = [](const char* name, const Relay::Direction& d) {
    const net::ImpairmentCounts& c = d.impairment.counts;
    const auto us = [](std::int64_t ns) { return static_cast<double>(ns) * 1e-3; };
    fmt::print("{},{},{},{},{},{},{},{},{},{},{},{},{},{},{:.1f},{:.1f},{:.1f}\n", name, c.sent, c.delivered,
               c.lost_chance, c.lost_outage, c.lost_trace, c.lost_rate, c.lost_room, c.duplicated,
               c.reordered, c.corrupted, c.truncated, d.too_long, d.not_sent, us(d.late.percentile_ns(0.5)),
               us(d.late.percentile_ns(0.99)), us(d.late.max_ns()));
  };
  row("to_server", relay.to_server());
  row("to_client", relay.to_client());
}

void run(const RelayOptions& options) {
  const RelayConfig config = relay_config(options);
  catch_stop_signals();
  // The kernel else gathers wake-ups within 50 µs, which would be jitter that nobody asked for.
  ::prctl(PR_SET_TIMERSLACK, 1UL);
  const rt::SteadyClock clock;
  Relay relay(config, clock);
  config::print(stderr, "telenano-lab: relay on {} to {}, seed {}\n", net::to_string(relay.local()),
                net::to_string(config.to), config.seed);
  const std::int64_t end_ns =
      options.duration_s > 0 ? static_cast<std::int64_t>(options.duration_s * 1e9) : INT64_MAX;
  std::int64_t next_line_ns = kSecond;
  net::ImpairmentCounts up, down;
  for (std::int64_t now = 0; now < end_ns && !g_stop.load(std::memory_order_relaxed); now = relay.now_ns()) {
    relay.step(std::clamp<std::int64_t>(std::min(end_ns, next_line_ns) - now, 0, kLongestWait_ns));
    if (relay.now_ns() < next_line_ns) continue;
    const net::ImpairmentCounts& up_now = relay.to_server().impairment.counts;
    const net::ImpairmentCounts& down_now = relay.to_client().impairment.counts;
    if (!options.quiet) {
      config::print(stderr, "{} s: {} clients; to server {}; to client {}\n", next_line_ns / kSecond,
                    relay.clients().now, in_words(up_now, up), in_words(down_now, down));
    }
    up = up_now;
    down = down_now;
    next_line_ns += kSecond;
  }
  const Relay::Clients& clients = relay.clients();
  config::print(stderr,
                "telenano-lab: relay ends; {} clients came, {} left idle, {} datagrams of others refused\n",
                clients.seen, clients.idled, clients.refused);
  print_summary(relay);
}

}  // namespace

void add_relay_command(CLI::App& app) {
  auto o = std::make_shared<RelayOptions>();
  CLI::App* const c = app.add_subcommand(
      "relay",
      "Relay UDP datagrams between stations and a server, and disturb them like a bad link. A,B: values to "
      "the server and to the station; one value: both. Times of outages and traces start with the relay. "
      "Prints CSV at the end, one row per direction");
  c->add_option("--listen", o->listen, "HOST:PORT for the stations; port 0: any free port")->required();
  c->add_option("--to", o->to, "HOST:PORT of the server")->required();
  const auto number = [&](const char* flag, std::string& value, const char* text) {
    c->add_option(flag, value, text)->capture_default_str();
  };
  number("--delay-ms", o->delay_ms, "One-way delay, A[,B]; 0 to 60000");
  number("--jitter-ms", o->jitter_ms,
         "Random additional delay, A[,B]: its width, standard deviation or mean; 0 to 60000");
  number("--jitter", o->jitter, "uniform | half-normal | exponential");
  c->add_flag("--any-order", o->any_order,
              "Let jitter reorder datagrams; otherwise a late datagram delays those behind it");
  number("--loss", o->loss, "Probability of loss, A[,B]; 0 to 1");
  number("--burst", o->burst,
         "Mean length of a loss burst in datagrams (Gilbert-Elliott), A[,B]; 1: independent losses");
  number("--burst-ms", o->burst_ms, "Mean duration of a loss burst, instead of --burst, A[,B]; 0 to 60000");
  number("--duplicate", o->duplicate, "Probability that a datagram is duplicated, A[,B]; 0 to 1");
  number("--reorder", o->reorder, "Probability that a datagram is held back, A[,B]; 0 to 1");
  number("--reorder-ms", o->reorder_ms, "How long it is held back, A[,B]; 0 to 60000");
  number("--corrupt", o->corrupt, "Probability that one bit is flipped, A[,B]; 0 to 1");
  number("--truncate", o->truncate,
         "Probability that a datagram is truncated to a random length, A[,B]; 0 to 1");
  number("--rate-bit-s", o->rate_bit_s,
         "Capacity of the link, headers included, A[,B]; 0: unlimited, or 1000 to 1e10");
  number("--queue-bytes", o->queue_bytes,
         "Queue in front of the link, A[,B]; datagrams that do not fit are lost; 100 to 1e9");
  number("--drift-ppm", o->drift_ppm,
         "Growth of the delay, in parts per million of the elapsed time, A[,B]; -1000 to 1000");
  c->add_option("--outage", o->outage, "Outages START:LENGTH,... in seconds");
  c->add_option("--random-outage", o->random_outage,
                "Random outages GAP:LENGTH: mean time between outages and mean duration, s");
  c->add_option("--trace", o->trace, "CSV file time_s,delay_ms,lost; repeated, in both directions");
  c->add_option("--seed", o->seed, "Random seed; the same seed gives the same faults")->capture_default_str();
  c->add_option("--max-clients", o->max_clients, "Maximum number of stations at the same time; 1 to 1024")
      ->capture_default_str();
  c->add_option("--idle-s", o->idle_s, "Silence after which a station loses its place, s; 0.1 to 1e6")
      ->capture_default_str();
  c->add_option("--duration-s", o->duration_s, "Duration, s; 0: until SIGINT or SIGTERM")
      ->capture_default_str();
  c->add_flag("--expose", o->expose, "Allow a non-loopback --listen for a server on loopback");
  c->add_flag("--quiet", o->quiet, "Do not print a status line every second");
  c->callback([o] { run(*o); });
}

}  // namespace telenano::studies
