#include "tests/studies/precision/analytic_surface.h"

#include <algorithm>
#include <vector>

namespace telenano::studies {

double dense_distance(const AnalyticSurface& surface, const Vec3& centre, double reach_nm, double step_nm) {
  const auto squared = [&](double x, double y) {
    const double ex = x - centre.x(), ey = y - centre.y(), ez = surface.height_nm(x, y) - centre.z();
    return ex * ex + ey * ey + ez * ez;
  };
  const int n = static_cast<int>(std::ceil(2 * reach_nm / step_nm)) + 1;
  std::vector<double> grid(static_cast<std::size_t>(n) * static_cast<std::size_t>(n));
  const auto x_of = [&](int i) { return centre.x() - reach_nm + i * step_nm; };
  const auto y_of = [&](int i) { return centre.y() - reach_nm + i * step_nm; };
  const auto at = [&](int i, int j) -> double& { return grid[static_cast<std::size_t>(j) * n + i]; };
  double least = HUGE_VAL;
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      at(i, j) = squared(x_of(i), y_of(j));
      least = std::min(least, at(i, j));
    }
  }
  // A minimum lies within half a step of a grid point that is lower than its neighbours; what the grid shows
  // there is too high by less than step^2 (1 + curvature · distance) / 2.
  const double slack = 4 * step_nm * step_nm;
  double best = least;
  for (int j = 1; j + 1 < n; ++j) {
    for (int i = 1; i + 1 < n; ++i) {
      if (at(i, j) > least + slack || at(i, j) > at(i - 1, j) || at(i, j) > at(i + 1, j) ||
          at(i, j) > at(i, j - 1) || at(i, j) > at(i, j + 1))
        continue;
      double x = x_of(i);
      double y = y_of(j);
      double value = at(i, j);
      // A 5 x 5 pattern that moves to its best point, and shrinks when that is its centre.
      for (double h = 0.5 * step_nm; h > 1e-9;) {
        double to_x = x, to_y = y;
        for (int v = -2; v <= 2; ++v) {
          for (int u = -2; u <= 2; ++u) {
            const double trial = squared(x + u * h, y + v * h);
            if (trial < value) {
              value = trial;
              to_x = x + u * h;
              to_y = y + v * h;
            }
          }
        }
        if (to_x == x && to_y == y) h *= 0.4;
        x = to_x;
        y = to_y;
      }
      best = std::min(best, value);
    }
  }
  return std::sqrt(best);
}

}  // namespace telenano::studies
