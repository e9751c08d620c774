#pragma once

#include <algorithm>
#include <cmath>

namespace telenano::physics {

/// Residual surfaces that one contact flows through (plastic_contact.h): radius R_p = a*/ε and depth δ_p over
/// the largest plastic contact radius a*, from a place whose radius before any mark was R:
///
///   dδ_p/da* = ε up to a_v = ε R,   2 a*/R − ε beyond it;   R_p stops where a* = last.
struct FlowFamily {
  double strain;     ///< ε = πH/K
  double origin_nm;  ///< R
  double first_nm;   ///< a_v
  double last_nm;

  FlowFamily(double strain_, double origin_radius_nm, double last_a_nm) noexcept
      : strain(strain_),
        origin_nm(origin_radius_nm),
        first_nm(strain_ * origin_radius_nm),
        last_nm(last_a_nm) {}

  double radius_nm(double a_nm) const noexcept { return std::min(a_nm, last_nm) / strain; }
  double elastic_nm(double a_nm) const noexcept {
    return std::min(a_nm, last_nm);
  }  ///< largest a without flow
  /// δ_p(to) − δ_p(from), factored so that a small step does not cancel.
  double depth_nm(double from_nm, double to_nm) const noexcept {
    double depth = 0.0;
    if (from_nm < first_nm) {
      const double end = std::min(to_nm, first_nm);
      depth += strain * (end - from_nm);
      from_nm = end;
    }
    if (to_nm > from_nm) depth += (to_nm - from_nm) * ((to_nm + from_nm) / origin_nm - strain);
    return depth;
  }
  /// Its inverse: a* after a further depth >= 0.
  double after_nm(double from_nm, double depth_nm) const noexcept {
    if (from_nm < first_nm) {
      const double room = strain * (first_nm - from_nm);
      if (depth_nm <= room) return from_nm + depth_nm / strain;
      depth_nm -= room;
      from_nm = first_nm;
    }
    // (b − a)((b + a)/R − ε) = depth, the greater root.
    const double c = from_nm * (from_nm / origin_nm - strain) + depth_nm;
    return std::max(from_nm, 0.5 * origin_nm * (strain + std::sqrt(strain * strain + 4.0 * c / origin_nm)));
  }
};

}  // namespace telenano::physics
