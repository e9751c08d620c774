#pragma once

#include "telenano/nve_server/physics/long_range/long_range_point.h"

namespace telenano::physics {

/// Attraction of a biased conducting tip and a conducting plane.
///
/// Formula   Each surface element's field is taken to be the bias over an arc (sphere), or that of a cone
///           standing on the plane (cone); integrated over heights t above the apex at the gap D:
///             sphere  dF = -k R dt/(D + t)^2, 0 < t < t1:      F = -k R t1/(D (D + t1)),  U = -k R ln(1 +
///             t1/D) cone    dF = -k kappa^2 (t + q) dt/(D + t)^2, t1 < t < h,
///           k = pi eps0 V^2, kappa = 1/ln tan(theta/2), t1 = R (1 - sin theta), and q = R (1/sin theta - 1)
///           how far the cone's own apex lies below the tip's. With z = D + t1, y = (h - t1)/z, p = t1 + q =
///           R cos^2 theta/sin theta:
///             F = -k kappa^2 [ln(1 + y) - y/(1 + y) + (p/z) y/(1 + y)],
///             U = -k kappa^2 [z (y - ln(1 + y)) + p ln(1 + y)].
///           Without cone the sphere counts to its equator, t1 = R: F = -pi eps0 V^2 R^2/(D (D + R)).
/// Symbols   D gap (nm), V bias with the contact potential (V), eps0 in nN/V^2, R, theta, h as in TipShape.
/// Validity  D > 0; within some 5 % of the exact sphere–plane force at any D (the logarithmic term of D << R
///           is left out). The upper end of the cone is kept (in the source h >> D + R), so that the force is
///           attractive and falls off at any gap; no cantilever.
/// Errors    No term cancels: relative some 1e-15.
/// Source    S. Hudlet, M. Saint Jean, C. Guthmann, J. Berger, Eur. Phys. J. B 2 (1998) 5, eqs. 13-15.
class Electrostatic {
 public:
  Electrostatic() = default;
  Electrostatic(double bias_v, const TipShape& shape) noexcept;

  bool active() const noexcept { return k_ > 0; }
  LongRangePoint at(double gap_nm, double radius_nm) const noexcept;
  double energy_aj(double gap_nm, double radius_nm) const noexcept;

 private:
  double k_ = 0;
  double kappa2_ = 0;
  double p_over_radius_ = 0;
  TipShape shape_;
};

/// Vacuum permittivity, 8.854e-12 F/m, as a force over a voltage squared (CODATA 2018).
inline constexpr double kVacuumPermittivityNnPerV2 = 8.8541878128e-3;

}  // namespace telenano::physics
