#pragma once

#include "telenano/common/link/playout.h"
#include "telenano/common/link/rate_control.h"
#include "telenano/common/link/recent_commands.h"
#include "telenano/common/link/send_gate.h"

namespace telenano::loop {

/// More than any loop has ticks.
inline constexpr double kEveryTick = 1e6;

/// How much the force may change without a reply (link::ReplyGate).
struct ReplyDeadbandConfig {
  /// Of the force in the last reply. Held to whatever the link does, or at most, as the link asks for
  /// (link::RateControl::reply_deadband_share). 0: every command is answered.
  double permille = 0;
  bool adapts = false;
  double floor_n = 0.005;  ///< of the force shown: less is not felt. Held to, or at most, likewise
};

/// How the station uses its link. The default: every reply when it comes, a command in every tick.
struct LinkOptions {
  link::PlayoutConfig playout{};
  link::SendGateConfig gate{};
  ReplyDeadbandConfig reply_deadband{};
  /// How many datagrams a second: here one a tick, whatever the link does. At most its
  /// redundancy is repeated.
  link::RateControlConfig rate{.adapts = false, .full_hz = kEveryTick, .redundancy = link::kMaxRecent};
  std::int64_t step_pace_ns = 10'000'000;  ///< between two commands while a twin is felt
};

}  // namespace telenano::loop
