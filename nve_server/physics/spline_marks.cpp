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
// Curvature. The coefficients of g go to the conformity: all the way in the 16 that reach the mark, so that g
// is exact there (the weights sum to 1), and by the share φ in the others. Each remains between what it was
// and the conformity, so g stays within its bounds.
#include <algorithm>
#include <cmath>

#include "nve_server/physics/relative_curvature.h"
#include "nve_server/physics/spline_surface.h"

namespace telenano::physics {
namespace {

constexpr double kLeastCells = 2.0;  // narrower a crater cannot be on the grid

// φ at (ξ, η).
double level_of(double xi, double eta) noexcept {
  const double rho_sq = xi * xi + eta * eta;
  if (!(rho_sq < 1.0)) return 0.0;
  const double rest = 1.0 - rho_sq * rho_sq;
  return rest * rest;
}

// Unknowns a, b, c from three equations, by elimination. On the rim the slope across is nil whatever is done:
// that equation is empty then, and its unknown left at 0.
void solve(double (&m)[3][4], double (&out)[3]) noexcept {
  constexpr double kEmpty = 1e-9;
  bool used[3];
  for (int k = 0; k < 3; ++k) {
    used[k] = std::abs(m[k][k]) > kEmpty;
    if (!used[k]) continue;
    for (int i = k + 1; i < 3; ++i) {
      const double factor = m[i][k] / m[k][k];
      for (int j = k; j < 4; ++j) m[i][j] -= factor * m[k][j];
    }
  }
  for (int k = 2; k >= 0; --k) {
    double sum = m[k][3];
    for (int j = k + 1; j < 3; ++j) sum -= m[k][j] * out[j];
    out[k] = used[k] ? sum / m[k][k] : 0.0;
  }
}

}  // namespace

void SplineSurface::press(const Mark& mark) noexcept {
  if (!(std::isfinite(mark.x_nm) && std::isfinite(mark.y_nm) && std::isfinite(mark.depth_nm) &&
        std::isfinite(mark.radius_nm) && std::isfinite(mark.conformity) && mark.depth_nm >= 0.0 &&
        mark.radius_nm >= 0.0)) {
    return;
  }
  const double x = std::clamp(mark.x_nm, x_first_nm(), x_last_nm());
  const double y = std::clamp(mark.y_nm, y_first_nm(), y_last_nm());
  const double conformity = std::clamp(mark.conformity, kMinRelativeCurvature, kMaxRelativeCurvature);
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
      const double level = level_of(xi, eta);
      const double terms[3] = {level, level * xi, level * eta};
      const double weight[3] = {at.x_value[c] * at.y_value[r], at.x_slope[c] * at.y_value[r],
                                at.x_value[c] * at.y_slope[r]};
      for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) moments[i][k] += weight[i] * terms[k];
      }
    }
  }
  double a[3];
  solve(moments, a);

  // Coefficients within the rim, and the 16.
  const auto clamped_column = [&](int i) { return std::clamp(i, 0, height_.columns() - 1); };
  const auto clamped_row = [&](int i) { return std::clamp(i, 0, height_.rows() - 1); };
  const int first_column = std::min(height_.column_of(x - radius), clamped_column(at.column));
  const int last_column = std::max(height_.column_of(x + radius), clamped_column(at.column + 3));
  const int first_row = std::min(height_.row_of(y - radius), clamped_row(at.row));
  const int last_row = std::max(height_.row_of(y + radius), clamped_row(at.row + 3));
  for (int row = first_row; row <= last_row; ++row) {
    const double eta = eta_of(row);
    const bool row_reaches = row >= at.row && row <= at.row + 3;
    for (int column = first_column; column <= last_column; ++column) {
      const double xi = xi_of(column);
      const double level = level_of(xi, eta);
      if (level > 0.0) {
        const double fall = level * (a[0] + a[1] * xi + a[2] * eta);
        height_.set_coefficient(column, row, height_.coefficient(column, row) - fall);
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

  // The nodes that these coefficients reach: one further in each direction.
  const double reach_sq = (radius + 1.4143 * cell_) * (radius + 1.4143 * cell_);
  for (int row = clamped_row(first_row - 1); row <= clamped_row(last_row + 1); ++row) {
    const double ey = height_.node_y_nm(row) - y;
    for (int column = clamped_column(first_column - 1); column <= clamped_column(last_column + 1); ++column) {
      const double ex = height_.node_x_nm(column) - x;
      if (ex * ex + ey * ey > reach_sq) continue;
      const double z = height_.node_value(column, row);
      tops_.set(column, row, z);
      view_->store(column, row, z);
    }
  }
  view_->publish();
  if (++stamp_ == 0) stamp_ = 1;
}

}  // namespace telenano::physics
