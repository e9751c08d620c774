// The balance on one potential, over grounds in closed form: nothing here knows of scans.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "tests/support/alloc_guard.h"
#include "tests/support/potential_paths.h"

namespace telenano::physics {
namespace {

using support::ClosedPath;
using support::EggCrate;
using support::gentle_ground;
using support::kTwoPi;
using support::Lap;
using support::lap;
using support::potential_of;
using support::rough_contact;
using support::rough_ground;
using support::silicon_oxide;
using support::stiff_springs;
using support::stored;

// Pressed some 1 to 2 nm everywhere: no jump, and the same path back to the same state.
TEST(Potential, SmoothClosedPathsGiveAndTakeNothing) {
  const PotentialEquilibrium on(gentle_ground(), potential_of(silicon_oxide()));
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const ClosedPath path(seed, -4.0, 0.8);
    for (const double step : {0.05, 0.005, 0.0005}) {
      const Lap l = lap(on, stiff_springs(), path, step);
      EXPECT_EQ(l.jumps, 0);
      EXPECT_EQ(l.under_way, 0);
      const double left = std::fabs(l.work - l.stored - l.lost) / l.turnover;
      // Uneven harmonics are resolved at 0.05 nm; what is left is the solver's own 1e-9 nm.
      EXPECT_LE(left, 1e-10) << "step " << step << " seed " << seed;
      EXPECT_LE(std::fabs(l.stored) / l.turnover, 1e-10) << "step " << step;
      EXPECT_LE(l.lost / l.turnover, 1e-6) << "step " << step << " seed " << seed;
      RecordProperty("left", std::to_string(left));
      std::printf("seed %d step %g nm: turnover %.4g aJ, left %.2e, stored %.2e, lost %.2e of it\n",
                  static_cast<int>(seed), step, l.turnover, left, l.stored / l.turnover, l.lost / l.turnover);
    }
  }
}

// In and out of contact, again and again.
TEST(Potential, ClosedPathsWithJumpsLoseWhatTheyTake) {
  const PotentialEquilibrium on(gentle_ground(), potential_of(silicon_oxide()));
  Compliance soft = Mat3::Identity() / 20.0;
  soft(2, 2) = 1.0 / 2.0;
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    const ClosedPath path(seed, 10.0, 30.0);
    const Lap l = lap(on, soft, path, 0.0005);
    EXPECT_GT(l.jumps, 0);
    EXPECT_GT(l.lost, 0.0);
    const double left = std::fabs(l.work - l.stored - l.lost) / l.turnover;
    // A fold, where the force goes like a square root, is met within a step: (0.5 pm)^1.5.
    EXPECT_LE(left, 1e-6);
    std::printf("seed %d: %d jumps, turnover %.4g aJ, left %.2e, lost %.2e of it\n", static_cast<int>(seed),
                l.jumps, l.turnover, left, l.lost / l.turnover);
  }
}

