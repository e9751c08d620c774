#pragma once

#include <cstdint>
#include <vector>

#include "telenano/common/base/vec3.h"

namespace telenano::view_model {

/// Triangles with a normal at each corner, counter-clockwise from outside.
struct Mesh {
  struct Corner {
    float pos[3];
    float normal[3];
  };
  std::vector<Corner> corners;
  std::vector<std::uint32_t> triangles;  ///< three indices each
};

/// Radius 1 about the origin.
Mesh unit_sphere(int rings, int sectors);
/// Its part with y ≥ 0, open.
Mesh half_sphere(int rings, int sectors);
/// From a disc of radius 1 at z = 0 to a point at z = 1.
Mesh unit_cone(int sectors);
/// A cone cut off: radius `bottom` at z = 0, `top` at z = 1, open at both ends.
Mesh frustum(double bottom_radius, double top_radius, int sectors);

/// A lever clamped at one end with a force at the other bends as δ (3s² − s³)/2, s = 0 at the clamp, 1 at the
/// tip [Euler-Bernoulli, end load]. Height above the undeflected lever for an end deflection of 1.
constexpr double lever_bend(double s) noexcept {
  return 0.5 * s * s * (3 - s);
}

/// A flat lever seen from its tip's end: along `length` in +y from the tip at the origin to the clamp,
/// `width` across x, `thickness` down z, bent so that the clamp stays where it would be without deflection
/// and the tip's end rises by `deflection` (the origin is the bent tip's end).
Mesh bent_lever(double length, double width, double thickness, double deflection, int segments);

}  // namespace telenano::view_model
