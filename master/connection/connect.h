#pragma once

#include <array>
#include <atomic>
#include <span>
#include <string>

#include "telenano/common/link/client_session.h"
#include "telenano/master/connection/server_access.h"
#include "telenano/master/connection/server_link.h"

namespace telenano::connection {

/// Random, for ClientConfig::nonce_seed.
std::uint64_t random_nonce_seed();

/// Handshakes before there is a station: the secure one if there is to be one, then the session's, since the
/// slave's limits come with the Welcome. Returns with an established session. Throws RunError, one line with
/// what to do, when there is no answer in time, when the server refuses, or on `stop`.
void connect(link::ClientSession& session, ServerLink& way, const net::Address& server, double rate_hz,
             const ServerAccess& access, const std::atomic<bool>& stop);

/// Why the server refuses, and what to do about it; one line.
std::string refusal_text(const link::Refuse& refuse, double rate_hz, const std::string& server);

/// Says goodbye for a session that ends before its loop begins, so that the server need not wait for its
/// time-out.
class Farewell {
 public:
  Farewell(link::ClientSession& session, net::Datagram& socket, const net::Address& server)
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
  net::Datagram& socket_;
  net::Address server_;
  bool needed_ = true;
};

}  // namespace telenano::connection