// Any springs, any motion, any step: each ends in a local minimum, or interrupted lower than it began; the
// account closes; nothing is won.
TEST(Potential, EveryStepEndsInAMinimumOrOnItsWayDown) {
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> any(0.0, 1.0);
  const auto potential = potential_of(silicon_oxide());
  const PotentialEquilibrium grounds[3] = {{gentle_ground(), potential},
                                           {rough_ground(), potential},
                                           {rough_ground(), potential, rough_contact()}};
  int interrupted = 0, steps = 0, most = 0, longest = 0;
  for (int motion = 0; motion < 200; ++motion) {
    const PotentialEquilibrium& on = grounds[motion % 3];
    Mat3 a;
    for (int i = 0; i < 9; ++i) a(i / 3, i % 3) = any(random) - 0.5;
    const Mat3 k =
        (a * a.transpose() + 0.1 * Mat3::Identity()) * 10.0 * std::pow(10.0, 4.0 * any(random) - 2.0);
    const Compliance c = 0.5 * (Mat3(k.inverse()) + Mat3(k.inverse()).transpose());
    const double step = std::pow(10.0, 3.0 * any(random) - 2.0);
    PotentialState state;
    Vec3 x(0, 0, 20);
    TipSolution s = on.advance(x, c, state);
    Vec3 v(0, 0, -step);
    const double low = -2.0 - 300.0 / k(2, 2);
    int run = 0;
    bool was_under_way = false;
    double before_energy = s.potential_aj + s.friction_stored_aj;
    for (int i = 0; i < 1000; ++i) {
      if (i % 50 == 0) v = Vec3(any(random) - 0.5, any(random) - 0.5, any(random) - 0.7).normalized() * step;
      if (x.z() < low) v.z() = std::fabs(v.z());
      if (x.z() > 12.0) v.z() = -std::fabs(v.z());
      const Vec3 apex = state.apex_w_nm;
      x += v;
      s = on.advance(x, c, state);
      ++steps;
      ASSERT_EQ(s.status, SolveStatus::kOk);
      ASSERT_GE(s.dissipated_aj, 0.0);
      ASSERT_LE(s.iterations, PotentialEquilibrium::kMostEvaluations + 4);
      most = std::max(most, s.iterations);
      CurveHint hint;
      PotentialSample at;
      ASSERT_EQ(on.tip_potential().sample(s.apex_w_nm, state.branch, hint, at), BranchEnd::kNone)
          << "motion " << motion << " step " << i;
      ASSERT_GE(s.friction_dissipated_aj, 0.0);
      const bool rubs = motion % 3 == 2;
      const Vec3 net = k * (s.apex_w_nm - x) + at.gradient_nn;
      if (s.under_way) {
        ++interrupted;
        longest = std::max(longest, ++run);
        ASSERT_LT(run, 50) << "motion " << motion;
      } else if (run = 0; !rubs) {
        const double least = Eigen::SelfAdjointEigenSolver<Mat3>(k + at.hessian_n_m).eigenvalues()[0];
        EXPECT_GT(least, 0.0) << "motion " << motion << " step " << i;
        // The Newton step that is left.
        EXPECT_LE(Vec3((k + at.hessian_n_m).inverse() * net).norm(), 1e-7)
            << "motion " << motion << " step " << i;
      }
      // A tip on its way down was held while the end moved: what it has fallen since is lost, no more, no
      // less.
      const double held = before_energy + 0.5 * (apex - x).dot(k * (apex - x));
      const double now =
          0.5 * (s.apex_w_nm - x).dot(k * (s.apex_w_nm - x)) + s.potential_aj + s.friction_stored_aj;
      if (was_under_way) {
        ASSERT_NEAR(now, held - s.dissipated_aj - s.friction_dissipated_aj, 1e-9 * (1.0 + std::fabs(held)))
            << "motion " << motion;
      }
      was_under_way = s.under_way;
      before_energy = s.potential_aj + s.friction_stored_aj;
    }
  }
  std::printf("%d steps, %d interrupted (longest run %d), most evaluations %d\n", steps, interrupted, longest,
              most);
  EXPECT_LT(interrupted, steps / 100);
}

// Backward Euler: of first order in the step, and so is what is left.
TEST(Potential, ClosedPathsWithFrictionRubOffWhatTheyTake) {
  const PotentialEquilibrium on(gentle_ground(), potential_of(silicon_oxide()), rough_contact());
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    const ClosedPath path(seed, -4.0, 0.8);
    double before = 0;
    for (const double step : {0.05, 0.005, 0.0005}) {
      const Lap l = lap(on, stiff_springs(), path, step);
      const double left = std::fabs(l.work - l.stored - l.lost - l.rubbed) / l.turnover;
      std::printf("seed %d step %g nm: turnover %.4g aJ, left %.2e, rubbed %.2e, lost %.2e of it\n",
                  static_cast<int>(seed), step, l.turnover, left, l.rubbed / l.turnover, l.lost / l.turnover);
      EXPECT_GT(l.rubbed, 0.05 * l.turnover);
      EXPECT_EQ(l.under_way, 0);
      EXPECT_LE(l.lost / l.turnover, 1e-6);
      if (before > 0) {
        EXPECT_LE(left, 0.2 * before);
      }
      before = left;
    }
    EXPECT_LE(before, 1e-5);
  }
}

