#pragma once

#include <cstddef>
#include <vector>

namespace telenano::recording {

/// A stretch of one recording in which the tip was driven one way: down (approach) or up (retract). The two
/// together are a force-distance curve.
struct CurveSegment {
  bool approach = true;
  std::size_t begin = 0;
  std::size_t end = 0;  ///< one past the last row
};

/// Turning points of `height` that are further than `threshold` apart make the segments; those in which the
/// tip moved sideways, by more than a quarter of the rise, are left out. `lateral` is as long as `height`,
/// all in one unit.
std::vector<CurveSegment> find_curve_segments(const std::vector<double>& height,
                                              const std::vector<double>& lateral, double threshold);

/// The threshold for a whole recording, nm: a tenth of what the height went through, at least 0.2 nm.
double segment_threshold_nm(const std::vector<double>& height_nm);

}  // namespace telenano::recording
