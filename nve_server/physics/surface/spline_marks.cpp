// Marks that stay: a local change of the splines' coefficients, not of the samples. (A changed sample moves
// the coefficients of an interpolating spline everywhere, by 0.268 a node; a changed coefficient moves the
// field within two cells of its node and nowhere else.)
//
// Height. The coefficients fall by w_ij = φ(ρ_ij)(a + b ξ_ij + c η_ij), (ξ, η) = ((x_i, y_j) − mark)/radius,
// ρ its length, φ = (1 − ρ⁴)² within the rim. a, b and c follow from what the field must do at the mark: fall
// by the depth, keep both slopes, three linear equations in the moments of φ over the 16 coefficients that
// reach it. φ is nearly level over the inner half because marks come as small increments while the tip goes
// in, each with the contact's radius at that depth: an indenter lowers all that it covers by the same amount,
// and levels of growing radius add up to its own shape.
//
// Curvature of a mark with a strain. How much a place has flowed is said by its depth: each coefficient of g
// goes along the family of flow_family.h as far as the surface falls there, from where it is, so that the
// wall in front of a tip that ploughs is not hardened beyond its own depth by marks made beside it, however
// many. What then lacks at the mark to the conformity (an average of places of other depth) the 16 share.
//
// Curvature without it. The coefficients of g go to the conformity: all the way in the 16 that reach the
// mark, so that g is exact there (the weights sum to 1), and by the share φ in the others. Each remains
// between what it was and the conformity, so g stays within its bounds.
#include <algorithm>
#include <cmath>

#include "telenano/nve_server/physics/contact/flow_family.h"
#include "telenano/nve_server/physics/surface/crater.h"
#include "telenano/nve_server/physics/surface/relative_curvature.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"

