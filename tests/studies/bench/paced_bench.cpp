#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "common/base/error.h"
#include "common/link/client_session.h"
#include "common/rt/log_histogram.h"
#include "tests/studies/bench/motion.h"
#include "tests/studies/bench/served.h"
#include "tests/studies/bench/server_bench.h"
#include "tests/support/wire_station.h"

namespace telenano::studies {
namespace {

struct Station {
  std::unique_ptr<support::WireStation> wire;
  Motion motion;
  link::Command command;
  std::int64_t tick = 0;
  std::uint64_t commands = 0;
};

}  // namespace

PacedResult run_paced(const PacedOptions& o) {
  Served served(scene::load_scene(o.scene), o.server_cpu, false, o.sessions);
  const PinnedHere pinned(o.client_cpu);
  std::vector<Station> stations(o.sessions);
  for (std::size_t i = 0; i < o.sessions; ++i) {
    Station& s = stations[i];
    link::ClientConfig config;
    config.nonce_seed = i + 1;
    config.rate_hz = o.rate_hz;
    s.wire = std::make_unique<support::WireStation>(served.address(), config);
    link::Command hold;
    if (!s.wire->exchange(1, hold, 10'000'000'000)) throw RunError("bench: a session does not open");
    s.motion = Motion::of(s.wire->client.welcome(), true);
    s.tick = static_cast<std::int64_t>(37 * i);
  }
  PacedResult result;
  rt::LogHistogram service, late;
  net::Received received;
  std::int64_t start_ns = INT64_MAX;  // answers to what was sent before are not counted
  const auto now = [] { return clock_ns(CLOCK_MONOTONIC); };
  // One datagram at most a call: what is late is found at the next, and the kernel knows when it came.
  const auto take = [&](Station& s) {
    support::WireStation& wire = *s.wire;
    if (!wire.socket.receive(wire.buffer, received)) return false;
    const std::int64_t came_ns = now() - received.age_ns;
    if (wire.client.on_datagram({wire.buffer.data(), received.size}, came_ns) != link::ClientEvent::kReply)
      return true;
    const auto sent_ns = static_cast<std::int64_t>(wire.client.reply().command_send_time_ns);
    if (sent_ns >= start_ns) service.add(came_ns - sent_ns);
    return true;
  };
  const std::int64_t period_ns = 1'000'000'000 / o.rate_hz;
  const auto ticks = static_cast<std::int64_t>(o.seconds * o.rate_hz);
  const std::int64_t cpu_before = served.cpu_ns();
  start_ns = now() + 1'000'000;
  const auto n = static_cast<std::int64_t>(o.sessions);
  for (std::int64_t tick = 0; tick < ticks; ++tick) {
    for (std::int64_t i = 0; i < n; ++i) {
      Station& s = stations[static_cast<std::size_t>(i)];
      const std::int64_t due_ns = start_ns + tick * period_ns + i * period_ns / n;
      take(s);
      std::int64_t now_ns = now();
      while (now_ns < due_ns) now_ns = now();
      late.add(now_ns - due_ns);
      s.motion.fill(s.command, s.tick++);
      const std::size_t bytes = s.wire->client.make_command(s.command, now_ns, s.wire->buffer);
      if (bytes > 0) s.wire->socket.send({s.wire->buffer.data(), bytes}, s.wire->server);
      ++s.commands;
    }
  }
  const std::int64_t end_ns = now();
  result.server_share =
      static_cast<double>(served.cpu_ns() - cpu_before) / static_cast<double>(end_ns - start_ns);
  const std::int64_t last_ns = now() + 200'000'000;
  while (now() < last_ns) {
    bool any = false;
    for (Station& s : stations) any |= take(s);
    if (!any && now() > end_ns + 50'000'000) break;
  }
  for (const Station& s : stations) result.commands += s.commands;
  result.replies = service.count();
  const auto us = [](std::int64_t ns) { return 1e-3 * static_cast<double>(ns); };
  result.p50_us = us(service.percentile_ns(0.5));
  result.p99_us = us(service.percentile_ns(0.99));
  result.p999_us = us(service.percentile_ns(0.999));
  result.max_us = us(service.max_ns());
  result.late_p99_us = us(late.percentile_ns(0.99));
  result.sent_rate_hz = 1e9 * static_cast<double>(ticks * n) / static_cast<double>(end_ns - start_ns);
  return result;
}

}  // namespace telenano::studies
