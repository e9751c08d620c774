#include "telenano/nve_server/physics/surface/relative_curvature.h"

#include <algorithm>
#include <cmath>

namespace telenano::physics {

PrincipalCurvatures principal_curvatures(const HeightJet& j) noexcept {
  const double per_w_sq = 1.0 / (1.0 + j.zx * j.zx + j.zy * j.zy);
  const double mean =
      -0.5 * ((1.0 + j.zy * j.zy) * j.zxx - 2.0 * j.zx * j.zy * j.zxy + (1.0 + j.zx * j.zx) * j.zyy) *
      (per_w_sq * std::sqrt(per_w_sq));
  const double gauss = (j.zxx * j.zyy - j.zxy * j.zxy) * (per_w_sq * per_w_sq);
  const double spread = std::sqrt(std::max(0.0, mean * mean - gauss));
  return {mean + spread, mean - spread};
}

double kept_factor(double factor) noexcept {
  constexpr double m = kMinRelativeCurvature;
  if (factor >= 2.0 * m) return factor;
  if (factor <= 0.0) return m;
  const double u = factor / (2.0 * m);
  return m + 2.0 * m * u * u * u * (1.0 - 0.5 * u);
}

double relative_curvature(double tip_radius_nm, const PrincipalCurvatures& curvatures) noexcept {
  return std::sqrt(kept_factor(1.0 + tip_radius_nm * curvatures.first_1_per_nm) *
                   kept_factor(1.0 + tip_radius_nm * curvatures.second_1_per_nm));
}

}  // namespace telenano::physics
