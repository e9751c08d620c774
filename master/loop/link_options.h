#pragma once

#include "telenano/common/link/playout.h"
#include "telenano/common/link/send_gate.h"

namespace telenano::loop {

/// How the station uses its link. The default: every reply when it comes, a command in every tick.
struct LinkOptions {
  link::PlayoutConfig playout{};
  link::SendGateConfig gate{};
  std::int64_t step_pace_ns = 10'000'000;  ///< between two commands while a twin is felt
};

}  // namespace telenano::loop
