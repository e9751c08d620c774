#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <thread>

#include "telenano/common/link/client_session.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/net/datagram.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/master/connection/server_link.h"
#include "telenano/master/loop/scene_pipe.h"

namespace telenano::app {

/// Tends a session that has no loop yet: takes what comes, and sends a command that moves nothing often
/// enough that the server does not take the station for gone. (It would withdraw the tip, and the session
/// would begin far above the sample.)
class SessionTender {
 public:
  SessionTender(link::ClientSession& session, net::Datagram& socket, const net::Address& server,
                loop::ScenePipe& pipe)
      : session_(session), socket_(socket), server_(server), pipe_(pipe) {}

  /// What is due now.
  void turn() noexcept;
  /// Hears of each datagram that comes; empty: nobody does.
  std::function<void(link::ClientEvent)> on_event;

 private:
  link::ClientSession& session_;
  net::Datagram& socket_;
  net::Address server_;
  loop::ScenePipe& pipe_;
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer_{};
  rt::SteadyClock clock_;
  std::int64_t next_ns_ = 0;
};

/// The same in a thread of its own, as long as this object lives: while the station gets ready, which takes
/// as long as the machine is busy, or as a terminal takes no more text. Meanwhile nobody else may use the
/// session but to read its Welcome, nor the way to the server.
class KeepAwake {
 public:
  KeepAwake(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
            loop::ScenePipe& pipe);
  ~KeepAwake();
  KeepAwake(const KeepAwake&) = delete;
  KeepAwake& operator=(const KeepAwake&) = delete;

 private:
  void run() noexcept;

  connection::ServerLink& way_;
  SessionTender tender_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace telenano::app
