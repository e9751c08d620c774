#pragma once

#include <functional>
#include <vector>

#include "telenano/nve_server/physics/potential/potential_jet.h"
#include "telenano/nve_server/physics/surface/bicubic_spline.h"

namespace telenano::physics {

/// A term of the potential beside contact and van der Waals (retardation and cone, bias), R T(ln gap, ρ),
/// with the gap a0 − δ.
///
/// Method    Bicubic spline of the exact energy over (ln gap, ρ). From touch on the force stays
///           (long_range.h): a line in the overlap, its two ends splines over ρ.
/// Errors    1e-7 of the energy, 1e-6 of the force; second derivatives 1e-5.
class FarTerm {
 public:
  /// `energy_aj(gap_nm, radius_nm)`, for any gap > 0.
  FarTerm(const std::function<double(double, double)>& energy_aj, double cut_off_nm, double first_log_radius,
          double last_log_radius);

  /// Adds the term to `jet`. Any overlap; radii beyond the table's as at its end. `radius_nm` = e^ρ.
  void add(double overlap_nm, double log_radius, double radius_nm, PotentialJet& jet) const noexcept;

 private:
  double cut_off_nm_;
  BicubicSpline spline_;
  std::vector<double> touch_value_;  // B-spline coefficients over ρ at the gap a0
  std::vector<double> touch_slope_;
};

}  // namespace telenano::physics
