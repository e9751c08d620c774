#include "telenano/nve_server/physics/equilibrium/tip_equilibrium.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "telenano/nve_server/physics/surface/flat_surface.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"

namespace telenano::physics {
namespace {

constexpr double kRadius = 20;

TipSampleLaw silicon_oxide() {
  return TipSampleLaw({70.0329, 0.4, 0.165, true});
}

std::shared_ptr<const Surface> sampled(int n, double spacing,
                                       const std::function<double(double, double)>& height) {
  HeightGrid grid{n, n, spacing, spacing, 0, 0, {}};
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) grid.z_nm.push_back(height(column * spacing, row * spacing));
  }
  return std::make_shared<SplineSurface>(grid, kRadius);
}

// A balance, from its definition: springs and contact pull alike, and the force is the law's at that overlap.
TEST(TipEquilibrium, BalancesOnACorrugation) {
  const auto surface =
      sampled(121, 1.0, [](double x, double y) { return 2 * std::sin(0.2 * x) + 1.5 * std::cos(0.17 * y); });
  const TipEquilibrium equilibrium(surface, silicon_oxide(), kRadius);
  const Compliance c = Vec3(0.05, 0.05, 0.075).asDiagonal();
  TipState state;
  int touched = 0;
  for (int i = 0; i < 4000; ++i) {
    const double t = i * 1e-3;
    const Vec3 end(40 + 8 * t, 60 + 3 * t, 8 - 4 * t);
    const TipSolution s = equilibrium.advance(end, c, state);
    ASSERT_EQ(s.status, SolveStatus::kOk) << i;
    EXPECT_LT((s.apex_w_nm - end - c * s.force_w_nn).norm(), 1e-12);
    EXPECT_LT((s.force_w_nn - s.normal_force_nn * s.normal_w).norm(), 1e-12);  // all of it is the law's
    // The foot seen afresh from the apex: overlap to the step's tolerance (2e-8 nm, second order in it for
    // the normal).
    FootMemory memory;
    const SurfaceContact contact =
        surface->nearest(s.apex_w_nm + Vec3(0, 0, kRadius), Search::kGlobal, memory);
    EXPECT_NEAR(kRadius - contact.distance_nm, s.overlap_nm, 1e-7) << i;
    if (s.feet == 1) {
      EXPECT_LT((contact.normal_w - s.normal_w).norm(), 1e-6) << i;
      if (s.branch == Branch::kContact) ++touched;
    }
  }
  EXPECT_GT(touched, 500);
}

// The same balance by another way: on a plane of any tilt the problem is the flat one along the normal with
// the compliance nᵀCn, and the force is that of the law.
TEST(TipEquilibrium, TiltedPlaneIsTheFlatProblemAlongItsNormal) {
  const auto surface = sampled(161, 1.0, [](double x, double y) { return 0.25 * x + 0.1 * y; });
  const TipSampleLaw law = silicon_oxide();
  const TipEquilibrium equilibrium(surface, law, kRadius);
  const Vec3 n = Vec3(-0.25, -0.1, 1).normalized();
  const Compliance c = Vec3(0.05, 0.05, 0.075).asDiagonal();
  TipState state;
  TipSampleState flat_state;
  for (double depth = -6; depth < 2; depth += 0.01) {
    const Vec3 end =
        Vec3(80, 80, 28) + Vec3(0, 0, kRadius) / n.z() * 1.0 - Vec3(0, 0, kRadius) - depth * Vec3(0, 0, 1);
    const TipSolution s = equilibrium.advance(end, c, state);
    const double base = kRadius - n.dot(end + Vec3(0, 0, kRadius) - Vec3(80, 80, 28));
    const Equilibrium flat = law.advance(base, n.dot(c * n), kRadius, flat_state);
    ASSERT_EQ(s.status, SolveStatus::kOk);
    // The law's 1e-9 of some 100 nN, twice.
    EXPECT_NEAR(s.normal_force_nn, flat.force_nn, 4e-7) << depth;
    EXPECT_NEAR(s.overlap_nm, flat.overlap_nm, 1e-7) << depth;
    EXPECT_EQ(s.branch, flat.branch) << depth;
  }
}