namespace telenano::physics {
namespace {

constexpr double kLeastCells = 2.0;  // narrower a crater cannot be on the grid

}  // namespace

// Raises coefficients round a crater by `volume` (the sum of what they rise) in all. The 16 that reach its
// deepest point stay. False: nothing to be piled up, or nowhere.
bool SplineSurface::heap_up(double x, double y, double radius, double volume) noexcept {
  if (!(volume > 0.0)) return false;
  const BicubicSpline::Stencil at = height_.stencil(x, y);
  const double reach = kHeapReach * radius;
  const int first_row = height_.row_of(y - reach), last_row = height_.row_of(y + reach);
  const int first_column = height_.column_of(x - reach), last_column = height_.column_of(x + reach);
  double sum = 0;
  for (const bool count : {true, false}) {
    if (!count && !(sum > 0.0)) return false;
    for (int row = first_row; row <= last_row; ++row) {
      const double eta = (height_.node_y_nm(row) - y) / radius;
      for (int column = first_column; column <= last_column; ++column) {
        if (row >= at.row && row <= at.row + 3 && column >= at.column && column <= at.column + 3) continue;
        const double level = heap_level((height_.node_x_nm(column) - x) / radius, eta);
        if (!(level > 0.0)) continue;
        if (count) {
          sum += level;
        } else {
          height_.set_coefficient(column, row, height_.coefficient(column, row) + volume / sum * level);
        }
      }
    }
  }
  return true;
}

void SplineSurface::press(const Mark& mark) noexcept {
  if (!(std::isfinite(mark.x_nm) && std::isfinite(mark.y_nm) && std::isfinite(mark.depth_nm) &&
        std::isfinite(mark.radius_nm) && std::isfinite(mark.conformity) && mark.depth_nm >= 0.0 &&
        mark.radius_nm >= 0.0 && mark.pile_up >= 0.0 && std::isfinite(mark.pile_up))) {
    return;
  }
  const double x = std::clamp(mark.x_nm, x_first_nm(), x_last_nm());
  const double y = std::clamp(mark.y_nm, y_first_nm(), y_last_nm());
  const double conformity = std::clamp(mark.conformity, kMinMarkCurvature, kMaxRelativeCurvature);
  const double radius = std::max(mark.radius_nm, kLeastCells * cell_);
  const double per_radius = 1.0 / radius;
  const auto xi_of = [&](int column) { return (height_.node_x_nm(column) - x) * per_radius; };
  const auto eta_of = [&](int row) { return (height_.node_y_nm(row) - y) * per_radius; };

  const BicubicSpline::Stencil at = height_.stencil(x, y);
  double moments[3][4] = {{0, 0, 0, mark.depth_nm}, {0, 0, 0, 0}, {0, 0, 0, 0}};
  for (int r = 0; r < 4; ++r) {
    const double eta = eta_of(BicubicSpline::folded(at.row + r, height_.rows()));
    for (int c = 0; c < 4; ++c) {
      const double xi = xi_of(BicubicSpline::folded(at.column + c, height_.columns()));
      const double level = crater_level(xi, eta);
      const double terms[3] = {level, level * xi, level * eta};
      const double weight[3] = {at.x_value[c] * at.y_value[r], at.x_slope[c] * at.y_value[r],
                                at.x_value[c] * at.y_slope[r]};
      for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) moments[i][k] += weight[i] * terms[k];
      }
    }
  }
  double a[3];
  solve_crater(moments, a);

  // Coefficients within the rim, and the 16.
  const auto clamped_column = [&](int i) { return std::clamp(i, 0, height_.columns() - 1); };
  const auto clamped_row = [&](int i) { return std::clamp(i, 0, height_.rows() - 1); };
  const int first_column = std::min(height_.column_of(x - radius), clamped_column(at.column));
  const int last_column = std::max(height_.column_of(x + radius), clamped_column(at.column + 3));
  const int first_row = std::min(height_.row_of(y - radius), clamped_row(at.row));
  const int last_row = std::max(height_.row_of(y + radius), clamped_row(at.row + 3));
  double lost = 0;
  for (int row = first_row; row <= last_row; ++row) {
    const double eta = eta_of(row);
    const bool row_reaches = row >= at.row && row <= at.row + 3;
    for (int column = first_column; column <= last_column; ++column) {
      const double xi = xi_of(column);
      const double level = crater_level(xi, eta);
      const double fall = level > 0.0 ? level * (a[0] + a[1] * xi + a[2] * eta) : 0.0;
      if (level > 0.0) {
        height_.set_coefficient(column, row, height_.coefficient(column, row) - fall);
        lost += fall;
      }
      if (mark.strain > 0.0) {
        if (fall > 0.0) {
          const FlowFamily family(mark.strain, tip_radius_ / origin_->coefficient(column, row),
                                  mark.strain * tip_radius_ / kMinMarkCurvature);
          const double old = mark.strain * tip_radius_ / relative_curvature_.coefficient(column, row);
          relative_curvature_.set_coefficient(column, row,
                                              tip_radius_ / family.radius_nm(family.after_nm(old, fall)));
        }
        continue;
      }
      const bool reaches = row_reaches && column >= at.column && column <= at.column + 3;
      const double share = reaches ? 1.0 : level;
      if (share > 0.0) {
        const double old = relative_curvature_.coefficient(column, row);
        relative_curvature_.set_coefficient(column, row,
                                            reaches ? conformity : old + share * (conformity - old));
      }
    }
  }

  if (mark.strain > 0.0) {
    const double lacking = conformity - relative_curvature(x, y).value;
    for (int r = 0; r < 4; ++r) {
      for (int c = 0; c < 4; ++c) {
        const int column = at.column + c, row = at.row + r;
        if (column < 0 || row < 0 || column >= height_.columns() || row >= height_.rows()) continue;
        const double old = relative_curvature_.coefficient(column, row);
        relative_curvature_.set_coefficient(
            column, row, std::clamp(old + lacking, kMinMarkCurvature, kMaxRelativeCurvature));
      }
    }
  }

  const double reach = heap_up(x, y, radius, mark.pile_up * lost) ? kHeapReach * radius : radius;
  const int left = std::min(first_column, height_.column_of(x - reach));
  const int right = std::max(last_column, height_.column_of(x + reach));
  const int low = std::min(first_row, height_.row_of(y - reach));
  const int high = std::max(last_row, height_.row_of(y + reach));

  // The nodes that these coefficients reach: one further in each direction.
  const double reach_sq = (reach + 1.4143 * cell_) * (reach + 1.4143 * cell_);
  for (int row = clamped_row(low - 1); row <= clamped_row(high + 1); ++row) {
    const double ey = height_.node_y_nm(row) - y;
    for (int column = clamped_column(left - 1); column <= clamped_column(right + 1); ++column) {
      const double ex = height_.node_x_nm(column) - x;
      if (ex * ex + ey * ey > reach_sq) continue;
      const double z = height_.node_value(column, row);
      tops_.set(column, row, z);
      view_->store(column, row, z);
    }
  }
  marked_ = true;
  view_->publish();
  if (++stamp_ == 0) stamp_ = 1;
}

}  // namespace telenano::physics