// The limit is that of the law's contact, and a jump through the border leaves no hole.
TEST(Potential, FrictionOnFlatGroundIsItsOwnLaw) {
  const auto flat = std::make_shared<EggCrate>();
  const TipSampleLaw law(silicon_oxide(), 20.0);
  const FrictionParameters rough = rough_contact();
  const PotentialEquilibrium on(flat, potential_of(silicon_oxide()), rough);
  const Compliance c = Mat3::Identity() / 5.0;
  PotentialState state;
  TipSolution s;
  double charged = 0, trapezia = 0;
  Vec3 last(0, 0, 10);
  s = on.advance(last, c, state);
  const auto go = [&](const Vec3& x) {
    const Vec3 force = s.force_w_nn;
    const double before = stored(s, c);
    s = on.advance(x, c, state);
    charged += stored(s, c) - before + s.dissipated_aj + s.friction_dissipated_aj;
    trapezia -= 0.5 * (force + s.force_w_nn).dot(x - last);
    last = x;
    ASSERT_GE(s.dissipated_aj, 0.0);
    ASSERT_GE(s.friction_dissipated_aj, 0.0);
  };
  for (int i = 1; i <= 12000; ++i) go(Vec3(0, 0, 10 - 0.001 * i));
  for (int i = 1; i <= 40000; ++i) go(Vec3(0.001 * i, 0, -2));
  ASSERT_TRUE(s.sliding);
  const double a = s.contact_radius_nm;
  EXPECT_NEAR(-s.force_w_nn.x(), rough.shear_strength_gpa * 3.14159265358979 * a * a, 1e-6);
  TipSampleState law_state;
  law.advance(-10.0, 0.2, 20.0, law_state);
  EXPECT_NEAR(s.force_w_nn.z(), law.advance(2.0, 0.2, 20.0, law_state).force_nn, 1e-6);
  for (int i = 1; i <= 40000; ++i) go(Vec3(40, 0, -2 + 0.001 * i));  // and off, sideways stretched
  EXPECT_EQ(s.branch, Branch::kVanDerWaals);
  EXPECT_LT(std::fabs(s.force_w_nn.x()), 1e-9);
  // Each jump lies somewhere in a step of 1 pm: half of that times 40 nN.
  EXPECT_NEAR(charged, trapezia, 0.1);
}

// Level ground: the law's own one-dimensional balance.
TEST(Potential, FlatGroundIsTheLaw) {
  const auto flat = std::make_shared<EggCrate>();
  const TipSampleLaw law(silicon_oxide(), 20.0);
  const PotentialEquilibrium on(flat, potential_of(silicon_oxide()));
  for (const double k : {0.5, 5.0, 50.0}) {
    const Compliance c = Mat3::Identity() / k;
    PotentialState state;
    TipSampleState law_state;
    double lost = 0, law_lost = 0, pull_off = 0, law_pull_off = 0;
    int differ = 0;
    const auto go = [&](double z) {
      const TipSolution s = on.advance(Vec3(0, 0, z), c, state);
      const Equilibrium exact = law.advance(-z, 1.0 / k, 20.0, law_state);
      lost += s.dissipated_aj;
      law_lost += exact.dissipated_aj;
      pull_off = std::min(pull_off, s.force_w_nn.z());
      law_pull_off = std::min(law_pull_off, exact.force_nn);
      const bool in = s.branch == Branch::kContact || s.branch == Branch::kNonContact;
      const bool law_in = exact.branch == Branch::kContact || exact.branch == Branch::kNonContact;
      if (in != law_in || s.under_way) {
        ++differ;
        return;
      }
      EXPECT_NEAR(s.force_w_nn.z(), exact.force_nn, 1e-6) << "k " << k << " z " << z;
      EXPECT_NEAR(s.potential_aj, exact.potential_aj, 1e-7) << "k " << k << " z " << z;
      EXPECT_NEAR(s.stiffness_n_m, exact.stiffness_n_m, 1e-3 * (10 + std::fabs(exact.stiffness_n_m)));
      EXPECT_NEAR(s.contact_radius_nm, exact.contact_radius_nm, 1e-4);  // a step from the fold
    };
    const double top = 5.0 + 100.0 / k;
    for (double z = top; z > -top; z -= 0.01) go(z);
    for (double z = -top; z < top; z += 0.01) go(z);
    EXPECT_LE(differ, 2) << k;  // where one of the two jumps a step earlier
    EXPECT_NEAR(pull_off, law_pull_off, 1e-6) << k;
    // A jump begins up to a quarter of a step late: that times the force's change, as the end goes on.
    EXPECT_GE(lost, law_lost - 1e-6) << k;
    EXPECT_LE(lost, law_lost + 0.0025 * 2.0 * std::fabs(law_pull_off)) << k;
  }
}

