#include "tests/studies/figures/scaling_figures.h"

#include "tests/studies/zwidth/scaling_study.h"

namespace telenano::studies {
namespace {

ScalingRegion omega_region() {
  control::ScalingPlant plant;
  plant.coupling_stiffness_n_m = 1 / (1 / 20.0 + 1 / 40.0);
  return scaling_region(plant, 0.25, control::device_force_scale_bound(0.8, 12, 500));
}

}  // namespace

Figure draw_ks11(const FigureFolder& folder) {
  return draw_transmitted_impedance(omega_region(), 1e-6, "ks11", folder);
}

Figure draw_ks12(const FigureFolder& folder) {
  return draw_scaling_region(omega_region(), "ks12", folder);
}

}  // namespace telenano::studies
