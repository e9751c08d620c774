// Marks in the fields of a scan: a local change of their coefficients, not of the nodes (spline_marks.cpp
// does the same for heights and says why). On each grid the coefficients of H fall by φ(a + b ξ + c η), φ the
// crater's level (crater.h), both levels of softening alike, such that H falls by the depth at the mark and
// keeps both slopes there; so the overlap at every apex there is what it was a depth higher, the softening,
// which goes by the distance from touch, included. Grids too coarse for the crater spread it over
// kLeastNodes of theirs. ρ follows the depth by the flow's own law; what then lacks to the rise at the mark
// the 16 coefficients share that reach it. The cosine stays.
#include <algorithm>
#include <cmath>
#include <span>

#include "telenano/nve_server/physics/surface/coefficient_change.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "telenano/nve_server/physics/surface/scan_pressing.h"

namespace telenano::physics {
namespace {

bool is_mark(const FieldMark& mark) noexcept {
  return std::isfinite(mark.x_nm) && std::isfinite(mark.y_nm) && std::isfinite(mark.depth_nm) &&
         std::isfinite(mark.radius_nm) && std::isfinite(mark.log_radius_rise) && std::isfinite(mark.strain) &&
         std::isfinite(mark.pile_up) && mark.depth_nm >= 0.0 && mark.radius_nm >= 0.0 && mark.strain >= 0.0 &&
         mark.pile_up >= 0.0 && mark.last_radius_nm > 0.0;
}

}  // namespace

void ScanFields::press(std::span<Grid* const> grids, const FieldMark& mark, double x, double y) noexcept {
  Pressing pressing(grids, mark, x, y);
  const Pressing::Reach& reach = pressing.reach();
  for (Grid* const grid : grids) {
    grid->make_usable(reach.first_column, reach.last_column, reach.first_row, reach.last_row);
    if (strokes_ != nullptr)
      grid->keep_tiles(*strokes_, number_of_grid(*grid), reach.first_column, reach.last_column,
                       reach.first_row, reach.last_row);
  }
  pressing.lower_crater();
  pressing.rise_at_mark();
  pressing.pile_up();
}

void ScanFields::press(const FieldMark& mark) noexcept {
  if (!is_mark(mark) || !grids_[0].own) return;
  bool back_x, back_y;
  const double x = mirrored(mark.x_nm - x_first_, width_, back_x);
  const double y = mirrored(mark.y_nm - y_first_, length_, back_y);
  for (std::size_t g = 0; g < grids_.size(); ++g) {
    const Grid& grid = grids_[g];
    if (g == 0 || grid.columns != grids_[g - 1].columns) press_alike(grid, mark, x, y);
    const double spread = Pressing::kLeastNodes * std::max(1.0 / grid.inv_dx, 1.0 / grid.inv_dy);
    if (g == 0 || spread <= mark.radius_nm || grids_[g - 1].columns == grid.columns) continue;
    hold_up(g, x, y);
  }
}

// Where the crater is spread on a coarse grid that falls more than the finer one does round it, and a larger
// softening must not lower the ground so much that pressing deeper would lift it away (scan_fields_build.cpp):
// held up there, but for the 16 that the mark itself needs.
void ScanFields::hold_up(std::size_t g, double x, double y) noexcept {
  Grid& grid = grids_[g];
  const Grid& finer = grids_[g - 1];
  const double most_fall = 0.53 * rule_.finest_nm * (1 << (2 * g - 1));
  const int column = std::min(static_cast<int>(x * grid.inv_dx), grid.columns - 2);
  const int row = std::min(static_cast<int>(y * grid.inv_dy), grid.rows - 2);
  constexpr int kReach = static_cast<int>(Pressing::kLeastNodes) + 1;
  const int left = std::max(0, column + 1 - kReach), right = std::min(grid.columns + 1, column + 2 + kReach);
  const int low = std::max(0, row + 1 - kReach), high = std::min(grid.rows + 1, row + 2 + kReach);
  grid.make_usable(left, right, low, high);
  if (strokes_ != nullptr) grid.keep_tiles(*strokes_, g, left, right, low, high);
  for (int j = low; j <= high; ++j) {
    for (int i = left; i <= right; ++i) {
      if (i >= column && i <= column + 3 && j >= row && j <= row + 3) continue;
      const auto number = static_cast<std::size_t>(j * (grid.columns + 2) + i);
      double* const at = grid.own + number * kLanes;
      const int fi = 2 * folded(i - 1, grid.columns), fj = 2 * folded(j - 1, grid.rows);
      const double* const fine = finer.corner(fi, fj) + finer.stride() + kLanes + 3;
      const double lacking = std::max(0.0, *fine - most_fall - at[0]);
      if (!(lacking > 0.0)) continue;
      const Grid::Changing changing(grid, number);
      at[0] += lacking;
      at[3] += lacking;
    }
  }
}

// All grids that share this one's nodes.
void ScanFields::press_alike(const Grid& one, const FieldMark& mark, double x, double y) noexcept {
  Grid* alike[kMostTogether];
  std::size_t count = 0;
  const auto number = static_cast<std::uint32_t>(grids_.size() + layers_.size());
  for (std::uint32_t n = 0; n < number; ++n) {
    Grid* const grid = grid_of(n);
    if (grid->columns != one.columns || grid->rows != one.rows) continue;
    alike[count++] = grid;
    if (count < kMostTogether) continue;
    press({alike, count}, mark, x, y);
    count = 0;
  }
  if (count > 0) press({alike, count}, mark, x, y);
}

}  // namespace telenano::physics
