#pragma once

#include <cstddef>
#include <vector>

#include "telenano/common/surface/height_grid.h"

/// What a blunt tip has hidden (J. S. Villarrubia, "Algorithms for scanned probe microscope image simulation,
/// surface reconstruction, and tip estimation", J. Res. Natl. Inst. Stand. Technol. 102, 425 (1997)), for a
/// paraboloid h(u) = u²/2R, which is a ball of radius R where it touches. A scan is the dilation of the
/// ground,
///   I(p) = max over x of S(x) − h(x − p),
/// and its erosion is the highest ground that can have given it,
///   S_r(x) = min over p of I(p) + h(x − p).
/// On the scan's own pixels; nothing is assumed beyond its rim. Both are exact to rounding: h is a sum of a
/// part in x and a part in y, so that each is two passes of lower envelopes of parabolas (P. F. Felzenszwalb
/// and D. P. Huttenlocher, Theory of Computing 8, 415 (2012)), whose time does not depend on R.
namespace telenano::import {

/// The scan that a tip of this radius (nm, above 0) makes of the ground.
std::vector<double> dilate(const surface::HeightGrid& ground, double radius_nm);

struct Erosion {
  std::vector<double> z_nm;   ///< S_r, as the grid's heights
  std::vector<bool> certain;  ///< the tip has touched here: S_r is the ground, not only above it
  std::size_t certain_count = 0;
  double misfit_rms_nm = 0;  ///< of the scan against the dilation of S_r: what no such tip can have measured
  double misfit_max_nm = 0;
};

/// A place is certain if some pixel of the scan is touched there and nowhere else (Villarrubia, section 5):
/// the ground must then have been as high as that. What is nearer to touching than 1/65536 of the scan's
/// range, one step of the converter that measured it, counts as touching. A pixel whose tip reaches beyond
/// the rim (within √(2R·range) of it) may have been touched outside, and makes nothing certain.
Erosion erode(const surface::HeightGrid& scan, double radius_nm);

/// The bluntest paraboloid that can have measured the scan (Villarrubia, section 6, for a shape of one
/// parameter): at most one pixel in a thousand of the scan is sharper than that by more than `tolerance_nm`,
/// which noise makes necessary, and what the pixels' width d makes necessary, d √(range/4R). A bound: the tip
/// was no blunter, and as blunt only if the sample has something sharper than it. A blunter paraboloid is the
/// sum of a sharper one and another, so that what it misses only grows with R, and halving the interval finds
/// R to 1 %. Within 1 to 1e4 nm; at the upper end: nothing in the scan tells.
double bluntest_radius_nm(const surface::HeightGrid& scan, double tolerance_nm);

}  // namespace telenano::import
