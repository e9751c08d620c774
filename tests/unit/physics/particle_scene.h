#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>

#include "telenano/nve_server/physics/particle/particle_equilibrium.h"
#include "telenano/nve_server/physics/surface/flat_surface.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"
#include "tests/support/contact_paths.h"
#include "tests/support/particle_grounds.h"

/// A tip and a particle on the ground, as the tests of a particle have them.
namespace telenano::physics {

inline constexpr double kTip = 15;
inline constexpr double kParticle = 20;
// Maugis–Dugdale at lambda = 1 with 50 digits, without dimensions: at zero load, and under load control.
inline constexpr double kRestRadius = 1.636090490;
inline constexpr double kRestOverlap = 1.129893891;
inline constexpr double kPullOff = 1.600734911;
inline constexpr double kDigits = 3e-9;  // of those numbers

// lambda = 1 between particle and sample; no attraction beyond the Dugdale range, so that a tip far off is
// not felt; the tip neither sticks (much) nor rubs.
inline ParticleParameters plain() {
  ParticleParameters p;
  p.tip_radius_nm = kTip;
  p.particle_radius_nm = kParticle;
  p.particle_sample = telenano::testing::material_of(1.0, false);
  p.tip_particle = p.particle_sample;
  p.tip_particle.work_of_adhesion_n_m = 1e-3;
  p.tip_sample = p.tip_particle;
  p.drag_n_s_m = 1e-12;
  return p;
}

inline ParticleEquilibrium on_level(const ParticleParameters& p) {
  return {std::make_shared<FlatSurface>(), p, support::level_ground(p)};
}

inline HeightGrid sampled(int n, double spacing, const std::function<double(double, double)>& height) {
  HeightGrid grid{n, n, spacing, spacing, 0, 0, {}};
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) grid.z_nm.push_back(height(column * spacing, row * spacing));
  }
  return grid;
}

inline ParticleEquilibrium on(const HeightGrid& grid, const ParticleParameters& p) {
  return {std::make_shared<SplineSurface>(grid), p, support::ground_on(grid, p)};
}

inline const Compliance kSprings = Vec3(0.05, 0.05, 0.075).asDiagonal();

// Pushes along x at the height of the particle's centre, from just free, and gives back the last step.
struct Push {
  ParticleEquilibrium scene;
  ParticleState state;
  double height_nm;
  double x_nm;

  explicit Push(const ParticleParameters& p)
      : scene(on_level(p)),
        state(scene.place(0, 0)),
        height_nm(state.particle_centre_w_nm.z() - p.tip_radius_nm),
        x_nm(-p.tip_radius_nm - p.particle_radius_nm - 1.0) {}

  ParticleSolution to(double x, double step) {
    ParticleSolution s;
    const int steps = std::max(1, static_cast<int>(std::ceil((x - x_nm) / step)));
    const double from = x_nm;
    for (int i = 1; i <= steps; ++i) {
      x_nm = from + (x - from) * i / steps;
      s = scene.advance(Vec3(x_nm, 0, height_nm), kSprings, 1e-3, state);
      EXPECT_EQ(s.status, SolveStatus::kOk) << x_nm;
    }
    return s;
  }
};

}  // namespace telenano::physics
