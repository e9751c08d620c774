#pragma once

#include "telenano/nve_server/physics/long_range/long_range_point.h"

namespace telenano::physics {

/// What retardation and the tip's cone change in the van der Waals force of van_der_waals.h.
///
/// Formula   Between half spaces, per area: energy -W(z), W = H/(12 pi z^2 (1 + b z)), b = 5.32/lambda_r (b =
///           0: not retarded). An element of the tip at height z over a half space feels p(z) = -dW/dz per
///           horizontal area, so that a tip whose cross-section at z = d + t is A(t) feels exactly (pairwise)
///             F = -int_0^h p(d + t) A'(t) dt.
///           A paraboloid, A' = 2 pi R for ever, gives the sphere–plane force of Derjaguin's approximation,
///             F = -2 pi R W(d) = -(H R/6 d^2)/(1 + b d),   U = -2 pi R V(d), V(z) = int_z^inf W
///             = (H/12 pi z) [1 - b z ln(1 + 1/(b z))]: Gregory's energy.
///           For sphere and cone A'/2 pi is R - t up to t1 = R (1 - sin theta), from there R sin theta +
///           (t - t1) tan^2 theta: continuous, since the cone is tangent. By parts, with W' = -p, V' = -W,
///             F = -2 pi R W(d) + 2 pi {V(d) - V(d + t1) - tan^2 theta [V(d + t1) - V(d + h)] + a W(d + h)},
///           a = A'(h)/2 pi; for the energy V becomes X(z) = int_z^inf V =
///           (H/12 pi) [(1 + b z) ln(1 + 1/(b z)) - 1] and W becomes V. The correction is all of
///           this less the law without retardation and cone, -H R/(6 d^2).
/// Symbols   d gap (nm), R radius of the sphere (nm), theta half angle of the cone, h height of the tip (nm),
///           lambda_r wavelength of retardation (nm, about 100), H Hamaker constant (aJ).
/// Validity  d >= a0. Pairwise sums and one wavelength for all materials: Gregory's form is within some 10 %
///           of Lifshitz theory to lambda_r, too weak beyond. On a curved sample R is the effective radius,
///           to which the cone is attached; its upper end is cut off flat (nothing above it).
/// Errors    No term cancels: relative some 1e-14 in the sum with -H R/(6 d^2), times 1 + b d far away.
/// Source    J. Gregory, J. Colloid Interface Sci. 83 (1981) 138; H. C. Hamaker, Physica 4 (1937) 1058; for
///           sphere and cone without retardation: C. Argento, R. H. French, J. Appl. Phys. 80 (1996) 6081.
class TipVanDerWaals {
 public:
  TipVanDerWaals() = default;
  /// `retardation_nm` = 0: not retarded; `shape.height_nm` = 0: no cone.
  TipVanDerWaals(double hamaker_aj, double retardation_nm, const TipShape& shape) noexcept;

  bool active() const noexcept { return b_ > 0 || shape_.height_nm > 0; }
  LongRangePoint correction(double gap_nm, double radius_nm) const noexcept;
  double correction_energy_aj(double gap_nm, double radius_nm) const noexcept;

  /// Both at one gap and many radii, as a tip needs it that is pressed on a sample of changing curvature: of
  /// the five logarithms only that at the sphere's end depends on the radius.
  struct Gap {
    double gap_nm = 0;
    double near_integral = 0, end_integral = 0;      // V at the gap and at the cone's upper end
    double near_second = 0, end_second = 0;          // X there
    double end_density = 0;                          // W there
    double retarded_force = 0, retarded_energy = 0;  // what retardation alone changes, over R
  };
  struct Correction {
    double force_nn = 0;
    double energy_aj = 0;
  };
  Gap gap(double gap_nm) const noexcept;
  Correction correction(const Gap& gap, double radius_nm) const noexcept;

 private:
  double area_energy(double z) const noexcept;                                       // W
  double area_energy_integral(double z) const noexcept;                              // V
  double area_energy_second_integral(double z) const noexcept;                       // X, retarded only
  double area_energy_integral_drop(double z, double further) const noexcept;         // V(z) - V(z + further)
  double area_energy_second_integral_drop(double z, double further) const noexcept;  // X(z) - X(z + further)

  double h12_ = 0;  // H/(12 pi)
  double b_ = 0;
  TipShape shape_;
  double tan2_ = 0;
};

}  // namespace telenano::physics
