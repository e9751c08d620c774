#pragma once

#include <atomic>

#include "telenano/common/link/client_session.h"
#include "telenano/common/net/datagram.h"
#include "telenano/master/connection/server_link.h"

namespace telenano::app {

/// How long the answer to a command takes, the server's own time included: that is what the hand waits for.
struct LinkDelay {
  double median_s = 0;
  double p99_s = 0;
  int sent = 0;
  int answered = 0;
  bool measures = false;  ///< the slave's force is measured by an instrument, not computed
};

/// Measures an established session with `count` idle commands (clutch open: the tip holds where it is), one a
/// period, and goes on with such commands until an answer to the last of them, or to a later one, has come: for a few times as
/// long as the slowest took at most. Throws RunError when none comes
/// within `timeout_s` or the server ends the session, and on `stop`.
LinkDelay measure_link(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
                       double rate_hz, int count, double timeout_s, const std::atomic<bool>& stop);

}  // namespace telenano::app
