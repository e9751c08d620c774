#pragma once

#include <atomic>
#include <cstdint>
#include <functional>

#include "telenano/common/net/datagram.h"
#include "telenano/common/rt/clock.h"
#include "telenano/nve_server/server/server.h"

namespace telenano::server {

struct ShutdownOptions {
  std::int64_t at_most_ns = 1'000'000'000;     ///< for the tips to be withdrawn
  const std::atomic<bool>* at_once = nullptr;  ///< when it becomes true, nothing more is waited for
};

/// The server's last second: says Bye to every session, three times, 20 ms apart (nobody answers it, and it
/// may be lost); goes on withdrawing the tips, refuses Hellos and tells whoever still sends commands; returns
/// when every slave is at rest. A server without sessions returns at once.
void shut_down(Server& server, net::Datagram& socket, const rt::Clock& clock,
               const std::function<void(std::int64_t timeout_ns)>& wait, const ShutdownOptions& options);

}  // namespace telenano::server
