#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "telenano/common/base/constants.h"
#include "telenano/nve_server/physics/equilibrium/level_equilibrium.h"

namespace telenano::physics {
namespace {

double log_uniform(std::mt19937_64& random, double low, double high) {
  return low * std::exp(std::uniform_real_distribution<double>(0, std::log(high / low))(random));
}

// A lever that gives in all directions, tilted: bending and lateral bending coupled, positive definite.
Compliance tilted(std::mt19937_64& random, double most_coupled) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  const Vec3 own(log_uniform(random, 1e-3, 1), log_uniform(random, 1e-3, 1), log_uniform(random, 1e-3, 10));
  Compliance c = own.asDiagonal();
  for (int i = 0; i < 2; ++i) {
    c(i, 2) = c(2, i) = 0.7 * most_coupled * uniform(random) * std::sqrt(own[i] * own.z());
  }
  return c;
}

struct Found {
  int steps = 0;
  int pressed = 0;
  int slid = 0;
  int jumped = 0;
  int failed = 0;
  int most_iterations = 0;
};

// Whatever the sample, the springs and the step: a balance by its definition. The friction is the one that
// this motion makes of the bristle with the contact found (where it has not broken away in this step), the
// normal force the law's at the overlap found, the apex where the springs put it.
Found search_everywhere(double most_coupled) {
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  Found found;
  for (int world = 0; world < 300; ++world) {
    const double radius = log_uniform(random, 1, 1e3);
    TipSampleParameters material;
    material.contact_modulus_gpa = log_uniform(random, 1e-2, 1e3);
    material.work_of_adhesion_n_m =
        std::min(log_uniform(random, 1e-3, 1), 0.05 * material.contact_modulus_gpa * radius);
    material.van_der_waals = world % 3 == 0;
    const bool breaks_away = world % 4 == 0;
    const Friction friction({0.01 * material.contact_modulus_gpa, 0.2 * material.contact_modulus_gpa,
                             world % 5 == 0 ? 0.2 : 0.0, breaks_away ? 0.7 : 1.0});
    const auto law = std::make_shared<TipSampleLaw>(material);
    const LevelEquilibrium equilibrium(law, radius, friction.parameters());
    const Compliance c = tilted(random, most_coupled);
    const double dent = radius * log_uniform(random, 1e-4, 0.05);
    const double load = material.contact_modulus_gpa * std::sqrt(radius * dent) * dent;
    const double deepest = std::min(2000.0, dent + c(2, 2) * load);
    Vec3 end(0, 0, dent + 2);
    LevelState state;
    for (int step = 0; step < 300; ++step) {
      Vec3 move(normal(random), normal(random), 0.3 * normal(random));
      move *= log_uniform(random, 0.01, step % 10 == 0 ? 100 : 5) / move.norm();
      end += move;
      end.z() = std::clamp(end.z(), -deepest, dent + 2);
      const LevelState before = state;
      const TipSolution s = equilibrium.advance(end, c, state);
      ++found.steps;
      if (s.status != SolveStatus::kOk) {
        ++found.failed;
        EXPECT_EQ(state.apex_w_nm, before.apex_w_nm);
        continue;
      }
      found.most_iterations = std::max(found.most_iterations, s.iterations);
      found.pressed += s.normal_force_nn > 0;
      found.slid += s.sliding;
      found.jumped += s.jumps > 0;
      EXPECT_GE(s.friction_dissipated_aj, 0);
      EXPECT_GE(s.dissipated_aj, 0);
      const double length = 1 + end.norm() + (c * s.force_w_nn).norm();
      EXPECT_LT((s.apex_w_nm - end - c * s.force_w_nn).norm(), 1e-12 * length);
      EXPECT_NEAR(s.overlap_nm, -s.apex_w_nm.z(), 1e-7 * length) << world << ' ' << step;
      const double limit = friction.limit_nn(s.contact_radius_nm, s.normal_force_nn);
      EXPECT_LE(s.friction_w_nn.norm(), limit * (1 + 1e-8) + 1e-12);
      if (!breaks_away) {
        const FrictionStep again =
            friction.move(before.friction, Vec3::UnitZ(), s.apex_w_nm - before.apex_w_nm, s.contact_radius_nm,
                          s.normal_force_nn, false);
        // 1e-9 nm of the balance, on the bristle.
        const double slack = 1e-8 * friction.stiffness_n_m(s.contact_radius_nm) * length + 1e-9 * limit;
        EXPECT_LE((again.force_w_nn - s.friction_w_nn).norm(), slack) << world << ' ' << step;
      }
    }
  }
  EXPECT_GT(found.pressed, found.steps / 8);
  EXPECT_GT(found.slid, found.steps / 50);
  EXPECT_GT(found.jumped, found.steps / 1000);
  return found;
}

TEST(LevelEquilibriumProperty, EveryStepEndsInABalance) {
  const Found found = search_everywhere(0);
  EXPECT_EQ(found.failed, 0);
  EXPECT_EQ(found.most_iterations, 1 + 1);  // again where it breaks away
}

TEST(LevelEquilibriumProperty, EveryStepEndsInABalanceOnATiltedLever) {
  const Found found = search_everywhere(1);
  EXPECT_EQ(found.failed, 0);
}

// Any path on a tilted lever: the work of the free end is stored or lost, to the path's own discretisation,
// which falls with the step (sixteen times shorter: 16 at first order; breakaways fall anywhere).
TEST(LevelEquilibriumProperty, WorkIsStoredOrLost) {
  std::mt19937_64 random(12);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto law = std::make_shared<TipSampleLaw>(TipSampleParameters{20.0, 0.4, 0.165, true});
  for (int path = 0; path < 8; ++path) {
    const Compliance c = tilted(random, path % 2 == 0 ? 0 : 1);
    const double deep = path % 4 < 2 ? 6 : 12;  // the latter in and out of contact
    double phase[4];
    for (double& p : phase) p = kPi * uniform(random);
    const LevelEquilibrium equilibrium(law, 20, FrictionParameters{0.2, 8.0, 0.1, 1.0});
    double error[2] = {0, 0};
    for (const int fine : {0, 1}) {
      const int steps = fine == 0 ? 3000 : 48000;
      const auto at = [&](double t) {
        return Vec3(8 * std::sin(t + phase[0]) + 3 * std::sin(2 * t + phase[1]), 6 * std::cos(t + phase[2]),
                    deep * std::sin(t + phase[3]) - 4);
      };
      LevelState state;
      for (double z = 20; z > 0; z -= 0.1) equilibrium.advance(at(0) + Vec3(0, 0, z), c, state);
      Vec3 last = at(0);
      TipSolution s = equilibrium.advance(last, c, state);
      const auto stored = [&] {
        return s.potential_aj + s.friction_stored_aj + 0.5 * s.force_w_nn.dot(c * s.force_w_nn);
      };
      const double before = stored();
      double work = 0, lost = 0, size = 0;
      for (int i = 1; i <= steps; ++i) {
        const Vec3 force = s.force_w_nn, to = at(2.2 * kPi * i / steps);
        const double held = stored();
        s = equilibrium.advance(to, c, state);
        ASSERT_EQ(s.status, SolveStatus::kOk);
        // A jump's own step is by energy: the trapezium of a force that jumps says nothing.
        const double given = stored() - held + s.dissipated_aj + s.friction_dissipated_aj;
        const double part = s.jumps > 0 ? given : -0.5 * (force + s.force_w_nn).dot(to - last);
        work += part;
        size += std::abs(part);
        lost += s.dissipated_aj + s.friction_dissipated_aj;
        last = to;
      }
      error[fine] = std::abs(work - lost - (stored() - before)) / size;
    }
    EXPECT_LT(error[0], 2e-2) << path;
    EXPECT_LT(error[1], 1e-6 + error[0] / 5) << path;
  }
}

// Without friction it is the law, bit for bit.
TEST(LevelEquilibriumProperty, WithoutFrictionItIsTheLaw) {
  std::mt19937_64 random(13);
  std::normal_distribution<double> normal;
  const auto law = std::make_shared<TipSampleLaw>(TipSampleParameters{70.0, 0.4, 0.165, true});
  const LevelEquilibrium equilibrium(law, 20);
  const Compliance c = tilted(random, 1);
  LevelState state;
  TipSampleState alone;
  Vec3 end(0, 0, 5);
  for (int i = 0; i < 2000; ++i) {
    end += Vec3(normal(random), normal(random), 0.3 * normal(random) - 0.02 * (end.z() + 1));
    const TipSolution s = equilibrium.advance(end, c, state);
    const Equilibrium eq = law->advance(-end.z(), c(2, 2), 20, alone);
    ASSERT_EQ(s.status, SolveStatus::kOk);
    EXPECT_EQ(s.force_w_nn, Vec3(0, 0, eq.force_nn));
    EXPECT_EQ(s.potential_aj, eq.potential_aj);
    EXPECT_EQ(s.apex_w_nm, Vec3(end + c.col(2) * eq.force_nn));
  }
  const LevelState before = state;
  EXPECT_EQ(equilibrium.advance(Vec3(0, 0, NAN), c, state).status, SolveStatus::kNonFinite);
  EXPECT_EQ(state.apex_w_nm, before.apex_w_nm);
  const LevelEquilibrium rubs(law, 20, FrictionParameters{0.2, 8.0, 0.0, 1.0});
  EXPECT_EQ(rubs.advance(Vec3(0, NAN, 0), c, state).status, SolveStatus::kNonFinite);
  EXPECT_EQ(state.apex_w_nm, before.apex_w_nm);
}

}  // namespace
}  // namespace telenano::physics
