#pragma once

#include <cmath>

#include "telenano/common/base/constants.h"

namespace telenano::physics {

/// Van der Waals force between a sphere and a half space, not retarded.
///
/// Formula   F = -H R/(6 d^2), U = -H R/(6 d), H = 12 pi a0^2 w = 24 pi a0^2 sqrt(gamma1 gamma2)
/// Symbols   H Hamaker constant (aJ), R sphere radius (nm), d gap (nm), a0 cut-off distance (nm), w work of
/// adhesion (N/m) Validity  a0 <= d << R, and d below some 10 nm, where retardation starts to matter. H is
/// chosen so that F(a0) = -2 pi w R,
///           the DMT pull-off: the same adhesion energy as the contact law, not a second one.
/// Source    H. C. Hamaker, Physica 4 (1937) 1058; B. V. Derjaguin, Kolloid-Z. 69 (1934) 155.
struct VanDerWaals {
  double hamaker_aj = 0;

  static constexpr VanDerWaals from_adhesion(double work_of_adhesion_n_m, double cut_off_nm) noexcept {
    return {12.0 * kPi * cut_off_nm * cut_off_nm * work_of_adhesion_n_m};
  }
  /// The cut-off at which `hamaker_aj` is that of `work_of_adhesion_n_m`.
  static double cut_off_nm(double hamaker_aj, double work_of_adhesion_n_m) noexcept {
    return std::sqrt(hamaker_aj / (12.0 * kPi * work_of_adhesion_n_m));
  }
  constexpr double force_nn(double radius_nm, double gap_nm) const noexcept {
    return -hamaker_aj * radius_nm / (6.0 * gap_nm * gap_nm);
  }
  constexpr double energy_aj(double radius_nm, double gap_nm) const noexcept {
    return -hamaker_aj * radius_nm / (6.0 * gap_nm);
  }
  constexpr double stiffness_n_m(double radius_nm, double gap_nm) const noexcept {  ///< dF/d(overlap)
    return -hamaker_aj * radius_nm / (3.0 * gap_nm * gap_nm * gap_nm);
  }
};

}  // namespace telenano::physics
