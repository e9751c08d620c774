#include "telenano/nve_server/physics/surface/spline_surface.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/error.h"

namespace telenano::physics {
namespace {

const HeightGrid& checked(const HeightGrid& grid) {
  if (grid.columns < 2 || grid.rows < 2) throw UserError("surface: expected at least 2×2 samples");
  if (grid.z_nm.size() != static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows)) {
    throw UserError("surface: expected as many heights as columns × rows");
  }
  if (!(grid.dx_nm > 0.0 && grid.dy_nm > 0.0 && std::isfinite(grid.dx_nm) && std::isfinite(grid.dy_nm) &&
        std::isfinite(grid.x_first_nm) && std::isfinite(grid.y_first_nm))) {
    throw UserError("surface: expected finite borders and positive spacing");
  }
  if (!std::all_of(grid.z_nm.begin(), grid.z_nm.end(), [](double z) { return std::isfinite(z); })) {
    throw UserError("surface: expected finite heights");
  }
  return grid;
}

}  // namespace

SplineSurface::SplineSurface(const HeightGrid& grid)
    : cell_(std::max(grid.dx_nm, grid.dy_nm)),
      height_(BicubicSpline::interpolating(checked(grid))),
      heights_(grid.z_nm),
      lowest_(*std::min_element(grid.z_nm.begin(), grid.z_nm.end())),
      highest_(*std::max_element(grid.z_nm.begin(), grid.z_nm.end())),
      view_(std::make_shared<surface::HeightView>(grid)) {}

SplineSurface::SplineSurface(const SplineSurface& other)
    : Surface(other),
      cell_(other.cell_),
      height_(other.height_),
      heights_(other.heights_),
      lowest_(other.lowest_),
      highest_(other.highest_),
      marked_(other.marked_),
      view_(std::make_shared<surface::HeightView>(other.heights())) {}

void SplineSurface::store(int column, int row, double z_nm) noexcept {
  heights_[index(column, row)] = z_nm;
  lowest_ = std::min(lowest_, z_nm);
  highest_ = std::max(highest_, z_nm);
  view_->store(column, row, z_nm);
}

void SplineSurface::store_row(int column, int row, int count, const double* z_nm) noexcept {
  // The extremes apart, in registers: between stores into the view each would wait for the one before in memory.
  double low = lowest_, high = highest_;
  for (int i = 0; i < count; ++i) {
    low = std::min(low, z_nm[i]);
    high = std::max(high, z_nm[i]);
  }
  lowest_ = low;
  highest_ = high;
  std::copy_n(z_nm, count, heights_.begin() + static_cast<std::ptrdiff_t>(index(column, row)));
  for (int i = 0; i < count; ++i) view_->store(column + i, row, z_nm[i]);
}

void SplineSurface::set_node(int column, int row, const Node& node) noexcept {
  height_.set_coefficient(column, row, node.height_coefficient_nm);
  store(column, row, node.height_nm);
}

void SplineSurface::settle(bool marked) noexcept {
  marked_ = marked;
  view_->publish();
}

HeightGrid SplineSurface::heights() const {
  return {height_.columns(),    height_.rows(),       height_.dx_nm(), height_.dy_nm(),
          height_.x_first_nm(), height_.y_first_nm(), heights_};
}

}  // namespace telenano::physics
