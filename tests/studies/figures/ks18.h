#pragma once

#include <string>
#include <vector>

#include "tests/studies/report/figure_folder.h"

namespace telenano::studies {

/// A session in virtual time that goes from task (a), hold 10-20 nm above the sample, to task (b), just in
/// contact, and back, twice; then presses into the sample. Forces along W z at the hand, as commanded.
struct TaskTransitions {
  struct Row {
    double time_s = 0;
    double height_nm = 0;  ///< of the tip
    double hand_force_n = 0;
  };
  std::string scene;
  std::vector<Row> rows;
  double above_n = 0;      ///< greatest force while held 10-20 nm above
  double above_tip_n = 0;  ///< of that what comes from the tip: control adds its damping
  double going_n = 0;  ///< greatest on the way between the two, before the tip jumps in and after it let go
  double in_contact_n = 0;  ///< mean of the force while held just in contact
  double jump_n = 0;        ///< greatest attraction of the jumps
  double pressed_n = 0;     ///< mean while held below the surface
};

/// `compand` ≥ 1: felt through the twin, attraction before contact up to so many times as strong.
TaskTransitions run_ks18(const std::string& scene_path, double compand = 0);

Figure draw_ks17(const FigureFolder& folder);  ///< silicon oxide
Figure draw_ks18(const FigureFolder& folder);  ///< polystyrene, and silicone rubber

}  // namespace telenano::studies
