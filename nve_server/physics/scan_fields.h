#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "nve_server/physics/contact_fields.h"
#include "nve_server/physics/dilation.h"
#include "nve_server/physics/height_grid.h"
#include "nve_server/physics/softening.h"

namespace telenano::physics {

/// The ground of a scan as fields of the apex: levels of softening t0 2^k (dilation.h), blended over the
/// level that softening.h gives to the distance from touch.
///
/// Formula   v = H − z, δ = v c, with F(x, y, z) = Σ_k w_k(level(v0)) F_k(x, y) for F = H, ρ, c and v0 = z −
///           H_0(x, y). Planes are exact as each level is. On a curved foot at an angle θ the normal overlap
///           is more by v² sin²θ/(2(R + 1/κ)): 0.2 % of v at v = 0.3 nm, 30°, R = 20 nm on a ball of that
///           radius.
/// Grids     Two levels share one grid; the first two grids are equally fine, each next one is twice as wide.
///           Fields are bicubic B-splines by the quasi-interpolant c = (1 − Δ/6)f along x and y, which a
///           node's neighbours fix (error O(h⁴)). That of c is kept between the least and the greatest of the
///           3 × 3 nodes, for it may not overshoot beside a cliff. Energy does not depend on the grid:
///           derivatives are those of these splines. Creases over grooves, t0 over the difference of their
///           slopes wide, are rounded off: H by 0.03 nm and two feet to 1.8 of one radius on a groove of ±15°
///           at nodes 1 nm apart, 0.004 nm and 1.94 at 0.27 nm.
/// Growth    A larger t may lower H where much lies just below the top, and pressing deeper would then lift
///           the ground away. The coarser levels are held high enough (hold_growth) that −∂δ/∂z stays above
///           kLeastRate and a Hertzian contact stable, seen at 14 400 places of each of two real scans.
/// Blend     Value and gradient go on without a step; second derivatives step where three levels become the
///           next three (quadratic B-splines over the level).
/// Outside   the scan its mirror image goes on.
class ScanFields final : public ContactFields {
 public:
  /// Needs at least 2×2 finite samples, positive spacing, radius and softenings; UserError. For each of the
  /// `fixed_softenings_nm` at_softening() has a layer made at just that length: exact, and one stencil.
  ScanFields(const HeightGrid& grid, double tip_radius_nm, const SofteningRule& rule,
             const std::vector<double>& fixed_softenings_nm = {});

  void contact_at(const Vec3& apex_w_nm, ContactJet& jet) const noexcept override;
  void growing_at(const Vec3& apex_w_nm, const SofteningRule& rule, ContactJet& jet) const noexcept override;
  void at_softening(const Vec3& apex_w_nm, double softening_nm, ContactJet& jet) const noexcept override;
  void values_at_softening(const Vec3& apex_w_nm, double softening_nm, double& overlap_nm,
                           double& log_radius) const noexcept override;

  /// Apex height of first touch, at the finest softening.
  double touch_height_nm(double x_nm, double y_nm) const noexcept;
  const SofteningRule& rule() const noexcept { return rule_; }
  int levels() const noexcept { return levels_; }
  double tip_radius_nm() const noexcept { return radius_; }
  std::size_t bytes() const noexcept;
  /// FNV-1a over all coefficients: the same on every machine.
  std::uint64_t hash() const noexcept;

  static constexpr double kLeastRate = 0.3;

 private:
  static constexpr int kLanes = 6;  // H, ρ, c of the even level, then of the odd one
  struct Grid {
    int columns = 0, rows = 0;  // of nodes
    double inv_dx = 1, inv_dy = 1;
    std::vector<double> coefficients;  // (columns + 2)(rows + 2) kLanes, one node more at either side
  };
  struct Layer {
    double softening_nm = 0;
    Grid grid;  // kLayerLanes lanes
  };
  static constexpr int kLayerLanes = 4;  // H, ρ, c, 0
  const Layer* layer_of(double softening_nm) const noexcept;
  static void hold_growth(Grid& grid, double fine_t);
  static void hold_growth(const Grid& finer, Grid& coarse, double fine_t);
  struct Place;
  Place place(double x_nm, double y_nm) const noexcept;
  void blended(const Place& place, const LevelBlend& blend, const double (&first_jet)[6], double z_nm,
               const SofteningLevel& level, ContactJet& jet) const noexcept;

  SofteningRule rule_;
  double radius_;
  int levels_;
  double x_first_, y_first_, width_, length_;
  std::vector<Grid> grids_;
  std::vector<Layer> layers_;
};

}  // namespace telenano::physics
