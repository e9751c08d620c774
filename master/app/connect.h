#pragma once

#include <array>
#include <atomic>
#include <span>
#include <string>

#include "common/link/client_session.h"
#include "common/net/udp.h"

namespace telenano::app {

/// The address that a station may talk to. Throws UserError for one that is none, or is not on this machine:
/// sessions are not encrypted.
net::Address server_address(const std::string& text);

/// Random, for ClientConfig::nonce_seed.
std::uint64_t random_nonce_seed();

/// Handshake before there is a station: the slave's limits come with the Welcome. Returns with an established
/// session. Throws RunError, one line with what to do, when there is no answer within `timeout_s`, when the
/// server refuses, or on `stop`. `name`: of the server, as the person gave it.
void connect(link::ClientSession& session, net::Udp& socket, const net::Address& server,
             const std::string& name, double rate_hz, double timeout_s, const std::atomic<bool>& stop);

/// Says goodbye for a session that ends before its loop begins, so that the server need not wait for its
/// time-out.
class Farewell {
 public:
  Farewell(link::ClientSession& session, net::Udp& socket, const net::Address& server)
      : session_(session), socket_(socket), server_(server) {}
  ~Farewell() {
    if (!needed_) return;
    std::array<std::uint8_t, link::kMaxDatagramBytes> buffer;
    const std::size_t size = session_.make_bye(link::ByeReason::kStopped, buffer);
    for (int i = 0; i < 3 && size > 0; ++i)
      socket_.send(std::span<const std::uint8_t>(buffer).first(size), server_);
  }
  Farewell(const Farewell&) = delete;
  Farewell& operator=(const Farewell&) = delete;
  void leave_to_loop() noexcept { needed_ = false; }

 private:
  link::ClientSession& session_;
  net::Udp& socket_;
  net::Address server_;
  bool needed_ = true;
};

}  // namespace telenano::app
