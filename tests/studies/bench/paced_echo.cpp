#include <array>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/net/udp_batch.h"
#include "telenano/common/rt/realtime_thread.h"
#include "tests/studies/bench/paced_load.h"
#include "tests/studies/bench/pinned_thread.h"
#include "tests/studies/bench/raw_udp.h"
#include "tests/studies/bench/server_bench.h"

namespace telenano::studies {
namespace {

// Command and reply of a flat sample, as run_capacity_bench tells them.
constexpr std::size_t kCommandBytes = 108;
constexpr std::size_t kReplyBytes = 139;

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
  std::vector<std::unique_ptr<Group>> groups(o.groups());
  for (auto& group : groups) group = std::make_unique<Group>(server, o.together);
  PacedRecord account(o);
  std::array<std::uint8_t, 512> buffer{};
  net::Received received;
  const auto take = [&](std::size_t index) {
    bool any = false;
    while (groups[index]->wire.receive(buffer, received)) {
      any = true;
      std::int64_t sent_ns = 0;
      std::memcpy(&sent_ns, buffer.data(), sizeof sent_ns);
      account.answered(index, sent_ns, clock_ns(CLOCK_MONOTONIC) - received.age_ns);
    }
    return any;
  };
  const auto send = [&](std::size_t index, std::int64_t now_ns) {
    std::memcpy(buffer.data(), &now_ns, sizeof now_ns);
    const std::size_t here = o.in_group(index, groups.size());
    for (std::size_t k = 0; k < here; ++k) groups[index]->wire.send({buffer.data(), kCommandBytes}, server);
    groups[index]->wire.flush();
    return here;
  };
  return run_at_times(o, groups.size(), account, take, send, [&] { return echo.cpu_ns(); });
}

}  // namespace telenano::studies
