#pragma once

#include <array>
#include <cstdint>
#include <functional>

#include "telenano/common/link/client_session.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/link/rate_control.h"
#include "telenano/common/net/datagram.h"
#include "telenano/common/rt/clock.h"
#include "telenano/master/loop/scene_pipe.h"

namespace telenano::loop {

/// Tends a session that has no loop yet: takes what comes, and sends a command that moves nothing often
/// enough that the server does not take the station for gone. (It would withdraw the tip, and the session
/// would begin far above the sample.)
///
/// While a scene is fetched, the commands also measure the link, and pieces are asked for in proportion to their
/// rate, as the loop does: a thin link has no queue when the loop begins.
class SessionTender {
 public:
  /// All of it must outlive this. `rate_hz`: that the session's Hello has said; as many commands a second at most.
  SessionTender(link::ClientSession& session, net::Datagram& socket, const net::Address& server,
                ScenePipe& pipe, const rt::Clock& clock, double rate_hz);

  /// What is due now; to be called every millisecond or so.
  void turn() noexcept;
  /// Hears of each datagram that comes; empty: nobody does.
  std::function<void(link::ClientEvent)> on_event;

  const link::RateControl& rate() const noexcept { return rate_; }

 private:
  void take(link::ClientEvent event, std::int64_t came_ns) noexcept;

  link::ClientSession& session_;
  net::Datagram& socket_;
  net::Address server_;
  ScenePipe& pipe_;
  const rt::Clock& clock_;
  link::RateControl rate_;
  std::uint64_t rtt_samples_ = 0;
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer_{};
  std::int64_t next_ns_ = 0;
  std::int64_t fetched_ns_ = INT64_MIN;  ///< when a piece was asked for last
};

}  // namespace telenano::loop
