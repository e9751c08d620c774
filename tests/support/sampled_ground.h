#pragma once

#include <random>

#include "telenano/nve_server/physics/surface/height_grid.h"

/// Grounds as samples, for tests of what is made of scans.
namespace telenano::support {

inline double degrees(double d) {
  return d * 3.14159265358979323846 / 180;
}

/// A square of count × count samples of height(x, y), the first at the origin.
template <class Height>
physics::HeightGrid sampled(int count, double spacing, Height height) {
  physics::HeightGrid grid{count, count, spacing, spacing, 0.0, 0.0, {}};
  for (int j = 0; j < count; ++j) {
    for (int i = 0; i < count; ++i) grid.z_nm.push_back(height(i * spacing, j * spacing));
  }
  return grid;
}

/// Samples 2 nm apart, each anywhere from 0 to 3 nm high.
inline physics::HeightGrid random_grid(unsigned seed, int count = 24) {
  std::mt19937 random(seed);
  return sampled(count, 2.0, [&](double, double) { return static_cast<double>(random() % 10000) * 3e-4; });
}

}  // namespace telenano::support
