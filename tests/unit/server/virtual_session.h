#pragma once

#include <array>
#include <functional>

#include "spring_slave.h"
#include "telenano/common/link/client_session.h"
#include "telenano/common/net/sim_link.h"
#include "telenano/nve_server/server/server.h"

namespace telenano::server {

/// A station and a server on a simulated link, one tick a millisecond, in virtual time.
struct VirtualSession {
  static constexpr std::int64_t kTickNs = 1'000'000;

  VirtualSession(Server* server_in, const link::ClientConfig& client_config, const net::SimPath& up,
                 const net::SimPath& down, std::uint64_t seed)
      : server(server_in), client(client_config), link(up, down, seed) {}

  /// Serves everything that has arrived, at its time of arrival.
  void serve() {
    net::Received received;
    while (link.b().receive(buffer, received)) {
      if (server == nullptr) continue;  // killed
      const std::size_t n = server->on_datagram({buffer.data(), received.size}, received.from, link.now_ns(),
                                                answer, nullptr, standing);
      if (n > 0) link.b().send({answer.data(), n}, received.from);
    }
  }

  void run_until(std::int64_t to_ns) {
    while (link.next_arrival_ns() <= to_ns) {
      link.advance_to(link.next_arrival_ns());
      serve();
      receive();
    }
    link.advance_to(to_ns);
  }

  void receive() {
    net::Received received;
    while (link.a().receive(buffer, received)) {
      const auto event = client.on_datagram({buffer.data(), received.size}, link.now_ns());
      if (on_event) on_event(event);
    }
  }

  void tick() {
    run_until(now_ns += kTickNs);
    if (server != nullptr) server->poll(now_ns);
    if (const std::size_t n = client.poll(now_ns, buffer)) link.a().send({buffer.data(), n}, {});
    link::Command c = command;
    if (const std::size_t n = client.make_command(c, now_ns, buffer)) {
      link.a().send({buffer.data(), n}, {});
      ++commands;
    }
    if (before_end_of_tick) before_end_of_tick();
  }
  void ticks(int n) {
    for (int i = 0; i < n; ++i) tick();
  }

  Server* server;
  link::ClientSession client;
  net::SimLink link;
  net::Standing standing{};  ///< what the channel to the server would vouch for
  link::Command command = engaged();
  std::int64_t now_ns = 0;
  std::uint64_t commands = 0;
  std::function<void(link::ClientEvent)> on_event;
  std::function<void()> before_end_of_tick;
  std::array<std::uint8_t, link::kMaxDatagramBytes + 1> buffer{};
  std::array<std::uint8_t, link::kMaxDatagramBytes> answer{};

  static link::Command engaged() {
    link::Command c;
    c.flags = link::kFlagClutch | link::kFlagDeadman;
    c.tip_pos_w_nm = {1, 2, -3};
    return c;
  }
};

inline ServerConfig test_config(std::uint64_t secret = 7) {
  ServerConfig config;
  config.secret = {secret, ~secret};
  return config;
}

}  // namespace telenano::server
