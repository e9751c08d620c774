// Where the tip loses its balance. Oracle: the overdamped flow
//   dp/ds = x_free − p + C (n F + f),   p(0) = where the last balance was,
// in steps too small to jump anything (explicit Euler; its fixed points are those of the flow, whatever the
// step). It asks the surface, the law (rigid) and the bristle, and nothing of the search for a balance.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "telenano/common/base/constants.h"
#include "telenano/nve_server/physics/equilibrium/tip_equilibrium.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"

namespace telenano::physics {
namespace {

constexpr double kTip_nm = 20;
constexpr int kMostIterations = 54 + 15;  // of a step: its limit, passed by what its last attempt takes

std::shared_ptr<const SplineSurface> hills(double height_nm, double length_nm) {
  constexpr int kSamples = 120;
  HeightGrid grid{kSamples, kSamples, 2, 2, 0, 0, {}};
  const double k = 2 * kPi / length_nm;
  for (int row = 0; row < kSamples; ++row) {
    for (int column = 0; column < kSamples; ++column) {
      const double x = 2.0 * column, y = 2.0 * row;
      grid.z_nm.push_back(height_nm * (std::cos(k * x) + std::cos(k * (0.3 * x + y))));
    }
  }
  return std::make_shared<SplineSurface>(grid, kTip_nm);
}

struct Flowed {
  Vec3 apex_w_nm;
  bool rests = false;
};

Flowed flow(const TipEquilibrium& equilibrium, const TipState& from, const Vec3& free_end,
            const Compliance& c) {
  // Stable up to 2/(C dF/dδ), here some 1/15, and where the bristle is found by fixed points up to 1/(C k).
  const double pace = equilibrium.options().friction ? 2e-3 : 1e-2;
  constexpr int kMost = 400000;
  const Vec3 to_centre(0, 0, kTip_nm);
  std::optional<Friction> friction;
  if (equilibrium.options().friction) friction.emplace(*equilibrium.options().friction);
  Vec3 p = from.apex_w_nm;
  TipSampleState law = from.law;
  FrictionState bristle = from.friction;
  FootMemory foot;
  for (int i = 0; i < kMost; ++i) {
    const SurfaceContact contact =
        equilibrium.surface().nearest(p + to_centre, i % 16 == 0 ? Search::kGlobal : Search::kLocal, foot);
    const Equilibrium eq =
        equilibrium.law().advance(kTip_nm - contact.distance_nm, 0, contact.effective_radius_nm, law);
    Vec3 force = eq.force_nn * contact.normal_w;
    const Vec3 free = pace * (free_end + c * force - p);
    Vec3 step = free;
    if (friction) {
      // Backward Euler for the bristle alone, which is stiff: three fixed-point steps on a contraction.
      for (int k = 0; k < 3; ++k) {
        const FrictionStep rub =
            friction->move(bristle, contact.normal_w, step, eq.contact_radius_nm, eq.force_nn, false);
        step = free + pace * (c * rub.force_w_nn);
      }
      bristle =
          friction->move(bristle, contact.normal_w, step, eq.contact_radius_nm, eq.force_nn, false).after;
    }
    p += step;
    if (step.norm() < 1e-9 * pace) return {p, true};
  }
  return {p, false};
}

struct Tally {
  int slides = 0;
  int over_several_steps = 0;
  int elsewhere = 0;
  double farthest_nm = 0;
};

// `exact_nm` and `of_way`: how near to the flow's end, absolutely and of the way there.
Tally walk(int worlds, bool friction, double exact_nm, double of_way) {
  std::mt19937_64 random(31);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const TipSampleLaw law({20.0, 0.1, 0.165, true});
  EquilibriumOptions options;
  if (friction) options.friction = FrictionParameters{0.05, 8.0, 0.0, 1.0};
  Tally tally;
  for (int world = 0; world < worlds; ++world) {
    const TipEquilibrium equilibrium(hills(2.0 + uniform(random), 60 + 20 * uniform(random)), law, kTip_nm,
                                     options);
    // Soft sideways, so that a tip pressed onto a summit cannot stay there.
    const Compliance c = Vec3(0.6 + 0.3 * uniform(random), 0.6 + 0.3 * uniform(random), 0.08).asDiagonal();
    const double angle = kPi * uniform(random);
    const Vec3 direction(std::cos(angle), std::sin(angle), 0);
    const Vec3 start(120 + 20 * uniform(random), 120 + 20 * uniform(random), 0);
    const double pressed = -8 + 3 * uniform(random);
    TipState state;
    for (double z = 12; z > pressed; z -= 0.5) equilibrium.advance(start + Vec3(0, 0, z), c, state);
    for (int i = 1; i <= 120; ++i) {
      const Vec3 end = start + Vec3(0, 0, pressed) + 0.5 * i * direction;
      const TipState before = state;
      TipSolution s = equilibrium.advance(end, c, state);
      EXPECT_EQ(s.status, SolveStatus::kOk);
      EXPECT_LE(s.iterations, kMostIterations);
      if (!s.slid) continue;
      ++tally.slides;
      if (s.under_way) ++tally.over_several_steps;
      for (int more = 0; s.under_way && !s.stuck && more < 200; ++more) {
        s = equilibrium.advance(end, c, state);
        EXPECT_LE(s.iterations, kMostIterations);
      }
      EXPECT_FALSE(s.under_way) << world << " " << i;
      const Flowed oracle = flow(equilibrium, before, end, c);
      EXPECT_TRUE(oracle.rests);
      const double off = (s.apex_w_nm - oracle.apex_w_nm).norm();
      const double way = (s.apex_w_nm - before.apex_w_nm).norm();
      tally.farthest_nm = std::max(tally.farthest_nm, way);
      if (off > exact_nm + of_way * way) ++tally.elsewhere;
    }
  }
  return tally;
}

// What is left is the flow's own end, at which it creeps.
TEST(Slide, EndsWhereTheFlowDoes) {
  const Tally tally = walk(20, false, 1e-3, 0);
  EXPECT_GT(tally.slides, 50);
  EXPECT_GT(tally.over_several_steps, 3);
  EXPECT_GT(tally.farthest_nm, 10);
  EXPECT_EQ(tally.elsewhere, 0);
}

// A bristle remembers the way, which is one step here and many in the flow: a fifth of the way at most, but
// where friction all but holds the tip, one may stay where the other goes on (1 of 100 seen).
TEST(Slide, EndsNearTheFlowWithFriction) {
  const Tally tally = walk(14, true, 0.05, 0.2);
  EXPECT_GT(tally.slides, 50);
  EXPECT_GT(tally.farthest_nm, 10);
  EXPECT_LE(tally.elsewhere, 2);
}

struct Caught {
  std::unique_ptr<TipEquilibrium> equilibrium;
  Compliance c;
  TipState state;
  Vec3 end;
  TipSolution solution;
};

// A tip that has lost its hold, at the end of the step in which it did.
Caught caught_on_its_way() {
  const TipSampleLaw law({20.0, 0.1, 0.165, true});
  for (int i = 0; i < 60; ++i) {
    Caught caught;
    caught.equilibrium = std::make_unique<TipEquilibrium>(hills(1.5 + 0.03 * i, 50 + i), law, kTip_nm);
    caught.c = Vec3(0.8, 0.7, 0.08).asDiagonal();
    const Vec3 start(100 + 0.7 * i, 110, -7);
    for (double z = 20; z > 0; z -= 0.5)
      caught.equilibrium->advance(start + Vec3(0, 0, z), caught.c, caught.state);
    for (int k = 1; k <= 120; ++k) {
      caught.end = start + 0.5 * k * Vec3(0.8, 0.6, 0);
      caught.solution = caught.equilibrium->advance(caught.end, caught.c, caught.state);
      if (caught.solution.under_way) return caught;
    }
  }
  ADD_FAILURE() << "no slide over several steps";
  return {};
}

double energy(const TipSolution& s, const Compliance& c) {
  return s.potential_aj + s.friction_stored_aj + 0.5 * s.force_w_nn.dot(c * s.force_w_nn);
}

TEST(Slide, OnItsWayTheSpringsPullAndTheEnergyFalls) {
  Caught caught = caught_on_its_way();
  ASSERT_TRUE(caught.equilibrium);
  TipSolution s = caught.solution;
  int steps = 0;
  for (; s.under_way && steps < 200; ++steps) {
    EXPECT_TRUE(s.slid);
    EXPECT_TRUE(caught.state.under_way);
    // To rounding of C⁻¹.
    EXPECT_LT((s.apex_w_nm - caught.end - caught.c * s.force_w_nn).norm(), 1e-11);
    const double before = energy(s, caught.c);
    s = caught.equilibrium->advance(caught.end, caught.c, caught.state);
    EXPECT_EQ(s.status, SolveStatus::kOk);
    EXPECT_LT(energy(s, caught.c), before + 1e-3);  // what a radius without a force may add on these hills
  }
  EXPECT_GT(steps, 0);
  EXPECT_LT(steps, 200);
  EXPECT_FALSE(caught.state.under_way);
  // At rest, and stays so.
  const Vec3 there = s.apex_w_nm;
  s = caught.equilibrium->advance(caught.end, caught.c, caught.state);
  EXPECT_FALSE(s.slid);
  EXPECT_LT((s.apex_w_nm - there).norm(), 1e-6);
}

// Springs that are rigid in a direction have no force of their own to hold the tip with on its way.
TEST(Slide, IsGoneInOneStepOnRigidSprings) {
  const TipSampleLaw law({20.0, 0.1, 0.165, true});
  const TipEquilibrium equilibrium(hills(2.0, 60), law, kTip_nm);
  const Compliance c = Vec3(0.8, 0.7, 0).asDiagonal();
  TipState state;
  const Vec3 start(110, 110, 0);
  for (double z = 12; z > 2; z -= 0.5) equilibrium.advance(start + Vec3(0, 0, z), c, state);
  for (int i = 0; i < 200; ++i) {
    const TipSolution s = equilibrium.advance(start + Vec3(0.4 * i, 0.3 * i, 2), c, state);
    ASSERT_FALSE(s.under_way) << i;
  }
}

}  // namespace
}  // namespace telenano::physics
