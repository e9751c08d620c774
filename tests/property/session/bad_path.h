#pragma once

#include <cstdint>
#include <utility>

#include "telenano/common/base/random.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {

/// Anything up to what the protocol is made for: 50 % loss, bursts of 500 ms, reordering, duplicates, cuts,
/// a round trip of 1 s, a clock 200 ppm off (the other way's delay shrinks as this one's grows).
inline void make_bad(Random& random, VirtualSessionConfig& config) {
  net::SimPath up;
  const double round_trip_ms = random.chance(0.3) ? 1000 : random.uniform(0, 300);
  up.delay_ns = static_cast<std::int64_t>(0.5e6 * round_trip_ms);
  up.jitter_ns = static_cast<std::int64_t>(random.uniform(0, 20e6));
  up.jitter = net::SimPath::Jitter::kExponential;
  up.in_order = random.chance(0.5);
  up.loss = random.uniform(0, 0.5);
  up.burst_ns = random.chance(0.5) ? static_cast<std::int64_t>(random.uniform(1e6, 500e6)) : 0;
  up.duplicate = random.uniform(0, 0.2);
  up.reorder = random.uniform(0, 0.2);
  up.reorder_ns = static_cast<std::int64_t>(random.uniform(1e6, 30e6));
  up.truncate = random.uniform(0, 0.05);
  up.drift_ppm = random.uniform(-200, 200);
  config.to_server = config.to_station = up;
  config.to_station.drift_ppm = -up.drift_ppm;
  if (random.chance(0.5)) std::swap(config.to_server, config.to_station);
  config.station.force_age_s =
      10;  // forces are shown at any round trip here: a tip that is held stands behind
}

inline void heal(net::SimPath& path) {
  net::SimPath good;
  good.delay_ns = path.delay_ns;
  path = good;
}

}  // namespace telenano::support
