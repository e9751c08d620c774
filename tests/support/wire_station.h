#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>

#include "telenano/common/link/client_session.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/common/security/dtls_client.h"

namespace telenano::support {

/// The network's end of a station and nothing else: a socket of its own, perhaps a secure channel, a session.
struct WireStation {
  /// `from`: an address of its own; left out, any.
  WireStation(const net::Address& at, const link::ClientConfig& config,
              const std::optional<security::DtlsClientConfig>& secure = {},
              const std::optional<net::Address>& from = {})
      : server(at), socket(from ? net::Udp::listen(*from) : net::Udp::open_for(at)), client(config) {
    if (secure) channel = std::make_unique<security::DtlsClient>(*secure, socket, server, clock);
    client.start(clock.now_ns());
  }

  net::Datagram& wire() noexcept { return channel ? static_cast<net::Datagram&>(*channel) : socket; }

  /// Takes what has come; says what the handshake wants to say, and one command.
  void pump(link::Command command) {
    net::Received received;
    while (wire().receive(buffer, received))
      client.on_datagram({buffer.data(), received.size}, clock.now_ns());
    if (const std::size_t n = client.poll(clock.now_ns(), buffer)) wire().send({buffer.data(), n}, server);
    if (const std::size_t n = client.make_command(command, clock.now_ns(), buffer))
      wire().send({buffer.data(), n}, server);
  }
  /// Until so many replies of this session have come; false when the time is up.
  bool exchange(std::uint64_t replies, const link::Command& command, std::int64_t patience_ns) {
    const std::int64_t end_ns = clock.now_ns() + patience_ns;
    while (clock.now_ns() < end_ns) {
      if (client.state() == link::ClientState::kEstablished && client.replies().received() >= replies)
        return true;
      pump(command);
      socket.wait_readable(1'000'000);
    }
    return false;
  }

  rt::SteadyClock clock;
  net::Address server;
  net::Udp socket;
  std::unique_ptr<security::DtlsClient> channel;
  link::ClientSession client;
  std::array<std::uint8_t, link::kMaxDatagramBytes + 1> buffer{};
};

}  // namespace telenano::support
