#pragma once

#include <cmath>

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/surface/height_grid.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"

namespace telenano::studies {

/// Height and derivatives known in closed form: a sum of two waves across each other,
///   z = a [sin(k x + 0.3) cos(0.8 k y) + 0.4 sin(0.6 k x + 1.1 k y)],  k = 2 pi/length.
struct AnalyticSurface {
  double amplitude_nm = 1;
  double length_nm = 100;

  double height_nm(double x, double y) const noexcept {
    const double k = 2 * M_PI / length_nm;
    return amplitude_nm *
           (std::sin(k * x + 0.3) * std::cos(0.8 * k * y) + 0.4 * std::sin(0.6 * k * x + 1.1 * k * y));
  }
  physics::HeightJet jet(double x, double y) const noexcept {
    const double k = 2 * M_PI / length_nm;
    const double sx = std::sin(k * x + 0.3), cx = std::cos(k * x + 0.3);
    const double sy = std::sin(0.8 * k * y), cy = std::cos(0.8 * k * y);
    const double s2 = std::sin(0.6 * k * x + 1.1 * k * y), c2 = std::cos(0.6 * k * x + 1.1 * k * y);
    const double a = amplitude_nm;
    physics::HeightJet j;
    j.z = a * (sx * cy + 0.4 * s2);
    j.zx = a * k * (cx * cy + 0.24 * c2);
    j.zy = a * k * (-0.8 * sx * sy + 0.44 * c2);
    j.zxx = a * k * k * (-sx * cy - 0.144 * s2);
    j.zxy = a * k * k * (-0.8 * cx * sy - 0.264 * s2);
    j.zyy = a * k * k * (-0.64 * sx * cy - 0.484 * s2);
    return j;
  }
  /// Sampled over a square around the origin.
  physics::HeightGrid grid(double side_nm, double spacing_nm) const {
    physics::HeightGrid grid;
    const int n = static_cast<int>(std::lround(side_nm / spacing_nm)) + 1;
    grid.columns = grid.rows = n;
    grid.dx_nm = grid.dy_nm = spacing_nm;
    grid.x_first_nm = grid.y_first_nm = -0.5 * spacing_nm * (n - 1);
    for (int row = 0; row < n; ++row) {
      for (int column = 0; column < n; ++column) {
        grid.z_nm.push_back(
            height_nm(grid.x_first_nm + column * spacing_nm, grid.y_first_nm + row * spacing_nm));
      }
    }
    return grid;
  }
};

}  // namespace telenano::studies
