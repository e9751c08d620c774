#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "telenano/common/control/method.h"
#include "telenano/common/recording/sample.h"
#include "telenano/master/device/intended_motion.h"

namespace telenano::studies {

/// A session in virtual time at a flat silicon oxide: station, link, server, and behind the slave's port
/// either the virtual environment or an AFM (its logic, and a simulated controller over the same sample).
struct TouchConfig {
  bool afm = true;
  double force_rate_hz = 200;  ///< of the AFM's readings
  double rtt_s = 0;
  control::Method method = control::Method::kModel;
  bool presses = true;  ///< two levels of one press, else `task`
  device::Task task = device::Task::kIndent;
  std::uint64_t seed = 1;
};

struct TouchResult {
  TouchConfig config;
  double stiffness_n_m = 0;  ///< shown at the hand: ΔF/Δx between the two levels of the press
  double port_n_m = 0;  ///< the same of the true force on the tip over the lever's true base, times α_v α_F
  double swing_part = 0;     ///< force at the hand, peak to peak over a level, part of its mean
  double peak_tip_nn = 0;    ///< true force on the tip
  double static_tip_nn = 0;  ///< of the deeper level
  double age_ms = 0;         ///< of the measured force, mean while engaged
  double lag_nm = 0;         ///< of the tip behind its target, RMS, while engaged
  double extracted_mj = 0;
  bool stopped = false;   ///< the station stopped, or the AFM withdrew
  double touched_s = -1;  ///< first contact
  struct Row {
    double time_s, target_nm, tip_nm, force_nn, hand_mm, hand_n;
  };
  std::vector<Row> rows;
};

TouchResult run_touch(const TouchConfig& config);

}  // namespace telenano::studies
