#pragma once

#include "telenano/nve_server/physics/surface/height_jet.h"

namespace telenano::physics {

/// The radius of the sphere on a flat that is locally the same gap as this tip on this surface: the Gaussian
/// curvature of the gap's paraboloid decides the contact's size,
///
///   1/R_eff = √((1/R + κ₁)(1/R + κ₂)),   g = R/R_eff = √((1 + Rκ₁)(1 + Rκ₂)),
///
/// κ the sample's principal curvatures (1/nm, a summit's positive). Exact for Hertz contact on a sphere (κ₁ =
/// κ₂: R_eff = Rρ/(R + ρ)); for unequal curvatures the ellipse of contact is replaced by the circle of its
/// geometric mean.
///
/// Valid while both factors are positive: a tip wider than the pit it stands in touches elsewhere first. Each
/// factor is kept above kMinRelativeCurvature, so R_eff <= R/kMinRelativeCurvature.
inline constexpr double kMinRelativeCurvature = 0.1;
inline constexpr double kMinMarkCurvature = 1e-4;     ///< of a mark: flattened by flow, not a pit
inline constexpr double kMaxRelativeCurvature = 1e3;  ///< of a mark

struct PrincipalCurvatures {
  double first_1_per_nm = 0;  ///< the greater
  double second_1_per_nm = 0;
};

/// Of the height field, at the point of the jet.
PrincipalCurvatures principal_curvatures(const HeightJet& jet) noexcept;

/// A factor c = 1 + Rκ, kept above m = kMinRelativeCurvature: c from 2m upwards, m from 0 downwards, between
/// them m + 2m(u³ − u⁴/2), u = c/2m, which is C² and rises throughout.
double kept_factor(double factor) noexcept;

/// A factor that is not as it was.
inline bool is_clamped(double factor) noexcept {
  return factor < 2.0 * kMinRelativeCurvature;
}

/// g, with its factors kept.
double relative_curvature(double tip_radius_nm, const PrincipalCurvatures& curvatures) noexcept;

}  // namespace telenano::physics
