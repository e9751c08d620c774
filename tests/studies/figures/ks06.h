#pragma once

#include <string>
#include <vector>

#include "nve_server/physics/tip_sample_law.h"
#include "tests/studies/report/figure_folder.h"

namespace telenano::studies {

/// Force against the distance of a rigid silicon tip (R = 20 nm) from the source paper's three samples: van
/// der Waals, contact and, in humid air, the liquid bridge.
struct ForceDistance {
  struct Row {
    double distance_nm = 0;  ///< of the undeformed tip and sample; negative: pressed in
    double force_nn = 0;
  };
  std::string sample;
  double lambda = 0;
  std::vector<Row> approach, retract;
  double snap_in_nm = 0;   ///< where the tip jumps in; NaN if it goes in without a jump
  double snap_in_nn = 0;   ///< by how much the force then changes
  double pull_off_nn = 0;  ///< the greatest attraction on the way out
  double let_go_nm = 0;    ///< where it ends
  double loop_aj = 0;      ///< work of a closed loop: area between the two
};

struct Ks06Sample {
  const char* name;
  double e_gpa, gamma, nu;
  double contact_angle_deg;  ///< of water
  double far_nm, deep_nm;    ///< range of the loop
};
const std::vector<Ks06Sample>& ks06_samples();

/// `humidity_percent` 0: dry.
ForceDistance ks06_curve(const Ks06Sample& sample, double humidity_percent);

Figure draw_ks06(const FigureFolder& folder);

}  // namespace telenano::studies
