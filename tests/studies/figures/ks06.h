#pragma once

#include <string>
#include <vector>

#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "tests/studies/report/figure_folder.h"

namespace telenano::studies {

/// Force against distance of a silicon tip (R = 20 nm) and the source paper's three samples: van der Waals,
/// contact and, in humid air, the liquid bridge.
struct ForceDistance {
  struct Row {
    double distance_nm = 0;  ///< of the cantilever's base (of the tip itself if rigid); negative: pressed in
    double force_nn = 0;
  };
  std::string sample;
  double lambda = 0;
  std::vector<Row> approach, retract;
  double snap_in_nm = 0;         ///< where the tip jumps in; NaN if it goes in without a jump
  double snap_in_nn = 0;         ///< by how much the force then changes
  double before_snap_in_nn = 0;  ///< the force up to which the cantilever held it
  double dissipated_aj = 0;      ///< in all jumps, by the law's own accounts
  double pull_off_nn = 0;        ///< the greatest attraction on the way out
  double let_go_nm = 0;          ///< where it ends
  double loop_aj = 0;            ///< work of a closed loop: area between the two
};

struct Ks06Sample {
  const char* name;
  double e_gpa, gamma, nu;
  double contact_angle_deg;            ///< of water
  double far_nm, deep_nm;              ///< range of the loop of a rigid tip
  double lever_far_nm, lever_deep_nm;  ///< and with a cantilever
};
const std::vector<Ks06Sample>& ks06_samples();

/// `humidity_percent` 0: dry. `stiffness_n_m` of the cantilever, 0: rigid.
ForceDistance ks06_curve(const Ks06Sample& sample, double humidity_percent, double stiffness_n_m);

Figure draw_ks06(const FigureFolder& folder);

}  // namespace telenano::studies
