#pragma once

#include "telenano/common/control/z_width.h"

namespace telenano::studies {

/// What holds the handle, rigidly: a mass, a spring and a damper to ground.
struct Hand {
  double mass_kg = 0;
  double stiffness_n_m = 0;
  double damping_n_s_m = 0;
};

/// x and v of mass, damper and spring after one period under a constant force: exact (matrix exponential).
struct HeldMotion {
  double xx = 1, xv = 0, xf = 0;  ///< x' = xx x + xv v + xf f
  double vx = 0, vv = 1, vf = 0;
};
HeldMotion held_motion(double mass_kg, double damping_n_s_m, double stiffness_n_m, double period_s);

/// Largest modulus of the eigenvalues of device, hand and wall (never left: both directions), sampled
/// exactly. Below 1: stable.
double spectral_radius(const control::HapticDisplay& display, const control::VirtualDamper& damper,
                       double wall_stiffness_n_m, const Hand& hand);

/// Least K, rising from 0, at which the loop with this hand is no longer stable; NaN if it is not at K → 0.
double stability_limit(const control::HapticDisplay& display, const control::VirtualDamper& damper,
                       const Hand& hand);

}  // namespace telenano::studies
