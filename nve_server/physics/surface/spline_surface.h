#pragma once

#include <cstdint>
#include <memory>

#include "telenano/nve_server/physics/surface/bicubic_spline.h"
#include "telenano/nve_server/physics/surface/height_grid.h"
#include "telenano/nve_server/physics/surface/height_view.h"
#include "telenano/nve_server/physics/surface/mark.h"
#include "telenano/nve_server/physics/surface/sample_tops.h"
#include "telenano/nve_server/physics/surface/surface.h"

namespace telenano::physics {

/// The heights of a grid as an interpolating bicubic B-spline (bicubic_spline.h): C², so normals are smooth
/// and curvatures continuous.
///
/// Effective radius. The spline's curvatures have kinks at the borders of its cells: a radius made of them at
/// the foot has a gradient that jumps, and with it the lateral force −∂U/∂R_eff ∇R_eff. So the relative
/// curvature g = R/R_eff (surface.h) is a second spline over the foot's (x, y): averaging, with the g of the
/// height spline's curvatures at the grid's nodes as coefficients. R_eff = R/g is C² in the foot and, g being
/// an average of its nodes, never beyond their range (0 < R_eff <= R/kMinRelativeCurvature,
/// R/kMinMarkCurvature in a mark): g is the curvature seen over about a cell, as a contact of a few
/// nanometres sees it. Error against the curvature at the point: h²/6 of its second derivative; none where it
/// is constant. With the foot's (x, y) moving by M⁻¹Tᵀdc (nearest_point.cpp), ∂R_eff/∂c = −(R/g²) T M⁻¹ ∇g.
///
/// Marks. press() lowers the surface and keeps it so: spline_marks.cpp says how. One thread presses and
/// searches; others look through view(). A copy starts with the same heights and goes its own way: each
/// session has its own sample.
class SplineSurface final : public Surface {
 public:
  /// Needs at least 2×2 finite samples, positive spacing and a positive tip radius.
  SplineSurface(const HeightGrid& grid, double tip_radius_nm);

  SplineSurface(const SplineSurface& other);
  SplineSurface(SplineSurface&&) noexcept = default;
  SplineSurface& operator=(const SplineSurface&) = delete;
  SplineSurface& operator=(SplineSurface&&) = delete;
  ~SplineSurface() override = default;

  HeightJet jet(double x_nm, double y_nm) const noexcept { return height_.jet(x_nm, y_nm); }
  bool inside(double x_nm, double y_nm) const noexcept { return height_.inside(x_nm, y_nm); }
  /// g = R/R_eff at a foot, and its gradient (1/nm).
  ValueAndSlope relative_curvature(double x_nm, double y_nm) const noexcept {
    return relative_curvature_.value_and_slope(x_nm, y_nm);
  }

  SurfaceContact nearest(const Vec3& centre_w_nm, Search search, FootMemory& memory) const noexcept override;
  double height_nm(double x_nm, double y_nm) const noexcept override { return jet(x_nm, y_nm).z; }
  double lowest_nm() const noexcept override { return tops_.lowest_nm(); }
  double highest_nm() const noexcept override { return tops_.highest_nm(); }
  bool is_flat() const noexcept override { return false; }

  /// Afterwards, at the mark: the height is less by its depth, the gradient what it was, g the conformity
  /// (to rounding); nothing has changed where |x − mark.x| or |y − mark.y| exceeds radius + 2 cells (radius
  /// taken as 2 cells at least, the finest that this grid can show). Beyond the rim of the grid the mark is
  /// made at the nearest point of the rim. A mark that is no number, or has a negative depth or radius,
  /// changes nothing; the conformity is kept in [kMinMarkCurvature, kMaxRelativeCurvature]. Takes
  /// O(radius²/cell²).
  void press(const Mark& mark) noexcept;
  HeightGrid heights() const;  ///< at the nodes, as they are now

  /// What marks have changed, for those who compare two surfaces, or carry one's marks over to another of the
  /// same scan.
  std::uint64_t marks_digest() const noexcept {
    return height_.changes_digest() + 3 * relative_curvature_.changes_digest() + (marked_ ? 1u : 0u);
  }
  bool marked() const noexcept { return marked_; }
  std::uint32_t stamp() const noexcept { return stamp_; }  ///< another one whenever the heights are others
  int columns() const noexcept { return height_.columns(); }
  int rows() const noexcept { return height_.rows(); }
  /// What a mark may change at a node. Its own height is not quite that of the coefficients where no mark
  /// came by: that is the scan's.
  struct Node {
    double height_coefficient_nm = 0;
    double relative_curvature = 0;  ///< coefficient
    double height_nm = 0;
    friend bool operator==(const Node&, const Node&) = default;
  };
  Node node(int column, int row) const noexcept {
    return {height_.coefficient(column, row), relative_curvature_.coefficient(column, row),
            tops_.height_nm(column, row)};
  }
  /// After the last of them: settle(). Neither allocates.
  void set_node(int column, int row, const Node& node) noexcept;
  void settle(bool marked) noexcept;
  /// For other threads; stays valid when the surface has gone.
  std::shared_ptr<const HeightView> view() const noexcept { return view_; }

  double tip_radius_nm() const noexcept { return tip_radius_; }
  double x_first_nm() const noexcept { return height_.x_first_nm(); }
  double y_first_nm() const noexcept { return height_.y_first_nm(); }
  double x_last_nm() const noexcept { return height_.x_last_nm(); }
  double y_last_nm() const noexcept { return height_.y_last_nm(); }

 private:
  bool heap_up(double x_nm, double y_nm, double radius_nm, double volume) noexcept;
  struct Foot;
  Foot descend(const Vec3& centre_w_nm, double x_nm, double y_nm, const HeightJet& start,
               bool jet_is_old) const noexcept;
  Foot deepest_basin(const Vec3& centre_w_nm, Foot foot) const noexcept;
  SurfaceContact contact_at(const Vec3& centre_w_nm, const Foot& foot) const noexcept;

  double tip_radius_;
  double cell_;  // the wider spacing
  BicubicSpline height_;
  BicubicSpline relative_curvature_;
  std::shared_ptr<const BicubicSpline> origin_;  // g before any mark, shared by all copies
  bool marked_ = false;
  SampleTops tops_;  // for the global search
  std::shared_ptr<HeightView> view_;
  std::uint32_t stamp_ = 1;  // of the heights: a jet remembered under another is out of date
};

}  // namespace telenano::physics
