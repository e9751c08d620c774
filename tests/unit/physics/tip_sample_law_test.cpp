#include "telenano/nve_server/physics/law/tip_sample_law.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/long_range/van_der_waals.h"
#include "tests/support/alloc_guard.h"
#include "tests/support/contact_paths.h"

namespace telenano::physics {
namespace {

using testing::material_of;
using testing::silicon_on;
using testing::stored_aj;
using testing::WorkIntegral;

constexpr double kRadius = 20;

struct Sample {
  double e_gpa, gamma, nu;
  double lambda, pull_off, force_1nm;
};
// Samples of Kim & Sitti with reference values to the digits given.
constexpr Sample kSamples[] = {{70, 0.2, 0.27, 0.73676, 41.4015, 285.449},
                               {2, 0.066, 0.4, 4.04149, 21.7946, -2.85265},
                               {0.001, 0.022, 0.5, 408.71, 12.5034, -11.0577}};

TEST(TipSampleLaw, SamplesOfTheSourcePaper) {
  for (const Sample& s : kSamples) {
    for (const bool vdw : {false, true}) {
      const TipSampleLaw law(silicon_on(s.e_gpa, s.gamma, s.nu, vdw));
      EXPECT_NEAR(law.lambda(kRadius), s.lambda, 1.2e-5 * s.lambda);
      EXPECT_NEAR(law.pull_off_nn(kRadius), s.pull_off, 6e-5);
      TipSampleState state;
      const Equilibrium e = law.advance(1.0, 0.0, kRadius, state);
      EXPECT_EQ(e.status, SolveStatus::kOk);
      EXPECT_EQ(e.branch, Branch::kContact);
      EXPECT_NEAR(e.force_nn, s.force_1nm, 5e-6 * std::fabs(s.force_1nm));
      EXPECT_EQ(e.overlap_nm, state.overlap_nm);
      EXPECT_EQ(e.overlap_nm, 1.0);
    }
  }
}

TEST(TipSampleLaw, GoingOnFromAStateIsGoingOnFromACopy) {
  for (const MaugisMethod method : {MaugisMethod::kDirect, MaugisMethod::kTable}) {
    TipSampleParameters parameters = silicon_on(70, 0.2, 0.27, true);
    parameters.method = method;
    const TipSampleLaw law(parameters, kRadius);
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> step(-1, 1);
    TipSampleState whole, copy;
    std::array<TipSampleState, 2> turns;
    double base = -5;
    for (int i = 0; i < 4000; ++i) {
      // In and out of contact; trials that are not kept; now and then a radius that has no table.
      base = std::clamp(base + step(random), -8.0, 8.0);
      const double compliance = i % 7 == 0 ? 0 : 0.05;
      const double radius = i % 50 < 3 ? 1.1 * kRadius : kRadius;
      const bool kept = step(random) < 0.5;
      copy = whole;
      const Equilibrium a = law.advance(base, compliance, radius, copy);
      if (kept) whole = copy;
      turns[1].go_on_from(turns[0]);
      const Equilibrium b = law.advance(base, compliance, radius, turns[1]);
      if (kept) std::swap(turns[0], turns[1]);
      ASSERT_EQ(a.branch, b.branch) << i;
      ASSERT_EQ(a.force_nn, b.force_nn) << i;
      ASSERT_EQ(a.overlap_nm, b.overlap_nm) << i;
      ASSERT_EQ(a.stiffness_n_m, b.stiffness_n_m) << i;
      ASSERT_EQ(a.potential_aj, b.potential_aj) << i;
      ASSERT_EQ(a.dissipated_aj, b.dissipated_aj) << i;
    }
  }
}

TEST(TipSampleLaw, JumpToContactOfASoftCantilever) {
  // d = (H R/(3 k))^(1/3): 3.01/1.40/0.65 nm on silicon oxide at 0.1/1/10 N/m.
  const TipSampleLaw law(silicon_on(70, 0.2, 0.27, true));
  const VanDerWaals vdw = VanDerWaals::from_adhesion(law.parameters().work_of_adhesion_n_m, 0.165);
  for (const auto& [k, published] : {std::pair{0.1, 3.01}, {1.0, 1.40}, {10.0, 0.65}}) {
    const double d = std::cbrt(vdw.hamaker_aj * kRadius / (3 * k));
    EXPECT_NEAR(d, published, 0.006);
    // Base there: overlap + F/k with overlap = a0 - d.
    const double base = 0.165 - d + vdw.force_nn(kRadius, d) / k;
    TipSampleState state;
    const Equilibrium before = law.advance(base - 1e-9, 1 / k, kRadius, state);
    EXPECT_EQ(before.branch, Branch::kVanDerWaals);
    EXPECT_EQ(before.jumps, 0);
    // A square root of the distance from the jump, 1e-9 nm.
    EXPECT_NEAR(before.overlap_nm, 0.165 - d, 3e-4);
    const Equilibrium after = law.advance(base + 1e-9, 1 / k, kRadius, state);
    EXPECT_EQ(after.branch, Branch::kContact);
    EXPECT_EQ(after.jumps, 1);
    EXPECT_GT(after.dissipated_aj, 0);
    // What the spring lost is what the jump dissipated, up to F dZ of the two nanometre fractions.
    EXPECT_NEAR(stored_aj(before, 1 / k) - stored_aj(after, 1 / k), after.dissipated_aj, 1e-6);
  }
}

TEST(TipSampleLaw, WorkIsStoredOrDissipated) {
  // int F dZ by a quadrature that knows only the force, against potential and dissipation, over loops with
  // all jumps.
  for (const double lambda : {0.01, 0.3, 0.6, 0.73676, 1.0, 4.04149, 408.71}) {
    for (const bool vdw : {false, true}) {
      const TipSampleLaw law(material_of(lambda, vdw));
      const double unit = law.scales(kRadius).overlap_nm;
      for (const double soft : {0.0, 0.2, 20.0}) {
        const double c = soft * unit / law.scales(kRadius).force_nn;
        const double out = -(20 * 0.165 + 60 * unit + 40 * soft * unit);
        TipSampleState state;
        const double start = stored_aj(law.advance(out, c, kRadius, state), c);
        const WorkIntegral work(law, c, kRadius);
        double stored = start, position = out, scale = 0, total = 0, dissipated_total = 0;
        for (const double target : {-0.5 * unit, 5.0 * unit, -1.5 * unit, out}) {
          const double w = work.run(position, target, state, 1e-13 * law.scales(kRadius).energy_aj);
          const Equilibrium e = law.advance(target, c, kRadius, state);
          const double now = stored_aj(e, c);
          scale = std::max({scale, std::fabs(w), std::fabs(now), law.scales(kRadius).energy_aj});
          // The quadrature's limit: at a jump, F times the last bits of Z, and 1e-13 an interval.
          EXPECT_NEAR(w, now - stored + e.dissipated_aj, 3e-11 * scale)
              << lambda << ' ' << vdw << ' ' << soft << ' ' << target / unit;
          EXPECT_GE(e.dissipated_aj, 0);
          total += w;
          dissipated_total += e.dissipated_aj;
          stored = now;
          position = target;
        }
        EXPECT_NEAR(stored, start, 1e-12 * scale);
        EXPECT_NEAR(total, dissipated_total, 1e-10 * scale);
      }
    }
  }
}

TEST(TipSampleLaw, OneLongStepEqualsManyShortOnes) {
  std::mt19937_64 random(11);
  for (const double lambda : {0.05, 0.73676, 1.3, 30.0}) {
    for (const bool vdw : {false, true}) {
      const TipSampleLaw law(material_of(lambda, vdw));
      const double unit = law.scales(kRadius).overlap_nm;
      const double c = 3.0 * unit / law.scales(kRadius).force_nn;
      const double scale = law.scales(kRadius).energy_aj * (1 + 1 / lambda);
      TipSampleState one, many;
      double position = -50 * unit - 5;
      law.advance(position, c, kRadius, one);
      law.advance(position, c, kRadius, many);
      for (int leg = 0; leg < 40; ++leg) {
        const double target = std::uniform_real_distribution<double>(-50 * unit - 5, 15 * unit)(random);
        const Equilibrium a = law.advance(target, c, kRadius, one);
        double dissipated = 0;
        int jumps = 0;
        Equilibrium b;
        for (int i = 1; i <= 37; ++i) {
          b = law.advance(i == 37 ? target : position + (target - position) * i / 37, c, kRadius, many);
          dissipated += b.dissipated_aj;
          jumps += b.jumps;
        }
        position = target;
        EXPECT_EQ(a.branch, b.branch);
        EXPECT_EQ(a.jumps, jumps);
        EXPECT_NEAR(a.dissipated_aj, dissipated, 1e-12 * scale);
        EXPECT_NEAR(a.force_nn, b.force_nn, 1e-12 * (std::fabs(a.force_nn) + law.scales(kRadius).force_nn));
        EXPECT_NEAR(a.potential_aj, b.potential_aj, 1e-12 * (scale + std::fabs(a.potential_aj)));
      }
    }
  }
}

// The spring's jumps, found by brute force: the tip creeps in small steps along the net force, on the law
// under displacement control (compliance 0), and what the net force does on the way is dissipated.
TEST(TipSampleLaw, SpringFollowsAnOverdampedTip) {
  for (const double lambda : {0.1, 0.6, 0.8, 1.5, 10.0}) {
    for (const bool vdw : {false, true}) {
      const TipSampleLaw law(material_of(lambda, vdw));
      const ContactScales s = law.scales(kRadius);
      for (const double soft : {0.3, 3.0}) {
        const double c = soft * s.overlap_nm / s.force_nn;
        const double span = (vdw ? 8 * 0.165 : 1.1 * 0.165) + (6 + 4 * soft) * s.overlap_nm;
        const double h = 2e-5 * span;
        TipSampleState creep, state;
        double tip = -span;
        law.advance(tip, 0, kRadius, creep);
        constexpr int kSteps = 2000;
        const double base_step = 1.5 * span / kSteps;
        double crept = 0, dissipated = 0, allowed = 0;
        for (int k = 0; k <= 2 * kSteps; ++k) {
          const double base = -span + base_step * (k <= kSteps ? k : 2 * kSteps - k);
          // One direction only until the net force turns: the first equilibrium met.
          double net = (base - tip) / c - law.advance(tip, 0, kRadius, creep).force_nn;
          const double direction = net > 0 ? 1 : -1;
          const double start = tip;
          double lost = 0;
          while (net * direction > 0) {
            tip += direction * h;
            const Equilibrium rigid = law.advance(tip, 0, kRadius, creep);
            // The rigid law's own jumps of force (snap-in, fold) lose energy too, and the handover going in.
            lost += net * direction * h;
            crept += rigid.dissipated_aj;
            net = (base - tip) / c - rigid.force_nn;
          }
          const Equilibrium e = law.advance(base, c, kRadius, state);
          dissipated += e.dissipated_aj;
          if (std::fabs(tip - start) > 20 * base_step || e.jumps > 0) {
            crept += lost;
            // The creeping tip jumps up to one base step late, with that much more spring force all the way.
            allowed += 2 * base_step / c * std::fabs(tip - start) + 0.02 * lost;
          }
          // Near the ends of a state its overlap has a vertical tangent; a step of the base aside tells.
          TipSampleState aside = state;
          const double other =
              law.advance(base + (k < kSteps ? base_step : -base_step), c, kRadius, aside).overlap_nm;
          EXPECT_LT(std::fabs(e.overlap_nm - tip), 2 * h + 2 * std::fabs(other - e.overlap_nm))
              << "lambda " << lambda << " vdw " << vdw << " c " << soft << " base " << base;
        }
        EXPECT_NEAR(crept, dissipated, allowed + 1e-3 * s.energy_aj) << lambda << ' ' << vdw << ' ' << soft;
      }
    }
  }
}

TEST(TipSampleLaw, ReversibleBelowTheCrossingWithoutLoss) {
  // lambda < 0.717: approach and retract are the same curve, no energy is lost.
  for (const double lambda : {1e-3, 0.1, 0.5, 0.7}) {
    const TipSampleLaw law(material_of(lambda, true));
    const double unit = law.scales(kRadius).overlap_nm;
    TipSampleState in, out;
    law.advance(3 * unit, 0, kRadius, out);
    for (double delta = -2.0; delta < 3 * unit; delta += 0.013) {
      const Equilibrium a = law.advance(delta, 0, kRadius, in);
      TipSampleState copy = out;
      const Equilibrium b = law.advance(delta, 0, kRadius, copy);
      EXPECT_EQ(a.jumps + b.jumps, 0);
      EXPECT_EQ(a.branch, b.branch);
      EXPECT_NEAR(a.force_nn, b.force_nn, 1e-11 * law.scales(kRadius).force_nn);
      EXPECT_NEAR(a.potential_aj, b.potential_aj,
                  1e-12 * (std::fabs(a.potential_aj) + law.scales(kRadius).energy_aj));
    }
  }
}

TEST(TipSampleLaw, StiffnessAndForceAreDerivatives) {
  for (const double lambda : {0.1, 0.73676, 4.0}) {
    for (const bool vdw : {false, true}) {
      const TipSampleLaw law(material_of(lambda, vdw));
      const double unit = law.scales(kRadius).overlap_nm;
      for (const double delta : {-30 * unit, -0.3 * unit, 0.7 * unit, 20 * unit}) {
        const double h = 1e-5 * unit;
        TipSampleState state;
        if (!vdw) law.advance(40 * unit, 0, kRadius, state);
        const Equilibrium e = law.advance(delta, 0, kRadius, state);
        const Equilibrium up = law.advance(delta + h, 0, kRadius, state);
        const Equilibrium down = law.advance(delta - h, 0, kRadius, state);
        const double scale = law.scales(kRadius).force_nn / unit;
        EXPECT_NEAR(e.stiffness_n_m, (up.force_nn - down.force_nn) / (2 * h),
                    1e-6 * (scale + std::fabs(e.stiffness_n_m)));
        EXPECT_NEAR(e.force_nn, (up.potential_aj - down.potential_aj) / (2 * h),
                    1e-8 * (scale * unit * (1 + 1 / lambda) + std::fabs(e.force_nn)));
      }
    }
  }
}

TEST(TipSampleLaw, SnapInExactlyAtTheRange) {
  // Without van der Waals: free at Delta = -H0 on approach, on the curve on retract.
  for (const double lambda : {0.1, 0.5, 2.0}) {
    const TipSampleLaw law(material_of(lambda, false));
    const double edge = -law.scales(kRadius).overlap_nm * (2.0 / (M_PI * law.lambda(kRadius)));
    TipSampleState in, out;
    EXPECT_EQ(law.advance(edge, 0, kRadius, in).branch, Branch::kFree);
    EXPECT_NE(law.advance(edge * (1 - 1e-14), 0, kRadius, in).branch, Branch::kFree);
    law.advance(5, 0, kRadius, out);
    const Branch expected = lambda < 0.655 ? Branch::kNonContact : Branch::kContact;
    EXPECT_EQ(law.advance(edge, 0, kRadius, out).branch, expected);
  }
}

TEST(TipSampleLaw, BranchIsCarriedOverWhenTheRadiusChanges) {
  for (const bool vdw : {false, true}) {
    const TipSampleLaw law(silicon_on(2, 0.066, 0.4, vdw));
    TipSampleState state;
    law.advance(0.5, 0.05, 40, state);
    // Retract nearly to the fold at R = 40, then move to a place where R is 5: the fold there lies at larger
    // overlap.
    TipSampleState fixed;
    double base = 0.5;
    while (law.advance(base, 0.05, 40, state).branch == Branch::kContact) base -= 1e-3;
    law.advance(0.5, 0.05, 40, state);
    Equilibrium e = law.advance(base + 2e-3, 0.05, 40, state);
    ASSERT_EQ(e.branch, Branch::kContact);
    e = law.advance(base + 2e-3, 0.05, 5, state);
    EXPECT_EQ(e.status, SolveStatus::kOk);
    EXPECT_NE(e.branch, Branch::kContact);
    EXPECT_EQ(e.jumps, 1);
    EXPECT_GE(e.dissipated_aj, 0);
    // And the same numbers as a fresh state at the new radius.
    law.advance(-20, 0.05, 5, fixed);
    const Equilibrium fresh = law.advance(base + 2e-3, 0.05, 5, fixed);
    EXPECT_DOUBLE_EQ(e.force_nn, fresh.force_nn);
    EXPECT_DOUBLE_EQ(e.potential_aj, fresh.potential_aj);
    // In contact, radius changing every step: same as solved afresh.
    std::mt19937_64 random(5);
    for (int i = 0; i < 2000; ++i) {
      const double radius = std::uniform_real_distribution<double>(3, 60)(random);
      const double at = std::uniform_real_distribution<double>(-0.05, 4)(random);
      const Equilibrium warm = law.advance(at, 0.01, radius, state);
      TipSampleState cold_state;
      law.advance(4, 0.01, radius, cold_state);
      if (warm.branch != Branch::kContact) continue;
      const Equilibrium cold = law.advance(at, 0.01, radius, cold_state);
      ASSERT_EQ(cold.branch, warm.branch);
      EXPECT_NEAR(warm.force_nn, cold.force_nn, 1e-11 * (1 + std::fabs(cold.force_nn)));
      EXPECT_NEAR(warm.potential_aj, cold.potential_aj, 1e-11 * (1 + std::fabs(cold.potential_aj)));
    }
  }
}

TEST(TipSampleLaw, NonFiniteInputGivesNoForceAndKeepsTheState) {
  const TipSampleLaw law(silicon_on(2, 0.066, 0.4, true));
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  TipSampleState state;
  law.advance(0.5, 0.1, 20, state);
  for (const auto& [z, c, r] : {std::tuple{kNan, 0.1, 20.0},
                                {0.5, kNan, 20.0},
                                {0.5, 0.1, kNan},
                                {kInf, 0.1, 20.0},
                                {0.5, -1.0, 20.0},
                                {0.5, 0.1, 0.0},
                                {0.5, 0.1, -3.0},
                                {0.5, 0.1, kInf},
                                {-kInf, 0.1, 20.0},
                                {0.5, kInf, 20.0}}) {
    const Equilibrium e = law.advance(z, c, r, state);
    EXPECT_EQ(e.status, SolveStatus::kNonFinite);
    EXPECT_EQ(e.force_nn, 0);
    EXPECT_EQ(state.branch, Branch::kContact);
  }
  // Finite, but its scales are not: no force either.
  const Equilibrium huge = law.advance(1e300, 1e300, 1e300, state);
  EXPECT_EQ(huge.force_nn, 0);
  EXPECT_EQ(law.advance(0.5, 0.1, 20, state).status, SolveStatus::kOk);
}

TEST(TipSampleLaw, TakesNothingFromTheHeap) {
  if (!support::AllocGuard::active()) GTEST_SKIP() << "allocations are not counted in this build";
  const TipSampleLaw law(silicon_on(2, 0.066, 0.4, true));
  const support::AllocGuard guard;
  TipSampleState state;
  for (int i = 0; i < 1000; ++i) law.advance(i % 7 - 4.0, 0.02, 10 + i % 3, state);
  EXPECT_EQ(guard.allocations(), 0u);
}

TEST(TipSampleLaw, RejectsImpossibleMaterials) {
  for (const double bad :
       {0.0, -1.0, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    TipSampleParameters p = silicon_on(2, 0.066, 0.4, true);
    p.contact_modulus_gpa = bad;
    EXPECT_THROW(TipSampleLaw{p}, UserError);
    p = silicon_on(2, 0.066, 0.4, true);
    p.work_of_adhesion_n_m = bad;
    EXPECT_THROW(TipSampleLaw{p}, UserError);
    p = silicon_on(2, 0.066, 0.4, true);
    p.equilibrium_distance_nm = bad;
    EXPECT_THROW(TipSampleLaw{p}, UserError);
  }
}

}  // namespace
}  // namespace telenano::physics
