#pragma once

#include <array>
#include <string>
#include <string_view>

#include "tests/studies/stress/run_spec.h"

namespace telenano::studies::stress {

/// Links that people have; assumed figures of the size that such links have, not measured ones. Each is a
/// shorthand in a run's text (link=wifi) for the numbers beside it, which stand in tables and replays.
///
///   space      800 ms round trip, 2 % jitter, 1 % lost one by one; silent for 3 s now and then
///   satellite  600 ms (a geostationary hop), 5 %, 0.5 % lost for 50 ms each
///   wifi       8 ms, 100 % (of 2 ms at least), 5 % lost for 60 ms: bursts while another station sends
///   handover   60 ms, 30 %, 1 % lost for 20 ms; 200 ms without anything, from cell to cell
///   vpn-rekey  40 ms, 5 %, 0.1 % lost; 1 s without anything while keys are agreed anew
struct NamedLink {
  std::string_view name;
  double rtt_ms, jitter, loss, burst_ms, outage_ms;
};
inline constexpr std::array<NamedLink, 5> kNamedLinks = {{{"space", 800, 0.02, 0.01, 1, 3000},
                                                          {"satellite", 600, 0.05, 0.005, 50, 0},
                                                          {"wifi", 8, 1, 0.05, 60, 0},
                                                          {"handover", 60, 0.3, 0.01, 20, 200},
                                                          {"vpn-rekey", 40, 0.05, 0.001, 1, 1000}}};

inline void put_link(const NamedLink& link, RunSpec& spec) noexcept {
  spec.rtt_ms = link.rtt_ms;
  spec.jitter = link.jitter;
  spec.loss = link.loss;
  spec.burst_ms = link.burst_ms;
  spec.outage_ms = link.outage_ms;
}

}  // namespace telenano::studies::stress
