#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace telenano::physics {

/// Where a mark lies on grids that share their nodes, and which padded coefficients are near.
struct MarkPlace {
  int columns, rows;  ///< of nodes
  double inv_dx, inv_dy, dx, dy;
  double x, y;
  double radius, per_radius;  ///< of the crater on this grid
  int column, row;            ///< of the first of the 16 coefficients that reach the mark

  /// Of the crater, at a coefficient: distance from the mark over the radius.
  double xi_of(int i) const noexcept { return (place_of(i, columns, dx) - x) * per_radius; }
  double eta_of(int j) const noexcept { return (place_of(j, rows, dy) - y) * per_radius; }

  int first_column(double from) const noexcept { return first_of(from, inv_dx, column); }
  int last_column(double to) const noexcept { return last_of(to, inv_dx, columns, column); }
  int first_row(double from) const noexcept { return first_of(from, inv_dy, row); }
  int last_row(double to) const noexcept { return last_of(to, inv_dy, rows, row); }

  std::size_t number_of(int i, int j) const noexcept {
    return static_cast<std::size_t>(j * (columns + 2) + i);
  }
  bool row_reaches(int j) const noexcept { return j >= row && j <= row + 3; }
  bool reaches(int i, int j) const noexcept { return row_reaches(j) && i >= column && i <= column + 3; }
  /// False: a mirrored one, which is not counted twice.
  bool inside(int i, int j) const noexcept { return j > 0 && j <= rows && i > 0 && i <= columns; }

  /// The rows and columns that may be within a circle of `extent` radii, in order: use(row, η, first column, last
  /// column).
  template <class Use>
  void each_within(double extent, const Use& use) const {
    const double far = extent * radius;
    const int low = first_row(y - far), high = last_row(y + far);
    for (int j = low; j <= high; ++j) {
      const double eta = eta_of(j);
      const double rest = extent * extent - eta * eta;
      if (!(rest > 0.0)) continue;
      const double half = std::sqrt(rest) * radius;
      const int left = first_of(x - half, inv_dx, columns + 1);
      const int right = last_of(x + half, inv_dx, columns, 0);
      use(j, eta, left, right);
    }
  }

 private:
  /// Place of a padded coefficient, mirrored ones at their image.
  static double place_of(int padded, int nodes, double spacing) noexcept {
    const int i = padded - 1;
    return spacing * (i < 0 ? -i : (i < nodes ? i : 2 * nodes - 2 - i));
  }
  static int first_of(double from, double inv, int cell) noexcept {
    return std::max(0, std::min(static_cast<int>(std::floor(std::max(0.0, from) * inv)), cell));
  }
  static int last_of(double to, double inv, int nodes, int cell) noexcept {
    const double at = std::min(to * inv, nodes + 1.0);
    return std::min(nodes + 1, std::max(static_cast<int>(std::ceil(at)) + 2, cell + 3));
  }
};

}  // namespace telenano::physics
