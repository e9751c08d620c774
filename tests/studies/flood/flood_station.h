#pragma once

#include <cstdint>

#include "telenano/common/net/udp.h"
#include "telenano/common/rt/log_histogram.h"
#include "tests/studies/flood/flooder.h"

namespace telenano::studies {

/// What a station has lived through.
struct StationRun {
  double seconds = 0;
  std::uint64_t ticks = 0;
  std::uint64_t missed_ticks = 0;  ///< deadlines that passed without a tick
  std::uint64_t asked = 0;         ///< datagrams sent, one a tick
  std::uint64_t answered = 0;
  std::uint64_t sessions = 0;  ///< opened; 1: nothing ended it. An echo has none: 0
  rt::LogHistogram round_trip;

  double lost() const noexcept {
    return asked == 0 ? 1.0 : 1.0 - static_cast<double>(answered) / static_cast<double>(asked);
  }
  double missed() const noexcept {
    return static_cast<double>(missed_ticks) /
           static_cast<double>(ticks + missed_ticks > 0 ? ticks + missed_ticks : 1);
  }
};

/// A session at `rate_hz` for `seconds`, from a real-time thread where that is allowed. What it sends,
/// `flooder` (may be null) overhears. Throws RunError if the server does not answer.
StationRun run_station(const net::Address& server, double rate_hz, double seconds, Flooder* flooder);

/// The same traffic with a bare echo: no protocol, no check, every datagram goes back.
StationRun run_pinger(const net::Address& echo, double rate_hz, double seconds, Flooder* flooder);

}  // namespace telenano::studies
