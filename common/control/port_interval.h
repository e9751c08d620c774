#pragma once

#include "telenano/common/base/vec3.h"

namespace telenano::control {

/// What happened at the station's port in the interval that has just ended, as the observer counted it.
struct PortInterval {
  Vec3 applied_force_h_n = Vec3::Zero();  ///< on the hand, all of it, held over the interval
  Vec3 hand_pos_h_m = Vec3::Zero();       ///< at its end
  Vec3 displacement_h_m = Vec3::Zero();   ///< over it
  double put_in_j = 0;                    ///< by the hand: −F·Δx
  double dt_s = 1e-3;                     ///< > 0
};

}  // namespace telenano::control
