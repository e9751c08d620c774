#pragma once

#include <string>
#include <vector>

#include "telenano/common/control/scaling.h"
#include "tests/studies/report/figure_folder.h"

namespace telenano::studies {

/// What a simulated device shows of a rigid environment behind the coupling before it begins to swing:
/// largest α_v α_F, found to 1 % in the time domain (one-sided wall of stiffness α k_c and damping α b_c,
/// wall_simulation.h). α_v alone does not matter: the loop holds only the product. NaN where nothing is
/// stable, or for a delayed loop with γ, which acts without that delay.
struct SimulatedImpedance {
  double free_device = 0;  ///< nobody holds it: a constant force leans it on the wall
  double worst_hand = 0;   ///< the worst of the free device and of mass-spring hands
};
SimulatedImpedance simulated_impedance(const control::ScalingPlant& plant, double mass_kg);

/// KS fig. 12 for one station.
struct ScalingRegion {
  control::ScalingPlant plant;
  double mass_kg = 0.25;
  double device_force_scale = 0;  ///< ε f̂_a/f̂_e
  double published = 0;           ///< of α_v α_F
  double exact = 0;
  SimulatedImpedance simulated;
};
ScalingRegion scaling_region(const control::ScalingPlant& plant, double mass_kg, double device_force_scale);

/// α_F over α_v, and the shown stiffness over the coupling's damping. Writes `id`.csv; the caption says what
/// was found.
Figure draw_scaling_region(const ScalingRegion& region, const std::string& id, const FigureFolder& folder);

/// KS fig. 11: |Z_t| of KS eqs. 9 and 10 over the frequency, for force scales of the region and for the
/// paper's cases I and II.
Figure draw_transmitted_impedance(const ScalingRegion& region, double velocity_scale, const std::string& id,
                                  const FigureFolder& folder);

}  // namespace telenano::studies
