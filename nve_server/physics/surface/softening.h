#pragma once

namespace telenano::physics {

/// How deep a layer of gap takes part in a contact: the softening length t of the fields (dilation.h), and
/// how it grows with the distance from touch.
///
/// Formula   v0 = apex height − height of first touch at the finest t. With
///             ξ = −v0 − onset pressed, v0 − dead zone in a gap (0 between), s = ξ³/(ξ² + ξ0²), ξ0 = 0.1 nm,
///             q = α s,  q_c = q/(1 + (q/q_m)⁴)^¼,  t² = t0² + q_c²,  q_m² = t_m² − t0²
///           and level(v0) = log₂(t/t0), which the levels t0 2^k of the fields are blended over.
/// Validity  t0 < t_m; v0 of any size. C² in v0 (s ~ ξ³ where it begins), and s' <= 1.125.
/// Source    t0 and α from boundary-element solutions with Lennard-Jones adhesion; a gap's force R/d² decays
///           over d/2, so that t must be a good part of d there
///           (0.6 against direct sums over self-affine grounds of rms slope 0.1 and 0.25, gaps 0.6 to 16 nm;
///           0.45 and 0.55 were worse at each). The pull-off happens within two ranges of the adhesion above
///           touch: growing there would spoil it, hence the dead zone. Nor may it begin at touch itself: a
///           radius that grows with the depth attracts, and where the ground is steep that made the greatest
///           attraction lie 0.15 to 0.2 nm below touch, twice too large. Onset and α by boundary elements
///           over self-affine grounds of rms slope 0.15 and 0.35 (H = 0.8, 18 places each; pull-off's ninth
///           decile): α = 0.7 from touch on 15 and 79 %; from 0.3 z0 (0.05 nm) α = 0.5, 0.6, 0.7, 0.8 10, 10,
///           10, 14 and 26, 18, 30, 37 %; from 0.6 z0 10 and 28 %. Pressed it is the same to 1 % of the
///           force.
struct SofteningRule {
  double finest_nm = 0.09;  ///< t0
  double coarsest_nm = 5;   ///< t_m
  double pressed_growth = 0.6;
  double gap_growth = 0.6;
  double dead_zone_nm = 0.33;
  double pressed_onset_nm = 0.05;
};

/// The rule for a contact of radius R (nm), work of adhesion w (N/m, >= 0), reduced modulus E* (GPa) and
/// range of the adhesion z0 (nm): t0/z0 = 0.36 + 0.47 x²/(x + 2.65), x = u_δ/z0, u_δ = (π²w²R/K²)^⅓, K =
/// 4E*/3, led smoothly to at most R/4; t_m = R/4; dead zone 2 z0; onset 0.3 z0.
SofteningRule softening_rule(double radius_nm, double work_of_adhesion_n_per_m, double modulus_gpa,
                             double range_nm) noexcept;

/// Level and its derivatives in v0.
struct SofteningLevel {
  double level = 0;
  double slope_per_nm = 0;
  double bend_per_nm2 = 0;
};
SofteningLevel softening_level(const SofteningRule& rule, double v0_nm) noexcept;

/// Level of a fixed t, at least 0.
double level_of_softening(const SofteningRule& rule, double softening_nm) noexcept;

/// Number of levels t0 2^k that blending up to t_m needs, 3 to kMaxLevels.
inline constexpr int kMaxLevels = 12;
int level_count(const SofteningRule& rule) noexcept;

/// Weights of the levels `first`, first + 1, first + 2 in the blend, with derivatives in the level: quadratic
/// B-splines, which average and so keep what all levels agree on (planes); at the fine end linear between
/// levels 0 and 1, so that level 0 alone is left where t = t0. The last level stands for all coarser ones.
struct LevelBlend {
  int first = 0;
  double weight[3] = {1, 0, 0};
  double slope[3] = {0, 0, 0};
  double bend[3] = {0, 0, 0};
};
LevelBlend blend_levels(double level, int count) noexcept;

}  // namespace telenano::physics
