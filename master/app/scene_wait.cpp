#include "master/app/scene_wait.h"

#include <array>
#include <cmath>
#include <span>

#include "common/rt/steady_clock.h"

namespace telenano::app {

void wait_for_scene(link::ClientSession& session, ServerLink& way, const net::Address& server,
                    scene_store::SceneKeeper& keeper, bool looked_at, double wait_s,
                    const std::atomic<bool>& stop) {
  constexpr std::int64_t kAwakeNs = 20'000'000;  // the shortest time-out of a scene is 50 ms
  const rt::SteadyClock clock;
  net::Datagram& socket = way.datagram();
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer;
  const std::int64_t end_ns = clock.now_ns() + std::llround(1e9 * wait_s);
  std::int64_t next_ns = clock.now_ns();
  while (!stop && session.has_session() && clock.now_ns() < end_ns) {
    net::Received received;
    while (socket.receive(buffer, received)) {
      if (!(received.from == server) || received.size > buffer.size()) continue;
      const auto event =
          session.on_datagram(std::span(buffer).first(received.size), clock.now_ns() - received.age_ns);
      if (event == link::ClientEvent::kSceneChunk) keeper.pipe().take(session.incoming().scene_chunk);
    }
    if (keeper.settled() || (!looked_at && keeper.bundle())) return;
    if (clock.now_ns() >= next_ns) {
      link::Command command;
      command.tip_pos_w_nm = session.welcome().start_pos_w_nm;
      command.flags = link::kFlagHandOver;  // who waits need not hold a shared tip
      const std::int64_t now_ns = clock.now_ns();
      const std::size_t size = session.make_command(command, now_ns, buffer);
      socket.send(std::span<const std::uint8_t>(buffer).first(size), server);
      next_ns = now_ns + kAwakeNs;
    }
    keeper.pipe().turn(session, socket, server, buffer);
    way.wait_readable(1'000'000);
  }
}

}  // namespace telenano::app
