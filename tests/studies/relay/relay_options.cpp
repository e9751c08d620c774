#include "tests/studies/relay/relay_options.h"

#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "telenano/common/base/error.h"
#include "tests/studies/parse_list.h"
#include "tests/studies/relay/trace_file.h"

namespace telenano::studies {
namespace {

constexpr double kLongest_ms = 60'000;
constexpr double kLongest_s = 1e6;

double in_range(const std::string& flag, double value, double low, double high) {
  // Not "outside": no comparison holds for a NaN.
  if (!(value >= low && value <= high))
    throw UserError(fmt::format("relay: {}: {}; expected {} to {}", flag, value, low, high));
  return value;
}

struct Both {
  double to_server;
  double to_client;
};

Both both(const std::string& flag, const std::string& text, double low, double high) {
  const std::vector<double> values = parse_list(text, "relay: " + flag);
  if (values.size() > 2) {
    throw UserError(
        fmt::format("relay: {}: '{}' has {} numbers; expected one for both ways, or two: to the "
                    "server, to the client",
                    flag, text, values.size()));
  }
  for (const double value : values) in_range(flag, value, low, high);
  return {values.front(), values.back()};
}

std::int64_t ns_of_ms(double ms) {
  return std::llround(ms * 1e6);
}

/// "5:0.5" as two numbers.
Both colon_pair(const std::string& flag, const std::string& text, const std::string& expected) {
  const auto colon = text.find(':');
  if (colon == std::string::npos)
    throw UserError(fmt::format("relay: {}: '{}'; expected {}", flag, text, expected));
  const std::string what = "relay: " + flag;
  const auto first = parse_list(text.substr(0, colon), what);
  const auto second = parse_list(text.substr(colon + 1), what);
  if (first.size() != 1 || second.size() != 1)
    throw UserError(fmt::format("relay: {}: '{}'; expected {}", flag, text, expected));
  return {first[0], second[0]};
}

std::vector<net::Outage> outages_of(const std::string& text) {
  std::vector<net::Outage> outages;
  for (std::size_t begin = 0; !text.empty() && begin <= text.size();) {
    const std::size_t end = std::min(text.find(',', begin), text.size());
    const Both pair =
        colon_pair("--outage", text.substr(begin, end - begin), "START:LENGTH in seconds, e.g. 5:0.5,20:2");
    outages.push_back({std::llround(in_range("--outage", pair.to_server, 0, kLongest_s) * 1e9),
                       std::llround(in_range("--outage", pair.to_client, 0, kLongest_s) * 1e9)});
    begin = end + 1;
  }
  return outages;
}

net::ImpairmentConfig::Jitter jitter_of(const std::string& name) {
  using Jitter = net::ImpairmentConfig::Jitter;
  if (name == "uniform") return Jitter::kUniform;
  if (name == "half-normal") return Jitter::kHalfNormal;
  if (name == "exponential") return Jitter::kExponential;
  throw UserError(fmt::format("relay: --jitter: '{}'; expected uniform, half-normal or exponential", name));
}

void require_possible_bursts(const net::ImpairmentConfig& c) {
  if (c.burst_ns > 0 && c.burst_datagrams > 1)
    throw UserError("relay: --burst and --burst-ms: bursts are counted in one of the two; leave one out");
  // Between two runs of losses there is at least one datagram that arrives.
  const double most = c.burst_datagrams / (c.burst_datagrams + 1);
  if (c.burst_ns == 0 && c.burst_datagrams > 1 && c.loss < 1 && c.loss > most) {
    throw UserError(
        fmt::format("relay: --loss: {} cannot be in runs of {} datagrams; expected at most {:.6g}, "
                    "or longer runs (--burst)",
                    c.loss, c.burst_datagrams, most));
  }
}

}  // namespace

RelayConfig relay_config(const RelayOptions& o) {
  RelayConfig config;
  config.listen = net::parse_address(o.listen, "relay: --listen");
  config.to = net::parse_address(o.to, "relay: --to");
  if (config.to.port == 0)
    throw UserError(fmt::format("relay: --to: '{}': expected the server's port, 1 to 65535", o.to));
  if (config.to == config.listen)
    throw UserError(fmt::format("relay: --to: '{}' is --listen: it would talk to itself", o.to));
  // A server without keys listens on loopback only, so that nobody else reaches it: not by accident through
  // here.
  if (net::is_loopback(config.to) && !net::is_loopback(config.listen) && !o.expose) {
    throw UserError(fmt::format(
        "relay: --listen: '{}' is off loopback and '{}' on it: whoever reaches this machine would "
        "reach that server; listen on 127.0.0.1, or say --expose",
        o.listen, o.to));
  }
  net::ImpairmentConfig& up = config.to_server;
  net::ImpairmentConfig& down = config.to_client;
  const auto set = [&](const std::string& flag, const std::string& text, double low, double high,
                       const auto& put) {
    const Both values = both(flag, text, low, high);
    put(up, values.to_server);
    put(down, values.to_client);
  };
  using Config = net::ImpairmentConfig;
  set("--delay-ms", o.delay_ms, 0, kLongest_ms, [](Config& c, double v) { c.delay_ns = ns_of_ms(v); });
  set("--jitter-ms", o.jitter_ms, 0, kLongest_ms, [](Config& c, double v) { c.jitter_ns = ns_of_ms(v); });
  set("--loss", o.loss, 0, 1, [](Config& c, double v) { c.loss = v; });
  set("--burst", o.burst, 1, 1e6, [](Config& c, double v) { c.burst_datagrams = v; });
  set("--burst-ms", o.burst_ms, 0, kLongest_ms, [](Config& c, double v) { c.burst_ns = ns_of_ms(v); });
  set("--duplicate", o.duplicate, 0, 1, [](Config& c, double v) { c.duplicate = v; });
  set("--reorder", o.reorder, 0, 1, [](Config& c, double v) { c.reorder = v; });
  set("--reorder-ms", o.reorder_ms, 0, kLongest_ms, [](Config& c, double v) { c.reorder_ns = ns_of_ms(v); });
  set("--corrupt", o.corrupt, 0, 1, [](Config& c, double v) { c.corrupt = v; });
  set("--truncate", o.truncate, 0, 1, [](Config& c, double v) { c.truncate = v; });
  set("--rate-bit-s", o.rate_bit_s, 0, 1e10, [](Config& c, double v) {
    if (v > 0) in_range("--rate-bit-s", v, 1000, 1e10);  // below, a datagram takes seconds
    c.rate_bit_s = v;
  });
  set("--queue-bytes", o.queue_bytes, 100, 1e9, [](Config& c, double v) { c.queue_bytes = std::llround(v); });
  set("--drift-ppm", o.drift_ppm, -1000, 1000, [](Config& c, double v) { c.drift_ppm = v; });
  for (net::ImpairmentConfig* c : {&up, &down}) {
    c->jitter = jitter_of(o.jitter);
    c->in_order = !o.any_order;
    c->outages = outages_of(o.outage);
    if (!o.random_outage.empty()) {
      const Both pair =
          colon_pair("--random-outage", o.random_outage, "GAP:LENGTH, mean seconds, e.g. 30:0.5");
      c->outage_gap_ns = std::llround(in_range("--random-outage", pair.to_server, 0.001, kLongest_s) * 1e9);
      c->outage_length_ns = std::llround(in_range("--random-outage", pair.to_client, 0, kLongest_s) * 1e9);
    }
    require_possible_bursts(*c);
  }
  if (!o.trace.empty()) up.trace = down.trace = load_trace(o.trace);
  config.seed = o.seed;
  if (o.max_clients < 1 || o.max_clients > 1024)
    throw UserError(fmt::format("relay: --max-clients: {}; expected 1 to 1024", o.max_clients));
  config.max_clients = o.max_clients;
  config.idle_ns = std::llround(in_range("--idle-s", o.idle_s, 0.1, kLongest_s) * 1e9);
  in_range("--duration-s", o.duration_s, 0, kLongest_s);
  return config;
}

}  // namespace telenano::studies
