#include "nve_server/physics/surface.h"

#include <algorithm>
#include <cmath>

namespace telenano::physics {

EffectiveRadius effective_radius(double tip_radius_nm, const SurfaceContact& contact) noexcept {
  // In units of the tip's own curvature, so that 1 is a flat sample.
  const double c1 = 1.0 + tip_radius_nm * contact.curvature_1_per_nm;
  const double c2 = 1.0 + tip_radius_nm * contact.curvature_2_per_nm;
  const double kept_1 = std::max(c1, kMinRelativeCurvature);
  const double kept_2 = std::max(c2, kMinRelativeCurvature);
  return {tip_radius_nm / std::sqrt(kept_1 * kept_2), kept_1 != c1 || kept_2 != c2};
}

}  // namespace telenano::physics
