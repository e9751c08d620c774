#pragma once

#include <string>
#include <vector>

#include "tests/studies/report/figure_folder.h"

namespace telenano::studies {

/// A session in virtual time: just in contact (task b), then pressed in (task c) three times, deeper each
/// time, at one place.
struct Indents {
  struct Row {
    double time_s = 0;
    double height_nm = 0;  ///< of the tip above the virgin surface
    double hand_force_n = 0;
  };
  std::string sample;
  std::vector<Row> rows;
  double contact_n = 0;   ///< mean force of (b)
  double deepest_nm = 0;  ///< of (c), below the surface
  double greatest_n = 0;
  double pull_off_n = 0;    ///< greatest attraction
  double hand_work_mj = 0;  ///< of the hand over all, by the observer: what the loops cost
};

Indents run_ks16(const std::string& scene_path);

/// KS section IV: the softness of silicone rubber gives less force feedback. A push, and a smaller one than on `other`.
const char* agrees_on_rubber(double rubber_n, double other_n);

Figure draw_ks16(const FigureFolder& folder);

}  // namespace telenano::studies
