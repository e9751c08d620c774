#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/link/client_session.h"
#include "telenano/common/net/udp_batch.h"
#include "tests/studies/bench/motion.h"
#include "tests/studies/bench/paced_load.h"
#include "tests/studies/bench/served.h"
#include "tests/studies/bench/server_bench.h"

namespace telenano::studies {
namespace {

constexpr std::int64_t kOpenNs = 10'000'000'000;

std::int64_t now() noexcept {
  return clock_ns(CLOCK_MONOTONIC);
}

struct Station {
  std::unique_ptr<link::ClientSession> session;
  Motion motion;
  link::Command command;
  std::int64_t tick = 0;
};

/// Stations that share a socket and send together: whole stations cost a processor more than the server has
/// to do for them, and most of that are system calls.
struct Group {
  Group(const net::Address& server, std::size_t together)
      : socket(net::Udp::open_for(server)),
        wire(socket, together + 1) {}  // room for one more tells that all have been fetched

  net::Udp socket;
  net::UdpBatch wire;
  std::vector<Station> stations;
  std::size_t answered =
      0;  // by this station, or the one after it: answers come in the order of the questions
};

using Buffer = std::array<std::uint8_t, link::kMaxDatagramBytes + 1>;

void open(Group& group, const net::Address& server, Station& station, std::uint64_t seed,
          std::uint32_t rate_hz) {
  link::ClientConfig config;
  config.nonce_seed = seed;
  config.rate_hz = rate_hz;
  station.session = std::make_unique<link::ClientSession>(config);
  station.session->start(now());
  Buffer buffer;
  net::Received received;
  const std::int64_t end_ns = now() + kOpenNs;
  while (station.session->state() != link::ClientState::kEstablished) {
    if (now() > end_ns) throw RunError("bench: a session does not open");
    if (const std::size_t n = station.session->poll(now(), buffer))
      group.wire.send({buffer.data(), n}, server);
    group.wire.wait(net::UdpBatch::kShortWaitNs);
    while (group.wire.receive(buffer, received))
      station.session->on_datagram({buffer.data(), std::min(received.size, buffer.size())}, now());
  }
  station.motion = Motion::of(station.session->welcome(), true);
  station.tick = static_cast<std::int64_t>(37 * seed);
}

/// Whose answer this is; each session takes its own only.
Station* taken_by(Group& group, std::span<const std::uint8_t> bytes, std::int64_t came_ns) {
  for (std::size_t i = 0; i < group.stations.size(); ++i) {
    Station& station = group.stations[group.answered];
    group.answered = (group.answered + 1) % group.stations.size();
    if (station.session->on_datagram(bytes, came_ns) == link::ClientEvent::kReply) return &station;
  }
  return nullptr;
}

}  // namespace

PacedResult run_paced(const PacedOptions& o) {
  Served served(scene::load_scene(o.scene), o.server_cpu, false, o.sessions, o.server_priority);
  const PinnedHere pinned(o.client_cpu);
  const net::Address server = served.address();
  std::vector<std::unique_ptr<Group>> groups(o.groups());
  for (auto& group : groups) group = std::make_unique<Group>(server, o.together);
  for (std::size_t i = 0; i < o.sessions; ++i) {
    Group& group = *groups[i % groups.size()];
    open(group, server, group.stations.emplace_back(), i + 1, o.rate_hz);
  }
  PacedRecord account(o);
  Buffer buffer;
  net::Received received;
  // What came since the last look; the kernel knows when.
  const auto take = [&](std::size_t index) {
    Group& group = *groups[index];
    bool any = false;
    while (group.wire.receive(buffer, received)) {
      any = true;
      const std::int64_t came_ns = now() - received.age_ns;
      const Station* const station =
          taken_by(group, {buffer.data(), std::min(received.size, buffer.size())}, came_ns);
      if (station != nullptr)
        account.answered(index, static_cast<std::int64_t>(station->session->reply().command_send_time_ns),
                         came_ns);
    }
    return any;
  };
  const auto send = [&](std::size_t index, std::int64_t now_ns) {
    Group& group = *groups[index];
    for (Station& s : group.stations) {
      s.motion.fill(s.command, s.tick++);
      const std::size_t bytes = s.session->make_command(s.command, now_ns, buffer);
      if (bytes > 0) group.wire.send({buffer.data(), bytes}, server);
    }
    group.wire.flush();
    return group.stations.size();
  };
  return run_at_times(o, groups.size(), account, take, send, [&] { return served.cpu_ns(); });
}

}  // namespace telenano::studies