// A groove narrower than the tip: pressed straight down by symmetry, it leans on both flanks, sideways forces
// cancel.
TEST(TipEquilibrium, LeansOnBothFlanksOfAGroove) {
  const auto surface =
      sampled(161, 1.0, [](double x, double) { return 10 * (1 - 1 / (1 + (x - 80) * (x - 80) / 36)); });
  const TipEquilibrium equilibrium(surface, silicon_oxide(), kRadius);
  const Compliance c = Vec3(0.05, 0.05, 0.075).asDiagonal();
  TipState state;
  const double touch = equilibrium.touch_height_nm(80, 80);
  EXPECT_GT(touch, 0.5);  // does not reach the bottom
  TipSolution s;
  for (double z = touch + 5; z > touch - 10; z -= 0.05) {
    // Not quite in the middle: the springs pull it aside, the flanks hold.
    s = equilibrium.advance(Vec3(80.2, 80, z), c, state);
    ASSERT_EQ(s.status, SolveStatus::kOk) << z;
  }
  EXPECT_EQ(s.feet, 2);
  EXPECT_GT(s.force_w_nn.z(), 50.0);
  EXPECT_LT(std::abs(s.apex_w_nm.x() - 80), 0.2);
  EXPECT_LT(s.normal_w.norm(), 0.999);
}

// −∂U/∂R at constant overlap against central differences of the potential that the law itself gives at two
// radii, on every branch; Richardson's extrapolation of two steps.
TEST(TipEquilibrium, RadiusForceIsTheSlopeOfThePotential) {
  for (const bool vdw : {true, false}) {
    for (const double modulus : {0.002, 2.6, 14.5, 70.0329}) {
      const TipSampleLaw law({modulus, 0.1, 0.165, vdw});
      const double reach = law.scales(kRadius).overlap_nm;
      int inside = 0;
      for (double overlap = vdw ? -3.0 : -law.scales(kRadius).overlap_nm; overlap < 5 * reach;
           overlap += 0.05 * reach + 0.02) {
        for (const bool in : {false, true}) {
          const auto at = [&](double radius, TipSampleState& state) {
            if (in) law.advance(10 * reach, 0, radius, state);
            return law.advance(overlap, 0, radius, state);
          };
          TipSampleState state;
          const Equilibrium eq = at(kRadius, state);
          const double h = 1e-3 * kRadius;
          double slope[2];
          bool same = true;
          for (int half = 0; half < 2; ++half) {
            TipSampleState up, down;
            const double step = half == 0 ? h : 0.5 * h;
            const Equilibrium more = at(kRadius + step, up), less = at(kRadius - step, down);
            slope[half] = (more.potential_aj - less.potential_aj) / (2 * step);
            same = same && more.branch == eq.branch && less.branch == eq.branch;
          }
          if (!same || eq.branch == Branch::kFree) continue;
          if (eq.branch == Branch::kContact) ++inside;
          const double expected = -(4 * slope[1] - slope[0]) / 3;
          // h⁴ of the relative step, 1e-12, and 1e-13 of the energies over h.
          const double tolerance = 1e-9 * (std::abs(expected) + std::abs(eq.potential_aj) / kRadius);
          EXPECT_NEAR(law.radius_force_nn(eq, state), expected, tolerance)
              << vdw << ' ' << modulus << ' ' << overlap << ' ' << in;
        }
      }
      EXPECT_GT(inside, 30);
    }
  }
  // Deep contact is Hertz: F a²/(5 R²).
  const TipSampleLaw hard({70.0329, 1e-6, 0.165, false});
  TipSampleState state;
  const Equilibrium eq = hard.advance(1.0, 0, kRadius, state);
  const double hertz = eq.force_nn * eq.contact_radius_nm * eq.contact_radius_nm / (5 * kRadius * kRadius);
  EXPECT_NEAR(hard.radius_force_nn(eq, state), -hertz, 1e-4 * hertz);  // w of 1e-6 is not quite none
}

TEST(TipEquilibrium, NonFiniteEndIsRefusedAndChangesNothing) {
  const TipEquilibrium equilibrium(std::make_shared<FlatSurface>(kRadius), silicon_oxide(), kRadius);
  TipState state;
  equilibrium.advance(Vec3(0, 0, 1), Compliance(Vec3(0, 0, 0.1).asDiagonal()), state);
  const Vec3 before = state.apex_w_nm;
  EXPECT_EQ(equilibrium.advance(Vec3(0, NAN, 0), Compliance(Vec3(0, 0, 0.1).asDiagonal()), state).status,
            SolveStatus::kNonFinite);
  EXPECT_EQ(state.apex_w_nm, before);
}

TEST(TipEquilibrium, TouchHeightIsWhereTheSphereFirstTouches) {
  const TipEquilibrium flat(std::make_shared<FlatSurface>(kRadius), silicon_oxide(), kRadius);
  EXPECT_NEAR(flat.touch_height_nm(3, 4), 0.0, 1e-9);
  const auto surface = sampled(161, 1.0, [](double x, double) { return 0.5 * x; });
  const TipEquilibrium tilted(surface, silicon_oxide(), kRadius);
  // Sphere on a plane of slope s: the apex is R(√(1 + s²) − 1) above the plane.
  EXPECT_NEAR(tilted.touch_height_nm(80, 80), 40 + kRadius * (std::sqrt(1.25) - 1), 1e-8);
}

}  // namespace
}  // namespace telenano::physics
