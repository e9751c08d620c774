#pragma once

#include <cstdint>

#include "telenano/common/link/messages.h"
#include "telenano/common/net/datagram.h"
#include "telenano/common/rt/spsc_queue.h"

namespace telenano::server {

/// Something that an auditor asks about later: who came, who moved the tip, what went wrong. Nothing secret
/// is in it: no key, token, cookie or session id. Plain data, so that the loop can leave it in a queue.
struct AuditEvent {
  enum class Kind : std::uint8_t {
    kOpened,     ///< a session begins
    kResumed,    ///< a silent one goes on
    kMoved,      ///< its station has come to another address, which is said
    kRefused,    ///< somebody is told no; `reason` is a link::RefuseReason
    kEnded,      ///< by its station (`reason`: its link::ByeReason), or by the server, which stops
    kTimedOut,   ///< no commands any more: the tip is withdrawn, the session may still be resumed
    kForgotten,  ///< nobody has resumed it
    kTipTaken,   ///< a shared tip is this session's from now on
    kTipLeft,    ///< and is not any more
    kSwitched,   ///< to another of the server's scenes
    kFault,      ///< of the slave: `faults` have appeared (link::FaultBits), at most one event a second
  };
  Kind kind = Kind::kOpened;
  std::int64_t at_ns = 0;      ///< of the loop's clock
  std::uint64_t session = 0;   ///< counts the sessions of this server, from 1; 0: none was opened
  std::uint64_t identity = 0;  ///< net::Standing::identity; 0: nobody has said
  net::Rights rights = net::Rights::kObserve;
  net::Address address;
  std::uint32_t reason = 0;
  std::uint32_t faults = 0;
};

/// From the loop to whoever writes it down. A full queue drops, and counts: auditing delays no exchange.
using AuditQueue = rt::SpscQueue<AuditEvent>;

}  // namespace telenano::server
