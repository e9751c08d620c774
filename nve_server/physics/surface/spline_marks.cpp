// Marks that stay: a local change of the spline's coefficients, not of the samples. (A changed sample moves
// the coefficients of an interpolating spline everywhere, by 0.268 a node; a changed coefficient moves the
// field within two cells of its node and nowhere else.)
//
// The coefficients fall by w_ij = φ(ρ_ij)(a + b ξ_ij + c η_ij), (ξ, η) = ((x_i, y_j) − mark)/radius,
// ρ its length, φ = (1 − ρ⁴)² within the rim. a, b and c follow from what the field must do at the mark: fall
// by the depth, keep both slopes, three linear equations in the moments of φ over the 16 coefficients that
// reach it. φ is nearly level over the inner half because marks come as small increments while the tip goes
// in, each with the contact's radius at that depth: an indenter lowers all that it covers by the same amount,
// and levels of growing radius add up to its own shape.
#include <algorithm>
#include <cmath>

#include "telenano/nve_server/physics/surface/crater.h"
#include "telenano/nve_server/physics/surface/heap_rows.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"

namespace telenano::physics {
namespace {

constexpr double kLeastCells = 2.0;  // narrower a crater cannot be on the grid
constexpr int kAtOnce = 64;
constexpr int kTile = 16;
constexpr int tiles_along(int nodes) noexcept {
  return (nodes + kTile - 1) / kTile;
}

}  // namespace

// Raises coefficients round a crater by `volume` (the sum of what they rise) in all. The 16 that reach its
// deepest point stay. False: nothing to be piled up, or nowhere.
bool SplineSurface::heap_up(double x, double y, double radius, double volume) noexcept {
  if (!(volume > 0.0)) return false;
  const BicubicSpline::Stencil at = height_.stencil(x, y);
  const double reach = kHeapReach * radius;
  const int first_row = height_.row_of(y - reach), last_row = height_.row_of(y + reach);
  const int first_column = height_.column_of(x - reach), last_column = height_.column_of(x + reach);
  const auto xi_of = [&](int column) { return (height_.node_x_nm(column) - x) / radius; };
  ColumnPlaces places(first_column, last_column, xi_of);
  HeapRows heap;
  // In runs of columns, without the 16.
  const auto each = [&](const auto& use) {
    for (int row = first_row; row <= last_row; ++row) {
      const double eta = (height_.node_y_nm(row) - y) / radius;
      const bool crosses = row >= at.row && row <= at.row + 3;
      for (int from = first_column; from <= last_column; from += HeapRows::kBlock) {
        const int count = std::min(HeapRows::kBlock, last_column + 1 - from);
        const double* const level = heap.levels(from, count, eta, places);
        if (!crosses) {
          use(from, row, count, level);
          continue;
        }
        const int before = std::clamp(at.column - from, 0, count);
        const int behind = std::clamp(at.column + 4 - from, 0, count);
        use(from, row, before, level);
        use(from + behind, row, count - behind, level + behind);
      }
    }
  };
  double sum = 0;
  each([&](int, int, int count, const double* level) {
    for (int i = 0; i < count; ++i) sum += level[i];
  });
  if (!(sum > 0.0)) return false;
  const double per_level = volume / sum;
  heap.again();
  each([&](int column, int row, int count, const double* level) {
    if (count > 0) height_.raise(column, row, count, level, per_level);
  });
  return true;
}

std::size_t SplineSurface::tiles() const noexcept {
  return static_cast<std::size_t>(tiles_along(columns())) * static_cast<std::size_t>(tiles_along(rows()));
}

template <class Use>
void SplineSurface::each_in_tile(std::size_t tile, const Use& use) noexcept {
  const int across = static_cast<int>(tile) % tiles_along(columns());
  const int along = static_cast<int>(tile) / tiles_along(columns());
  for (int row = along * kTile; row < std::min((along + 1) * kTile, rows()); ++row) {
    for (int column = across * kTile; column < std::min((across + 1) * kTile, columns()); ++column)
      use(column, row);
  }
}

void SplineSurface::keep_tiles(int left, int right, int low, int high) noexcept {
  static_assert(StrokeHistory::kTileValues >= std::size_t{2} * kTile * kTile);
  if (strokes_ == nullptr) return;
  for (int along = std::max(low, 0) / kTile; along <= std::min(high, rows() - 1) / kTile; ++along) {
    for (int across = std::max(left, 0) / kTile; across <= std::min(right, columns() - 1) / kTile; ++across) {
      const auto tile = static_cast<std::size_t>(along * tiles_along(columns()) + across);
      double* to = strokes_->keep(history_grid_, tile);
      if (to == nullptr) continue;
      each_in_tile(tile, [&](int column, int row) {
        const Node now = node(column, row);
        *to++ = now.height_coefficient_nm;
        *to++ = now.height_nm;
      });
    }
  }
}

void SplineSurface::exchange_tile(std::size_t tile, double* values) noexcept {
  each_in_tile(tile, [&](int column, int row) {
    const Node now = node(column, row);
    const Node before{values[0], values[1]};
    values[0] = now.height_coefficient_nm;
    values[1] = now.height_nm;
    values += 2;
    if (!(now == before)) set_node(column, row, before);
  });
}

void SplineSurface::press(const Mark& mark) noexcept {
  if (!(std::isfinite(mark.x_nm) && std::isfinite(mark.y_nm) && std::isfinite(mark.depth_nm) &&
        std::isfinite(mark.radius_nm) && mark.depth_nm >= 0.0 && mark.radius_nm >= 0.0 &&
        mark.pile_up >= 0.0 && std::isfinite(mark.pile_up))) {
    return;
  }
  const double x = std::clamp(mark.x_nm, x_first_nm(), x_last_nm());
  const double y = std::clamp(mark.y_nm, y_first_nm(), y_last_nm());
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

  // Coefficients within the rim.
  const int first_column = height_.column_of(x - radius), last_column = height_.column_of(x + radius);
  const int first_row = height_.row_of(y - radius), last_row = height_.row_of(y + radius);
  // All that this mark may change: the nodes round the widest circle, and one more in each direction.
  const double widest = mark.pile_up > 0.0 ? kHeapReach * radius : radius;
  keep_tiles(height_.column_of(x - widest) - 1, height_.column_of(x + widest) + 1,
             height_.row_of(y - widest) - 1, height_.row_of(y + widest) + 1);
  double lost = 0;
  ColumnPlaces places(first_column, last_column, xi_of);
  for (int row = first_row; row <= last_row; ++row) {
    const double eta = eta_of(row);
    for (int from = first_column; from <= last_column; from += kAtOnce) {
      const int count = std::min(kAtOnce, last_column + 1 - from);
      const double* const xi = places.of(from, count);
      double level[kAtOnce], fall[kAtOnce];
      for (int i = 0; i < count; ++i) {
        level[i] = crater_level(xi[i], eta);
        fall[i] = level[i] * (a[0] + a[1] * xi[i] + a[2] * eta);
      }
      for (int i = 0; i < count; ++i) lost += level[i] > 0.0 ? fall[i] : 0.0;
      height_.lower(from, row, count, level, fall);
    }
  }

  const double reach = heap_up(x, y, radius, mark.pile_up * lost) ? kHeapReach * radius : radius;
  const int left = height_.column_of(x - reach), right = height_.column_of(x + reach);
  const int low = height_.row_of(y - reach), high = height_.row_of(y + reach);
  const auto clamped_column = [&](int i) { return std::clamp(i, 0, height_.columns() - 1); };
  const auto clamped_row = [&](int i) { return std::clamp(i, 0, height_.rows() - 1); };

  // The nodes that these coefficients reach: one further in each direction.
  const double reach_sq = (reach + 1.4143 * cell_) * (reach + 1.4143 * cell_);
  const int first_node = clamped_column(left - 1), last_node = clamped_column(right + 1);
  for (int begin = first_node; begin <= last_node; begin += NodeRows::kMost) {
    const int end = std::min(begin + NodeRows::kMost, last_node + 1);
    NodeRows nodes(height_, begin, end - begin, clamped_row(low - 1));
    for (int row = clamped_row(low - 1); row <= clamped_row(high + 1); ++row, nodes.next()) {
      const double ey = height_.node_y_nm(row) - y;
      const auto is_reached = [&](int column) {
        const double ex = height_.node_x_nm(column) - x;
        return !(ex * ex + ey * ey > reach_sq);
      };
      int from = begin, last = end - 1;
      while (from <= last && !is_reached(from)) ++from;
      while (last >= from && !is_reached(last)) --last;
      double z_nm[NodeRows::kMost];
      nodes.values(from - begin, last + 1 - from, z_nm);
      store_row(from, row, last + 1 - from, z_nm);
    }
  }
  marked_ = true;
  view_->publish();
}

}  // namespace telenano::physics
