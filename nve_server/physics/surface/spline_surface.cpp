#include "telenano/nve_server/physics/surface/spline_surface.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/surface/relative_curvature.h"

namespace telenano::physics {
namespace {

const HeightGrid& checked(const HeightGrid& grid, double tip_radius_nm) {
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
  if (!(tip_radius_nm > 0.0 && std::isfinite(tip_radius_nm))) {
    throw UserError("surface: expected a positive tip radius");
  }
  return grid;
}

BicubicSpline relative_curvature_of(const BicubicSpline& height, const HeightGrid& grid,
                                    double tip_radius_nm) {
  HeightGrid g = grid;
  std::size_t i = 0;
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      const HeightJet jet =
          height.jet(grid.x_first_nm + column * grid.dx_nm, grid.y_first_nm + row * grid.dy_nm);
      g.z_nm[i++] = relative_curvature(tip_radius_nm, principal_curvatures(jet));
    }
  }
  return BicubicSpline::averaging(g);
}

}  // namespace

SplineSurface::SplineSurface(const HeightGrid& grid, double tip_radius_nm)
    : tip_radius_(tip_radius_nm),
      cell_(std::max(grid.dx_nm, grid.dy_nm)),
      height_(BicubicSpline::interpolating(checked(grid, tip_radius_nm))),
      relative_curvature_(relative_curvature_of(height_, grid, tip_radius_nm)),
      origin_(std::make_shared<const BicubicSpline>(relative_curvature_)),
      tops_(grid),
      view_(std::make_shared<HeightView>(grid)) {}

SplineSurface::SplineSurface(const SplineSurface& other)
    : Surface(other),
      tip_radius_(other.tip_radius_),
      cell_(other.cell_),
      height_(other.height_),
      relative_curvature_(other.relative_curvature_),
      origin_(other.origin_),
      marked_(other.marked_),
      tops_(other.tops_),
      view_(std::make_shared<HeightView>(other.heights())),
      stamp_(other.stamp_) {}

void SplineSurface::set_node(int column, int row, const Node& node) noexcept {
  height_.set_coefficient(column, row, node.height_coefficient_nm);
  relative_curvature_.set_coefficient(column, row, node.relative_curvature);
  tops_.set(column, row, node.height_nm);
  view_->store(column, row, node.height_nm);
}

void SplineSurface::settle(bool marked) noexcept {
  marked_ = marked;
  view_->publish();
  if (++stamp_ == 0) stamp_ = 1;
}

HeightGrid SplineSurface::heights() const {
  HeightGrid grid{height_.columns(),
                  height_.rows(),
                  height_.dx_nm(),
                  height_.dy_nm(),
                  height_.x_first_nm(),
                  height_.y_first_nm(),
                  {}};
  grid.z_nm.reserve(static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows));
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) grid.z_nm.push_back(tops_.height_nm(column, row));
  }
  return grid;
}

}  // namespace telenano::physics
