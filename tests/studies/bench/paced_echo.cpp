#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "common/net/udp_batch.h"
#include "common/rt/log_histogram.h"
#include "common/rt/realtime_thread.h"
#include "tests/studies/bench/pinned_thread.h"
#include "tests/studies/bench/raw_udp.h"
#include "tests/studies/bench/server_bench.h"

namespace telenano::studies {
namespace {

// Command and reply of a flat sample, as run_capacity_bench tells them.
constexpr std::size_t kCommandBytes = 108;
constexpr std::size_t kReplyBytes = 139;
constexpr std::int64_t kLastAnswersNs = 50'000'000;

struct Group {
  Group(const net::Address& server, std::size_t together)
      : socket(net::Udp::open_for(server)), wire(socket, together + 1) {}
  net::Udp socket;
  net::UdpBatch wire;
};

}  // namespace

PacedResult run_paced_echo(const PacedOptions& o) {
  const RawUdp socket;
  socket.blocking(false);
  std::atomic<std::uint64_t> answered{0};
  PinnedThread echo(o.server_cpu, [&](const std::atomic<bool>& stop) {
    if (o.server_priority > 0) rt::enter_realtime({.priority = o.server_priority});
    echo_batched(socket, kReplyBytes, 0, stop, answered);
  });
  const PinnedHere pinned(o.client_cpu);
  const net::Address server = net::parse_address("127.0.0.1:" + std::to_string(socket.port()), "bench");
  std::vector<std::unique_ptr<Group>> groups((o.sessions + o.together - 1) / o.together);
  for (auto& group : groups) group = std::make_unique<Group>(server, o.together);
  const auto now = [] { return clock_ns(CLOCK_MONOTONIC); };
  PacedResult result;
  rt::LogHistogram service, late;
  std::array<std::uint8_t, 512> buffer{};
  net::Received received;
  const auto take = [&](Group& group) {
    bool any = false;
    while (group.wire.receive(buffer, received)) {
      any = true;
      std::int64_t sent_ns = 0;
      std::memcpy(&sent_ns, buffer.data(), sizeof sent_ns);
      service.add(now() - received.age_ns - sent_ns);
    }
    return any;
  };
  const std::int64_t period_ns = 1'000'000'000 / o.rate_hz;
  const auto n = static_cast<std::int64_t>(groups.size());
  const auto ticks = static_cast<std::int64_t>(o.seconds * o.rate_hz);
  const std::int64_t cpu_before = echo.cpu_ns();
  const std::int64_t start_ns = now() + 1'000'000;
  for (std::int64_t tick = 0; tick < ticks; ++tick) {
    for (std::int64_t i = 0; i < n; ++i) {
      Group& group = *groups[static_cast<std::size_t>(i)];
      take(group);
      const std::int64_t due_ns = start_ns + tick * period_ns + i * period_ns / n;
      std::int64_t now_ns = now();
      while (now_ns < due_ns) now_ns = now();
      late.add(now_ns - due_ns);
      std::memcpy(buffer.data(), &now_ns, sizeof now_ns);
      const std::size_t here =
          o.sessions / groups.size() + (static_cast<std::size_t>(i) < o.sessions % groups.size() ? 1 : 0);
      for (std::size_t k = 0; k < here; ++k) group.wire.send({buffer.data(), kCommandBytes}, server);
      result.commands += here;
      group.wire.flush();
    }
  }
  const std::int64_t end_ns = now();
  result.server_share =
      static_cast<double>(echo.cpu_ns() - cpu_before) / static_cast<double>(end_ns - start_ns);
  while (now() < end_ns + kLastAnswersNs) {
    for (auto& group : groups) take(*group);
  }
  const auto us = [](std::int64_t ns) { return 1e-3 * static_cast<double>(ns); };
  result.replies = service.count();
  result.p50_us = us(service.percentile_ns(0.5));
  result.p99_us = us(service.percentile_ns(0.99));
  result.p999_us = us(service.percentile_ns(0.999));
  result.max_us = us(service.max_ns());
  result.late_p99_us = us(late.percentile_ns(0.99));
  return result;
}

}  // namespace telenano::studies
