#include "telenano/master/connection/failover.h"

namespace telenano::connection {

const char* text(LeaveCause cause) noexcept {
  switch (cause) {
    case LeaveCause::kNone:
      break;
    case LeaveCause::kShutDown:
      return "it shuts down";
    case LeaveCause::kNobodyListens:
      return "nothing listens there any more";
    case LeaveCause::kSilent:
      return "it is silent";
    case LeaveCause::kRefused:
      return "it refuses the session";
  }
  return "";
}

LeaveCause leaves(const link::ClientSession& session, bool nobody_listens, std::int64_t now_ns) noexcept {
  const std::int64_t waited_ns = now_ns - session.state_since_ns();
  switch (session.state()) {
    case link::ClientState::kIdle:
    case link::ClientState::kEstablished:
    case link::ClientState::kClosed:
      return LeaveCause::kNone;
    case link::ClientState::kRefused:
      return waited_ns > kLeaveLeastNs ? LeaveCause::kRefused : LeaveCause::kNone;
    case link::ClientState::kLost:
      if (!session.has_session() && session.bye_reason() == link::ByeReason::kShuttingDown)
        return LeaveCause::kShutDown;
      break;
    case link::ClientState::kHelloSent:
    case link::ClientState::kChallenged:
      break;
  }
  if (session.turned_away() && waited_ns > kLeaveLeastNs) return LeaveCause::kRefused;
  if (nobody_listens && waited_ns > kLeaveLeastNs) return LeaveCause::kNobodyListens;
  const bool searches = session.state() == link::ClientState::kChallenged;
  return waited_ns > (searches ? kSearchPatienceNs : kLeavePatienceNs) ? LeaveCause::kSilent
                                                                       : LeaveCause::kNone;
}

}  // namespace telenano::connection