// Every law: level ground is its own balance, and a smooth closed path gives and takes nothing. Those whose
// form goes with λ have their radius force by differences, 1e-8 of the energy.
TEST(Potential, EveryLawHasOne) {
  for (const ContactLaw model : kContactLaws) {
    for (const bool van_der_waals : {false, true}) {
      if (van_der_waals && model == ContactLaw::kHertz) continue;
      SCOPED_TRACE(std::string(contact_law_name(model)) + (van_der_waals ? "" : " alone"));
      TipSampleParameters p = silicon_oxide();
      p.model = model;
      p.van_der_waals = van_der_waals;
      const TipSampleLaw law(p, 20.0);
      const PotentialEquilibrium flat(std::make_shared<EggCrate>(), potential_of(p));
      const Compliance c = Mat3::Identity() / 5.0;
      PotentialState state;
      TipSampleState law_state;
      int differ = 0;
      double lost = 0, law_lost = 0;
      for (int i = 0; i < 4000; ++i) {
        const double z = std::fabs(20.0 - 0.01 * i) - 10.0;
        const TipSolution s = flat.advance(Vec3(0, 0, z), c, state);
        const Equilibrium exact = law.advance(-z, 0.2, 20.0, law_state);
        ASSERT_GE(s.dissipated_aj, 0.0);
        lost += s.dissipated_aj;
        law_lost += exact.dissipated_aj;
        const bool in = s.branch == Branch::kContact || s.branch == Branch::kNonContact;
        const bool law_in = exact.branch == Branch::kContact || exact.branch == Branch::kNonContact;
        if (in != law_in || s.under_way) {
          ++differ;
          continue;
        }
        ASSERT_NEAR(s.force_w_nn.z(), exact.force_nn, 1e-6) << z;
        ASSERT_NEAR(s.potential_aj, exact.potential_aj, 1e-6) << z;
      }
      EXPECT_LE(differ, 2);
      EXPECT_NEAR(lost, law_lost, 0.3);  // a quarter of a step of some 60 nN, at two events
      const PotentialEquilibrium on(gentle_ground(), potential_of(p));
      const Lap l = lap(on, stiff_springs(), ClosedPath(1, -4.0, 0.8), 0.05);
      EXPECT_EQ(l.jumps, 0);
      EXPECT_LE(std::fabs(l.work - l.stored - l.lost) / l.turnover, 1e-8);
      EXPECT_LE(l.lost / l.turnover, 1e-6);
    }
  }
}

// Rigid sideways, as a force curve's lever is.
TEST(Potential, SpringsMayBeRigidInSomeDirections) {
  const PotentialEquilibrium on(gentle_ground(), potential_of(silicon_oxide()));
  Compliance c = Mat3::Zero();
  c(2, 2) = 1.0 / 40.0;
  PotentialState state;
  double work = 0, turnover = 0, lost = 0;
  TipSolution last;
  double begin = 0;
  for (int i = 0; i <= 40000; ++i) {
    const double s = static_cast<double>(i % 40000) / 40000;
    const Vec3 x(0.3 + 4 * std::sin(kTwoPi * s), 0.7 + 3 * std::cos(kTwoPi * s),
                 -4.0 + std::sin(2 * kTwoPi * s));
    const Vec3 rate = kTwoPi / 40000 *
                      Vec3(4 * std::cos(kTwoPi * s), -3 * std::sin(kTwoPi * s), 2 * std::cos(2 * kTwoPi * s));
    const TipSolution now = on.advance(x, c, state);
    ASSERT_EQ(now.status, SolveStatus::kOk);
    ASSERT_FALSE(now.under_way) << i;
    EXPECT_EQ(now.apex_w_nm.x(), x.x());
    EXPECT_EQ(now.apex_w_nm.y(), x.y());
    if (i == 0) {
      begin = stored(now, c);
    } else {
      work -= now.force_w_nn.dot(rate);
      turnover += std::fabs(now.force_w_nn.dot(rate));
      lost += now.dissipated_aj;
    }
    last = now;
  }
  EXPECT_LE(std::fabs(work - lost - (stored(last, c) - begin)) / turnover, 1e-10);
  EXPECT_LE(lost / turnover, 1e-9);
  // Rigid in all directions.
  PotentialState fixed;
  for (double z = 5.0; z > -3.0; z -= 0.1) {
    const TipSolution s = on.advance(Vec3(0, 0, z), Mat3::Zero(), fixed);
    EXPECT_EQ(s.apex_w_nm, Vec3(0, 0, z));
    EXPECT_FALSE(s.under_way);
  }
}

TEST(Potential, NoNumbersAreRefusedAndNothingIsAllocated) {
  const PotentialEquilibrium on(gentle_ground(), potential_of(silicon_oxide()));
  PotentialState state;
  on.advance(Vec3(0, 0, 5), stiff_springs(), state);
  EXPECT_EQ(on.advance(Vec3(0, 0, std::nan("")), stiff_springs(), state).status, SolveStatus::kNonFinite);
  EXPECT_EQ(state.free_end_w_nm, Vec3(0, 0, 5));
  const support::AllocGuard guard;
  for (int i = 0; i < 1000; ++i) on.advance(Vec3(0.1 * i, 0, 5 - 0.01 * i), stiff_springs(), state);
  EXPECT_EQ(guard.allocations(), 0u);
}

}  // namespace
}  // namespace telenano::physics
