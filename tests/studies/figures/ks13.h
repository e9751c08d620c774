#pragma once

#include <string>
#include <vector>

#include "common/control/method.h"
#include "tests/studies/report/figure_folder.h"

namespace telenano::studies {

/// A session in virtual time that indents silicon oxide at a scaling beyond what the device shows passively,
/// as the demo runs it.
struct HardContact {
  struct Row {
    double time_s = 0;
    double hand_z_mm = 0;
    double force_n = 0;  ///< on the hand, applied
  };
  control::Method method = control::Method::kNone;
  std::vector<Row> rows;
  double greatest_n = 0;
  double hand_speed_rms_m_s = 0;  ///< while the tip touches: an oscillation is speed that leads nowhere
  double force_step_rms_n = 0;    ///< from sample to sample, while the tip touches
  double extracted_mj = 0;        ///< most that the port had given beyond what it had taken, by the observer
  bool stopped = false;           ///< by the station: velocity trip
};

inline constexpr double kHardContactForceScale = 8e8;

HardContact run_hard_contact(control::Method method, double force_scale);

Figure draw_ks13(const FigureFolder& folder);  ///< without control
Figure draw_ks14(const FigureFolder& folder);  ///< with it: as published, and the default

}  // namespace telenano::studies
