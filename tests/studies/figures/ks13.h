#pragma once

#include <string>
#include <vector>

#include "telenano/common/control/method.h"
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

  // Of the hold, 5 to 6.5 s of motion, while the operator's intention rests.
  double static_n = 0;          ///< mean over its last half second
  double swing_n = 0;           ///< peak to peak over the same
  double settled_after_s = -1;  ///< after the first touch: from then on to the end of the hold within ±2.5 %
                                ///< of the static force; negative: never
  double greatest_push_n = 0;   ///< away from the sample: what adhesion does not make
};

inline constexpr double kHardContactForceScale = 8e8;

HardContact run_hard_contact(control::Method method, double force_scale);

/// The same hand on the same port as it would be without a station: no sampling that matters (50 kHz), no
/// encoder, no link, no control; only the device's greatest force remains.
HardContact run_ideal_contact(double force_scale);

Figure draw_ks13(const FigureFolder& folder);  ///< without control
Figure draw_ks14(const FigureFolder& folder);  ///< with it: as published, and the default

}  // namespace telenano::studies
