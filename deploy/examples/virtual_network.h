#pragma once
// The server's side of example 02, and the link to it, in virtual time.
#include <array>
#include <memory>

#include "telenano/common/link/client_session.h"
#include "telenano/common/net/sim_link.h"
#include "telenano/nve_server/server/server.h"
#include "telenano/nve_server/slave/nve_slave.h"

namespace example {

using namespace telenano;
inline constexpr std::int64_t kTickNs = 1'000'000;

class VirtualNetwork {
 public:
  VirtualNetwork(const net::SimPath& path, std::shared_ptr<const scene::Scene> scene)
      : link(path, path, 1), server_(config(), served(std::move(scene))) {}

  /// A tick passes: the server answers each datagram when it arrives.
  void pass_a_tick() {
    net::Received received;
    for (std::int64_t at = link.next_arrival_ns(); at < now_ns + kTickNs; at = link.next_arrival_ns()) {
      link.advance_to(at);
      bool any = false;
      for (; link.b().receive(in_, received); any = true) {
        const std::size_t n =
            server_.on_datagram(std::span(in_).first(received.size), received.from, at, out_);
        if (n > 0) link.b().send(std::span<const std::uint8_t>(out_).first(n), received.from);
      }
      if (!any) break;  // what arrived is the station's
    }
    link.advance_to(now_ns += kTickNs);
    server_.poll(now_ns);
  }

  /// The handshake: what the slave is like comes with it.
  void establish(link::ClientSession& session) {
    for (session.start(now_ns); session.state() != link::ClientState::kEstablished; pass_a_tick()) {
      net::Received received;
      while (link.a().receive(in_, received))
        session.on_datagram(std::span(in_).first(received.size), now_ns);
      if (const std::size_t n = session.poll(now_ns, out_))
        link.a().send(std::span<const std::uint8_t>(out_).first(n), link.address_b());
    }
  }

  net::SimLink link;
  std::int64_t now_ns = 0;

 private:
  static server::ServerConfig config() {
    server::ServerConfig config;
    config.secret = link::SipKey{1, 2};  // random bits in a real server
    config.table.capacity = 4;
    return config;
  }
  static server::ServedScene served(std::shared_ptr<const scene::Scene> scene) {
    server::ServedScene served;
    served.make_slave = slave::nve_slaves(std::move(scene));
    return served;
  }

  server::Server server_;
  std::array<std::uint8_t, link::kMaxDatagramBytes> in_{}, out_{};
};

}  // namespace example
