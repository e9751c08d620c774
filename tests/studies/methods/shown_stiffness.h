#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "telenano/common/control/method.h"
#include "telenano/master/device/plant.h"

namespace telenano::studies {

/// A simulated operator with a firm hand presses on a wall through the whole system, three times, over an
/// ideal link of a given round trip: the same station, session and server objects as the programs. What is
/// felt of the wall, and what that costs.
struct PressConfig {
  control::Method method = control::Method::kKsClamp;
  double rtt_s = 0;            ///< 0: the answer is there at the next tick
  double wall_n_m = 1000;      ///< as it would be felt at the hand: α_v α_F k
  double depth_m = 0.010;      ///< beyond the wall, that the operator intends; a hand yields
  double clearance_m = 0.005;  ///< of the hand above the wall at the start
  device::PlantConfig plant{};
  bool restarts = false;  ///< the server dies and comes again in every rest between two presses
  std::uint64_t seed = 1;
  int trace_every = 0;  ///< keep every n-th tick; 0: none
};

inline constexpr int kPresses = 3;

/// One hold. x is the true position of the hand beyond where the wall truly is, f the force really applied on
/// the hand against x, both over the last second of the hold.
struct Press {
  double stiffness_n_m = 0;  ///< mean f over mean x: what the operator leans on
  double force_n = 0;        ///< mean f
  double depth_mm = 0;       ///< mean x
  double swing_mm = 0;       ///< x, peak to peak
  double drift_mm = 0;  ///< after the release that follows: the tip's command above (+) or below where the
                        ///< hand is, in hand millimetres
};

struct PressResult {
  PressConfig config;
  std::array<Press, kPresses> presses{};
  double peak_force_n = 0;  ///< on the hand
  double over_force = 0;    ///< peak force at the tip over that of the same hand pressing on the wall itself
  double least_energy_mj = 0;  ///< of what the hand has put in, net, on true positions; negative: it got more
  double extracted_mj = 0;     ///< the same less the device's certain loss (support::PortAccount)
  double force_error_rms_n = 0;   ///< applied against the wall itself at the true position, while x > 0
  double duty = 0;                ///< part of the ticks with x > 0 in which damper or clamp acted
  double stopped_at_s = -1;       ///< the station latched a stop; negative: never
  std::uint32_t stop_faults = 0;  ///< why, station::StationFaults

  std::uint64_t sessions = 1;  ///< with a server, one after the other

  struct Row {
    double time_s = 0;
    double depth_mm = 0;
    double force_n = 0;
  };
  std::vector<Row> trace;

  const Press& first() const { return presses.front(); }
  /// Mean of the presses after the first, to which a method may have learnt the wall.
  double later_stiffness_n_m() const;
  double worst_swing_mm() const;
  double worst_drift_mm() const;  ///< by magnitude
};

/// Where a hand with these springs comes to rest on the wall itself: depth and force.
struct RestOnWall {
  double depth_m = 0;
  double force_n = 0;
};
RestOnWall rest_on_wall(const PressConfig& config);

PressResult run_press(const PressConfig& config);

}  // namespace telenano::studies
