#pragma once

#include <atomic>
#include <thread>

#include "telenano/common/link/client_session.h"
#include "telenano/common/net/datagram.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/master/connection/server_link.h"
#include "telenano/master/loop/session_tender.h"

namespace telenano::app {

/// Tends a session that has no loop yet (loop::SessionTender) in a thread of its own, as long as this object
/// lives: while the station gets ready, which takes as long as the machine is busy, or as a terminal takes no more
/// text. Meanwhile nobody else may use the session but to read its Welcome, nor the way to the server.
class KeepAwake {
 public:
  KeepAwake(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
            loop::ScenePipe& pipe, double rate_hz);
  ~KeepAwake();
  KeepAwake(const KeepAwake&) = delete;
  KeepAwake& operator=(const KeepAwake&) = delete;

 private:
  void run() noexcept;

  connection::ServerLink& way_;
  rt::SteadyClock clock_;
  loop::SessionTender tender_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace telenano::app
