#include "telenano/nve_server/scene/levelling.h"

#include <algorithm>
#include <vector>

namespace telenano::scene {
namespace {

using physics::HeightGrid;

double& at(HeightGrid& grid, int column, int row) {
  return grid.z_nm[static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) +
                   static_cast<std::size_t>(column)];
}

void subtract_mean(HeightGrid& grid) {
  // Twice: the second time takes the rounding of the first, which matters for heights far from 0.
  for (int pass = 0; pass < 2; ++pass) {
    double sum = 0.0;
    for (const double z : grid.z_nm) sum += z;
    const double mean = sum / static_cast<double>(grid.z_nm.size());
    for (double& z : grid.z_nm) z -= mean;
  }
}

// Least-squares slopes a column and a row.
struct Tilt {
  double a_column = 0;
  double a_row = 0;
};

Tilt tilt_of(HeightGrid& grid) {
  const double middle_column = 0.5 * (grid.columns - 1);
  const double middle_row = 0.5 * (grid.rows - 1);
  double xz = 0.0, yz = 0.0, xx = 0.0, yy = 0.0;
  for (int row = 0; row < grid.rows; ++row) {
    const double y = row - middle_row;
    for (int column = 0; column < grid.columns; ++column) {
      const double x = column - middle_column;
      const double z = at(grid, column, row);
      xz += x * z;
      yz += y * z;
      xx += x * x;
      yy += y * y;
    }
  }
  return {xz / xx, yz / yy};
}

void subtract(HeightGrid& grid, const Tilt& tilt) {
  const double middle_column = 0.5 * (grid.columns - 1);
  const double middle_row = 0.5 * (grid.rows - 1);
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      at(grid, column, row) -= tilt.a_column * (column - middle_column) + tilt.a_row * (row - middle_row);
    }
  }
}

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 != 0) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

}  // namespace

std::optional<Levelling> levelling_from_name(std::string_view name) noexcept {
  if (name == "none") return Levelling::kNone;
  if (name == "plane") return Levelling::kPlane;
  if (name == "lines") return Levelling::kLines;
  return std::nullopt;
}

void level_plane(HeightGrid& grid) {
  subtract_mean(grid);
  subtract(grid, tilt_of(grid));
}

void level_lines(HeightGrid& grid) {
  std::vector<double> differences(static_cast<std::size_t>(grid.columns));
  for (int row = 1; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      differences[static_cast<std::size_t>(column)] = at(grid, column, row) - at(grid, column, row - 1);
    }
    const double offset = median(differences);
    for (int column = 0; column < grid.columns; ++column) at(grid, column, row) -= offset;
  }
  subtract_mean(grid);
  subtract(grid, {tilt_of(grid).a_column, 0.0});  // a slope across the lines would undo their alignment
}

void level(HeightGrid& grid, Levelling levelling) {
  if (levelling == Levelling::kPlane) level_plane(grid);
  if (levelling == Levelling::kLines) level_lines(grid);
  const double lowest = *std::min_element(grid.z_nm.begin(), grid.z_nm.end());
  for (double& z : grid.z_nm) z -= lowest;
}

}  // namespace telenano::scene
