#pragma once

#include <vector>

#include "telenano/common/surface/height_grid.h"

namespace telenano::elastic {

/// A seeded rough ground whose heights have a power spectrum C(q) ~ q^(−2(1 + H)) from the roll-off to two pixels and
/// none below it: a sum of waves of random direction and phase, their wavelengths even in the logarithm.
/// Source    B. N. J. Persson, J. Phys.: Condens. Matter 17 (2005) R1, for the spectrum.
struct SelfAffine {
  unsigned seed = 1;
  int pixels = 256;  ///< along a side
  double pixel_nm = 2;
  double hurst = 0.8;  ///< H
  double rms_slope = 0.15;
  double roll_off_nm = 60;
  /// As a microscope with a tip of this radius would have seen it; 0: as it is.
  double dilated_nm = 0;
};
surface::HeightGrid self_affine(const SelfAffine& ground);

/// The grounds that the tables self_affine_*.csv are of, in their order.
const std::vector<SelfAffine>& tabled_grounds();

}  // namespace telenano::elastic
