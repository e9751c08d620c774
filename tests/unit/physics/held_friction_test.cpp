// Friction's tangent in Newton's matrix, against differences of the force that it is the tangent of.
#include "telenano/nve_server/physics/equilibrium/held_friction.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include <cmath>
#include <memory>

#include "telenano/nve_server/physics/equilibrium/path_trend.h"
#include "tests/support/potential_paths.h"

namespace telenano::physics {
namespace {

// Sticking and sliding, with and without a part that grows with the load, contact growing and shrinking, on
// ground with slopes to 60°. Central differences over 1e-6 nm of forces near 10 nN leave some 1e-8 of
// rounding and less of truncation: 1e-6 of the tangent. Left out on purpose is what carrying the bristle over
// to the turned normal adds, its extension e times half the turn of the step times ∇n: up to 1e-4 of the
// tangent where the normal turns by a tenth. A normal that turns by the transposed matrix leaves 1e-2, a load
// without the change of |∇δ| as much.
TEST(RubbingTangent, IsTheDerivativeOfTheForce) {
  const TipPotential potential(support::rough_ground(), support::potential_of(support::silicon_oxide()));
  int sliding = 0, sticking = 0;
  for (const double coefficient : {0.0, 0.05}) {
    const Friction friction({0.3, 20.0, coefficient, 1.0});
    for (int k = 0; k < 24; ++k) {
      const double x = 3.3 * k, y = 1.7 * k;
      ContactJet ground;
      potential.fields().contact_at({x, y, 0}, ground);
      // c falls with the slope; deep enough to touch, whatever it is.
      const Vec3 p(x, y, (ground.overlap_nm - 0.8) / -ground.overlap_grad.z());
      const Vec3 moved = (k % 2 == 0 ? 1.0 : 0.02) * Vec3(0.09, 0.03, k % 3 == 0 ? 0.02 : -0.02);
      PotentialBranch inside;
      inside.inside = true;
      const auto at = [&](const Vec3& q) {
        PotentialSample sample;
        CurveHint hint;
        EXPECT_EQ(potential.sample(q, inside, hint, sample), BranchEnd::kNone) << k;
        return rubbed_contact(sample);
      };
      const Vec3 from = p - moved;
      const RubbedContact before = at(from), here = at(p);
      FrictionState bristle;
      bristle.normal_w = before.normal;
      bristle.stiffness_n_m = friction.stiffness_n_m(before.radius);
      const Vec3 across = before.normal.cross(Vec3(0.2, 1.0, 0.1)).normalized();
      bristle.extension_w_nm = (k % 4 < 2 ? 0.2 : 1.0) * friction.limit_nn(before.radius, before.load) /
                               bristle.stiffness_n_m * across;
      const auto move = [&](const Vec3& q) {
        const RubbedContact there = at(q);
        return friction.move(bristle, there.normal, q - from, there.radius, there.load, false);
      };
      const FrictionStep rub = move(p);
      (rub.sliding ? sliding : sticking)++;
      const Mat3 tangent = rubbing_tangent(here, rub, moved);
      constexpr double h = 1e-6;
      for (int i = 0; i < 3; ++i) {
        const Vec3 d = h * Vec3::Unit(i);
        const Vec3 slope = -(move(p + d).force_w_nn - move(p - d).force_w_nn) / (2 * h);
        EXPECT_LE((tangent.col(i) - slope).norm(), 3e-4 * tangent.norm())
            << "place " << k << " axis " << i << (rub.sliding ? " sliding" : " sticking");
        const double load = (at(p + d).load - at(p - d).load) / (2 * h);
        EXPECT_NEAR(here.load_grad[i], load, 1e-6 * (1 + here.load_grad.norm())) << "place " << k;
      }
    }
  }
  EXPECT_GE(sliding, 10);
  EXPECT_GE(sticking, 10);
}

// A path that is a cubic in its free end, x = s e: after one step along it the next is foreseen to rounding;
// after the first step of a parabola's too, by either. p' = dp/dx is given at both ends.
TEST(PathTrend, ACubicIsForeseen) {
  const Vec3 a(0.3, -0.2, 0.1), b(0.05, 0.02, -0.04), c(-0.01, 0.03, 0.02);
  const auto path = [&](double s) { return Vec3(s * a + s * s * b + s * s * s * c); };
  const auto slope = [&](double s) { return Vec3(a + 2 * s * b + 3 * s * s * c); };
  const auto rests = [&](double from, double to, PathTrend& trend, double part) {
    const double h = to - from;
    const Vec3 moved = path(to) - path(from);
    trend.take(h * Vec3::UnitX(), part, moved - h * slope(from), h * slope(to) - moved);
  };
  PathTrend trend;
  EXPECT_EQ(trend.part_of(Vec3::UnitX()), 0.0);
  rests(0.0, 1.0, trend, 0.0);
  rests(1.0, 2.0, trend, trend.part_of(Vec3::UnitX()));
  EXPECT_EQ(trend.order, PathOrder::kCubic);
  for (const double r : {0.3, 1.0, 1.8}) {
    EXPECT_NEAR(trend.part_of(r * Vec3::UnitX()), r, 1e-15);
    EXPECT_LE((path(2.0) + r * slope(2.0) + trend.guess(r) - path(2.0 + r)).norm(), 1e-14) << r;
  }
  EXPECT_EQ(trend.part_of(-Vec3::UnitX()), 0.0);
  EXPECT_EQ(trend.part_of(Vec3(1, 0.3, 0)), 0.0);
  EXPECT_EQ(trend.part_of(Vec3(2.1, 0, 0)), 0.0);
}

// Steps of 0.1 nm over ground that is smooth: nearly each ends with its first evaluation, and rests as near
// to the balance as one that has looked again. The oracle is the Newton step that is left, by the exact
// Hessian.
TEST(Potential, ASmoothStepEndsWithItsFirstEvaluation) {
  const PotentialEquilibrium on(support::gentle_ground(), support::potential_of(support::silicon_oxide()));
  const Compliance c = support::stiff_springs();
  const Mat3 k = c.inverse();
  const support::ClosedPath path(1, -4.0, 0.8);
  const int steps = static_cast<int>(path.length() / 0.1);
  PotentialState state;
  Vec3 rate;
  for (double above = 30.0; above >= 0.0; above -= 0.05) {
    on.advance(path.at(0, &rate) + Vec3(0, 0, above), c, state);
  }
  int evaluations = 0;
  double most = 0;
  for (int i = 1; i <= steps; ++i) {
    const Vec3 x = path.at(static_cast<double>(i) / steps, &rate);
    const TipSolution s = on.advance(x, c, state);
    ASSERT_FALSE(s.under_way);
    evaluations += s.iterations;
    PotentialSample at;
    CurveHint hint;
    ASSERT_EQ(on.tip_potential().sample(s.apex_w_nm, state.branch, hint, at), BranchEnd::kNone);
    const Vec3 left = (k + at.hessian_n_m).inverse() * (k * (s.apex_w_nm - x) + at.gradient_nn);
    most = std::max(most, left.norm());
  }
  std::printf("%.2f evaluations a step, at most %.1e nm from the balance\n",
              static_cast<double>(evaluations) / steps, most);
  EXPECT_LE(evaluations, 1.3 * steps);
  // A rate that has grown since it was seen, by the margin that it is given, leaves 1e-9 nm; ten times that
  // would be seen.
  EXPECT_LE(most, 1e-8);
}

}  // namespace
}  // namespace telenano::physics
