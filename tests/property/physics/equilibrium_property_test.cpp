#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "common/base/constants.h"
#include "nve_server/physics/spline_surface.h"
#include "nve_server/physics/tip_equilibrium.h"

namespace telenano::physics {
namespace {

double log_uniform(std::mt19937_64& random, double low, double high) {
  return low * std::exp(std::uniform_real_distribution<double>(0, std::log(high / low))(random));
}

// Ground of one of five kinds, in units of the tip's radius: waves of all lengths with the amplitudes of a
// rough scan, grooves and pits narrower than the tip, steps, sharp grains.
HeightGrid ground(std::mt19937_64& random, double radius, int kind) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  constexpr int kSamples = 96;
  const double spacing = radius * log_uniform(random, 0.04, 0.4);
  HeightGrid grid{kSamples, kSamples, spacing, spacing, 0, 0, {}};
  const double width = radius * log_uniform(random, 0.15, 2), depth = radius * log_uniform(random, 0.05, 1);
  struct Wave {
    double kx, ky, phase, height;
  };
  std::vector<Wave> waves;
  for (int i = 0; i < 24; ++i) {
    const double length = spacing * log_uniform(random, 2.5, 60);
    const double angle = kPi * uniform(random);
    waves.push_back({2 * kPi / length * std::cos(angle), 2 * kPi / length * std::sin(angle),
                     kPi * uniform(random), 0.01 * length * uniform(random)});
  }
  for (int row = 0; row < kSamples; ++row) {
    for (int column = 0; column < kSamples; ++column) {
      const double x = column * spacing, y = row * spacing;
      double z = 0;
      for (const Wave& w : waves) z += w.height * std::cos(w.kx * x + w.ky * y + w.phase);
      const double u = std::remainder(x + 0.2 * y, 4 * width) / width;
      const double v = std::remainder(y - 0.3 * x, 4 * width) / width;
      if (kind == 1) z -= depth / (1 + 4 * u * u);
      if (kind == 2) z -= depth / ((1 + 4 * u * u) * (1 + 4 * v * v));
      if (kind == 3) z += depth * std::tanh(4 * u);
      if (kind == 4) z += depth * std::exp(-4 * (u * u + v * v));
      grid.z_nm.push_back(z);
    }
  }
  return grid;
}

// Whatever the tip, the ground, the springs and the step: a balance is found, finite, and where it is not (at
// most once in ten thousand steps) the state is left as it was.
TEST(EquilibriumProperty, FindsABalanceAnywhere) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> normal;
  int steps = 0, failed = 0, pressed = 0, corners = 0, slid = 0;
  double iterations = 0;
  int most = 0;
  for (int world = 0; world < 150; ++world) {
    const double radius = log_uniform(random, 1, 1e4);
    const HeightGrid grid = ground(random, radius, world % 5);
    const auto surface = std::make_shared<SplineSurface>(grid, radius);
    TipSampleParameters material;
    material.contact_modulus_gpa = log_uniform(random, 1e-3, 1e3) * 4 / 3;
    // Overlaps beyond half the radius, where adhesion alone sinks the tip in, have no half-space theory.
    const double stickiest = 0.05 * material.contact_modulus_gpa * radius;
    material.work_of_adhesion_n_m = std::min(log_uniform(random, 1e-3, 1), stickiest);
    const TipEquilibrium equilibrium(surface, TipSampleLaw(material), radius);
    const double coupling = log_uniform(random, 1e-3, 1e6);
    const double probe = log_uniform(random, 1e-2, 1e3);
    const Compliance c = Mat3::Identity() / coupling + Mat3(Vec3(0, 0, 1 / probe).asDiagonal());
    // Pressed by what dents the sample by some hundredth of the radius, in a spring of this compliance.
    const double dent = radius * log_uniform(random, 1e-4, 0.05);
    const double load = material.contact_modulus_gpa * std::sqrt(radius * dent) * dent;
    const double deepest = std::min(2000.0, dent + c(2, 2) * load);
    const double side = 95 * grid.dx_nm;
    Vec3 end(0.5 * side, 0.5 * side, surface->highest_nm() + radius);
    TipState state;
    for (int step = 0; step < 300; ++step) {
      Vec3 move(normal(random), normal(random), 0.3 * normal(random));
      move *= log_uniform(random, 0.1, step % 10 == 0 ? 1000 : 20) / move.norm();
      end += move;
      end.x() = std::clamp(end.x(), 0.2 * side, 0.8 * side);
      end.y() = std::clamp(end.y(), 0.2 * side, 0.8 * side);
      const double ground_z = surface->height_nm(end.x(), end.y());
      end.z() = std::clamp(end.z(), ground_z - deepest, ground_z + 2 * dent + 5);
      const TipState before = state;
      const TipSolution s = equilibrium.advance(end, c, state);
      ++steps;
      if (s.status != SolveStatus::kOk) {
        ++failed;
        EXPECT_EQ(state.apex_w_nm, before.apex_w_nm);
        EXPECT_EQ(state.foot_count, before.foot_count);
        if (getenv("EQ_VERBOSE"))
          printf("fail world %d kind %d step %d R %g K %g w %g coupling %g probe %g move %g status %d\n", world, world % 5, step, radius,
                 material.contact_modulus_gpa, material.work_of_adhesion_n_m, coupling, probe, move.norm(), int(s.status));
        continue;
      }
      ASSERT_TRUE(is_finite(s.apex_w_nm) && is_finite(s.force_w_nn) && std::isfinite(s.potential_aj));
      EXPECT_LT((s.apex_w_nm - end - c * s.force_w_nn).norm(), 1e-9 * (1 + (end - s.apex_w_nm).norm()));
      iterations += s.iterations;
      most = std::max(most, s.iterations);
      if (s.normal_force_nn > 0) ++pressed;
      if (s.feet > 1) ++corners;
      if (s.slid) ++slid;
    }
  }
  printf("steps %d failed %d pressed %d corners %d slid %d iterations mean %.2f max %d\n", steps, failed, pressed, corners, slid,
         iterations / steps, most);
  EXPECT_LE(failed, steps / 10000);
  EXPECT_GT(pressed, steps / 4);
  EXPECT_GT(corners, steps / 100);
}

}  // namespace
}  // namespace telenano::physics
