#pragma once

#include "telenano/common/link/playout.h"
#include "telenano/common/link/rate_control.h"
#include "telenano/common/link/recent_commands.h"
#include "telenano/common/link/send_gate.h"

namespace telenano::loop {

/// More than any loop has ticks.
inline constexpr double kEveryTick = 1e6;

/// How the station uses its link. The default: every reply when it comes, a command in every tick.
struct LinkOptions {
  link::PlayoutConfig playout{};
  link::SendGateConfig gate{};
  /// How many datagrams a second: here one a tick, whatever the link does. At most its
  /// redundancy is repeated.
  link::RateControlConfig rate{.adapts = false, .full_hz = kEveryTick, .redundancy = link::kMaxRecent};
  std::int64_t step_pace_ns = 10'000'000;  ///< between two commands while a twin is felt
};

}  // namespace telenano::loop
