#pragma once

#include "telenano/nve_server/physics/law/tip_sample_law.h"

namespace telenano::physics {

/// Friction of one contact. Limits follow the contact radius a of the contact law, so that they are finite at
/// zero load and zero without contact.
///
/// Sliding   |T| <= τπa², elastic before: k = 8G*a (Mindlin), 1/G* = (2−ν₁)/G₁ + (2−ν₂)/G₂.
/// Rolling   |M| <= 4F_c ξ (a/a₀)^1.5, elastic before: k = 4F_c R (a/a₀)^1.5 a radian, so that it yields when
///           the contact has rolled by ξ, some interatomic distance (0.1–1 nm). F_c the pull-off force, a₀
///           the contact radius at zero load, R the effective radius. F_c and a₀ are taken at one radius and
///           scaled as R and R^(2/3), as for JKR and DMT alike.
/// Spinning  |M| <= (2/3)πτa³ (τ over the whole disc), elastic before: k = (16/3)G*a³. That is Johnson's
///           16Ga³/3 with G* in place of the two bodies' G in series, too soft by 2−ν; it only sets how far a
///           spin springs back.
/// Source    R. D. Mindlin, J. Appl. Mech. 16 (1949) 259; K. L. Johnson, Contact Mechanics (1985) 7.2, 7.4;
///           C. Dominik, A. G. G. M. Tielens, Phil. Mag. A 72 (1995) 783 (rolling).
struct ContactFriction {
  double shear_strength_gpa = 0;  ///< τ; 0: no sliding and no spinning friction
  double shear_modulus_gpa = 0;   ///< G*; must be positive with τ > 0
  double rolling_length_nm = 0;   ///< ξ; 0: no rolling friction
};

struct ParticleParameters {
  double tip_radius_nm = 0;
  double particle_radius_nm = 0;
  TipSampleParameters tip_sample;
  TipSampleParameters tip_particle;
  TipSampleParameters particle_sample;
  ContactFriction tip_sample_friction;  ///< its rolling_length_nm is not used: the tip does not turn
  ContactFriction tip_particle_friction;
  ContactFriction particle_sample_friction;
  /// Drag on the particle, so that one that nothing holds comes to rest: force = η·velocity of the centre,
  /// torque = ηR²·turning rate. 1e-7 N·s/m is 0.1 pN at 1 µm/s: ten times water on a sphere of 500 nm.
  double drag_n_s_m = 1e-7;
  bool sleeps = true;  ///< one that rests far from the tip is not balanced anew (particle_equilibrium.h)
};

}  // namespace telenano::physics
