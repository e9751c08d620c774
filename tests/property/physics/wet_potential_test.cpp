// The balance on one potential in moist air: bridges form and rupture, and each event loses energy.
#include <gtest/gtest.h>

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <random>
#include <string>

#include "tests/support/potential_paths.h"

namespace telenano::physics {
namespace {

using support::ClosedPath;
using support::EggCrate;
using support::gentle_ground;
using support::Lap;
using support::lap;
using support::potential_of;
using support::rough_contact;
using support::rough_ground;
using support::silicon_oxide;
using support::stored;

TipSampleParameters moist(TipSampleParameters p, double humidity_percent, double film_nm) {
  CapillaryParameters& water = p.long_range.capillary;
  water.humidity_percent = humidity_percent;
  water.contact_angle_tip_deg = water.contact_angle_sample_deg = 20.0;
  water.film_nm = film_nm;
  return p;
}
TipSampleParameters moist_oxide() {
  return moist(silicon_oxide(), 50.0, 0.4);
}
TipSampleParameters with_far(TipSampleParameters p) {
  p.long_range.retardation_nm = 100.0;
  p.long_range.cone_half_angle_deg = 18.0;
  p.long_range.cone_height_nm = 10000.0;
  return p;
}
TipSampleParameters held_volume(double volume_nm3) {
  TipSampleParameters p = moist_oxide();
  p.long_range.capillary.model = CapillaryModel::kConstantVolume;
  p.long_range.capillary.volume_nm3 = volume_nm3;
  return p;
}

/// gentle_ground() with fields of another softening for bridge and bias: another height, another radius.
std::shared_ptr<EggCrate> two_softenings(std::shared_ptr<EggCrate> ground) {
  auto softened = std::make_shared<EggCrate>(*ground);
  softened->height.level += 0.03;
  softened->height.waves.front().size *= 0.9;
  softened->log_radius.level += 0.1;
  softened->log_radius.waves.front().size *= 0.6;
  ground->softened = softened;
  return ground;
}

// Level ground is the law's own one-dimensional balance, which knows nothing of fields: forces, energies,
// bridges and losses, down and up again.
TEST(WetPotential, FlatGroundIsTheLaw) {
  const auto flat = std::make_shared<EggCrate>();
  TipSampleParameters soft = silicon_oxide();
  soft.contact_modulus_gpa = 3.1;
  soft.work_of_adhesion_n_m = 0.23;
  TipSampleParameters no_vdw = moist_oxide();
  no_vdw.van_der_waals = false;
  const TipSampleParameters laws[] = {moist_oxide(),
                                      with_far(moist_oxide()),
                                      moist(silicon_oxide(), 80.0, 0.0),
                                      moist(silicon_oxide(), 10.0, 0.4),  // none in contact
                                      moist(soft, 50.0, 0.4),
                                      held_volume(0.0),
                                      held_volume(30.0),
                                      no_vdw};
  for (const TipSampleParameters& p : laws) {
    const TipSampleLaw law(p, 20.0);
    const PotentialEquilibrium on(flat, potential_of(p));
    for (const double k : {0.5, 5.0, 50.0}) {
      SCOPED_TRACE("law " + std::to_string(&p - laws) + " k " + std::to_string(k));
      const Compliance c = Mat3::Identity() / k;
      PotentialState state;
      TipSampleState law_state;
      double lost = 0, law_lost = 0, pull_off = 0, law_pull_off = 0;
      int differ = 0, bridges = 0, law_bridges = 0;
      const auto go = [&](double z) {
        const bool was_wet = state.branch.bridge.present, law_was_wet = law_state.bridge.present;
        const TipSolution s = on.advance(Vec3(0, 0, z), c, state);
        const Equilibrium exact = law.advance(-z, 1.0 / k, 20.0, law_state);
        ASSERT_GE(s.dissipated_aj, 0.0);
        lost += s.dissipated_aj;
        law_lost += exact.dissipated_aj;
        bridges += state.branch.bridge.present != was_wet;
        law_bridges += law_state.bridge.present != law_was_wet;
        pull_off = std::min(pull_off, s.force_w_nn.z());
        law_pull_off = std::min(law_pull_off, exact.force_nn);
        const bool in = s.branch == Branch::kContact || s.branch == Branch::kNonContact;
        const bool law_in = exact.branch == Branch::kContact || exact.branch == Branch::kNonContact;
        if (in != law_in || s.under_way || state.branch.bridge.present != exact.bridge) {
          ++differ;
          return;
        }
        ASSERT_NEAR(s.force_w_nn.z(), exact.force_nn, 1e-6) << "z " << z;
        ASSERT_NEAR(s.potential_aj, exact.potential_aj, 2e-6) << "z " << z;
      };
      const double top = 5.0 + 100.0 / k;
      for (double z = top; z > -top; z -= 0.01) go(z);
      for (double z = -top; z < top; z += 0.01) go(z);
      EXPECT_LE(differ, 6);  // where one of the two jumps a step earlier: four events
      EXPECT_EQ(bridges, law_bridges);
      EXPECT_NEAR(pull_off, law_pull_off, 1e-5);
      // A jump begins up to a quarter of a step late: that times the force's change, at each of four events.
      EXPECT_GE(lost, law_lost - 1e-5);
      EXPECT_LE(lost, law_lost + 4 * 0.0025 * 2.0 * std::fabs(law_pull_off));
      std::printf("law %d, k %4.1f: %d changes of the bridge, lost %.3f aJ (law %.3f)\n",
                  static_cast<int>(&p - laws), k, bridges, lost, law_lost);
    }
  }
}

// In and out of contact over waves whose fields differ from softening to softening: what the free end puts
// in, known from forces alone, is what is lost.
TEST(WetPotential, ClosedPathsLoseWhatTheyTake) {
  Compliance soft = Mat3::Identity() / 20.0;
  soft(2, 2) = 1.0 / 2.0;
  const TipSampleParameters laws[] = {with_far(moist_oxide()), held_volume(0.0)};
  for (const TipSampleParameters& p : laws) {
    const PotentialEquilibrium on(two_softenings(gentle_ground()), potential_of(p));
    const ClosedPath path(1, 10.0, 30.0);
    const Lap l = lap(on, soft, path, 0.0005);
    EXPECT_GE(l.bridges, 2);
    EXPECT_GT(l.lost, 0.0);
    const double left = std::fabs(l.work - l.stored - l.lost) / l.turnover;
    // As without bridges: an event lies within a thousandth of a step of 0.5 pm.
    EXPECT_LE(left, 1e-6);
    std::printf("%d jumps, turnover %.4g aJ, left %.2e, lost %.2e of it\n", l.jumps, l.turnover, left,
                l.lost / l.turnover);
  }
}

// Pressed and wet throughout, a bias besides: three terms, each with fields of its own, and nothing lost.
TEST(WetPotential, SmoothClosedPathsGiveAndTakeNothing) {
  TipSampleParameters p = with_far(moist_oxide());
  p.long_range.tip_bias_v = 2.0;
  const PotentialEquilibrium on(two_softenings(gentle_ground()), potential_of(p));
  for (const double step : {0.05, 0.005}) {
    const Lap l = lap(on, support::stiff_springs(), ClosedPath(2, -4.0, 0.8), step);
    EXPECT_EQ(l.jumps, 0);
    EXPECT_LE(std::fabs(l.work - l.stored - l.lost) / l.turnover, 1e-10) << step;
    EXPECT_LE(l.lost / l.turnover, 1e-6) << step;
  }
}

// Whatever the terms' own fields say, and however much dry attraction the liquid would displace.
TEST(WetPotential, FormingAndRuptureLowerU) {
  TipSampleParameters drop = held_volume(1.5);
  drop.long_range.capillary.film_nm = 1.0;
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  for (const TipSampleParameters& p : {with_far(moist_oxide()), moist(silicon_oxide(), 20.0, 0.4), drop}) {
    const TipPotential u(two_softenings(rough_ground()), potential_of(p));
    int formed = 0, refused = 0, ruptured = 0;
    const auto settle = [&](const Vec3& at, PotentialBranch& branch, PotentialSample& sample) {
      for (int i = 0; i < TipPotential::kMostEnds; ++i) {
        CurveHint hint;
        const BranchEnd end = u.sample(at, branch, hint, sample);
        if (end == BranchEnd::kNone) return;
        branch = u.beyond(end, at, branch, sample);
      }
      ADD_FAILURE() << "no branch at " << at.transpose();
    };
    for (int i = 0; i < 20000; ++i) {
      ContactJet ground;
      const Vec3 level(30 * any(random), 30 * any(random), 0);
      u.fields().contact_at(level, ground);
      const Vec3 at = level + Vec3(0, 0, -ground.overlap_nm / ground.overlap_grad.z() + 2.0 * any(random));
      PotentialSample dry, wet, after;
      CurveHint hint;
      PotentialBranch branch;
      const BranchEnd end = u.sample(at, branch, hint, dry);
      if (end == BranchEnd::kContact) continue;
      PotentialBranch next = branch;
      settle(at, next, after);
      const BridgePotential& bridge = u.potential().bridge();
      if (next.bridge.present) {
        ++formed;
        EXPECT_LT(after.energy_aj, dry.energy_aj) << at.transpose();
      } else if (-dry.place.overlap_nm < 0.5 * -bridge.formation_overlap_nm(dry.place.log_radius)) {
        ++refused;
      }
      branch.bridge = bridge.formed_at(0.0, std::log(20.0));
      hint = {};
      if (u.sample(at, branch, hint, wet) != BranchEnd::kBridge) continue;
      ++ruptured;
      settle(at, branch, after);
      EXPECT_FALSE(branch.bridge.present);
      EXPECT_LT(after.energy_aj, wet.energy_aj) << at.transpose();
    }
    std::printf("%d formed, %d refused, %d ruptured\n", formed, refused, ruptured);
    EXPECT_GT(formed, 100);
    EXPECT_GT(ruptured, 100);
  }
}

// Any springs, any motion: no step without an end, none that gives energy, and the tip is where its branch
// is.
TEST(WetPotential, EveryStepEndsInAMinimumOrOnItsWayDown) {
  std::mt19937_64 random(17);
  std::uniform_real_distribution<double> any(0.0, 1.0);
  FrictionParameters jerky = rough_contact();
  jerky.kinetic_ratio = 0.6;
  const auto moist_potential = potential_of(with_far(moist_oxide()));
  const PotentialEquilibrium grounds[] = {{two_softenings(gentle_ground()), moist_potential},
                                          {two_softenings(rough_ground()), moist_potential},
                                          {two_softenings(rough_ground()), potential_of(held_volume(0.0))},
                                          {two_softenings(rough_ground()), moist_potential, rough_contact()},
                                          {two_softenings(gentle_ground()), moist_potential, jerky}};
  int interrupted = 0, steps = 0, changes = 0;
  for (int motion = 0; motion < 150; ++motion) {
    const PotentialEquilibrium& on = grounds[motion % 5];
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
      if (i % 50 == 0) v = Vec3(any(random) - 0.5, any(random) - 0.5, any(random) - 0.6).normalized() * step;
      if (x.z() < low) v.z() = std::fabs(v.z());
      if (x.z() > 12.0) v.z() = -std::fabs(v.z());
      const Vec3 apex = state.apex_w_nm;
      const bool wet = state.branch.bridge.present;
      x += v;
      s = on.advance(x, c, state);
      ++steps;
      changes += wet != state.branch.bridge.present;
      ASSERT_EQ(s.status, SolveStatus::kOk);
      ASSERT_GE(s.dissipated_aj, 0.0);
      ASSERT_GE(s.friction_dissipated_aj, 0.0);
      CurveHint hint;
      PotentialSample at;
      ASSERT_EQ(on.tip_potential().sample(s.apex_w_nm, state.branch, hint, at), BranchEnd::kNone)
          << "motion " << motion << " step " << i;
      run = s.under_way ? run + 1 : 0;
      interrupted += s.under_way;
      ASSERT_LT(run, 50) << "motion " << motion;
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
  std::printf("%d steps, %d interrupted, %d bridges formed or ruptured\n", steps, interrupted, changes);
  EXPECT_LT(interrupted, steps / 50);
  EXPECT_GT(changes, 100);
}

// Stick–slip on level ground, against the sawtooth of a spring in series with the contact: it holds up to T,
// lets go to r T, and so on; the work put in is what is lost.
TEST(StickSlip, IsASawtoothBetweenTheTwoLimits) {
  FrictionParameters jerky = rough_contact();
  jerky.kinetic_ratio = 0.6;
  const PotentialEquilibrium on(std::make_shared<EggCrate>(), potential_of(silicon_oxide()), jerky);
  const Compliance c = Mat3::Identity() / 5.0;
  PotentialState state;
  Vec3 last(0, 0, 10);
  TipSolution s = on.advance(last, c, state);
  double most = 0, least = 1e9, work = 0, lost = 0;
  int slips = 0;
  for (double z = 9.9; z > -2.0; z -= 0.05) s = on.advance(last = Vec3(0, 0, z), c, state);
  s = on.advance(last = Vec3(0, 0, -2.0), c, state);
  double begin = stored(s, c);
  for (int i = 1; i <= 60000; ++i) {
    const Vec3 x(0.001 * i, 0, -2.0);
    const Vec3 before = s.force_w_nn;
    s = on.advance(x, c, state);
    ASSERT_FALSE(s.under_way);
    ASSERT_GE(s.friction_dissipated_aj, 0.0);
    if (i > 20000) {
      work -= 0.5 * (before + s.force_w_nn).dot(x - last);
      lost += s.dissipated_aj + s.friction_dissipated_aj;
      most = std::max(most, -s.force_w_nn.x());
      least = std::min(least, -s.force_w_nn.x());
      slips += s.jumps == 0 && -s.force_w_nn.x() < -before.x() - 1.0;
    } else {
      begin = stored(s, c);
    }
    last = x;
  }
  const double a = s.contact_radius_nm;
  const double limit = jerky.shear_strength_gpa * 3.14159265358979 * a * a;
  // A step of 1 pm on a spring of 5 N/m is 5 pN.
  EXPECT_NEAR(most, limit, 0.006);
  EXPECT_NEAR(least, 0.6 * limit, 0.006);
  // In series with the contact's 8 G* a: as many teeth as the 40 nm hold.
  const double k = 1.0 / (0.2 + 1.0 / (8.0 * jerky.shear_modulus_gpa * a));
  EXPECT_NEAR(slips, 40.0 / (0.4 * limit / k), 1.5);
  // Trapezia over a step in which it lets go: half of 1 pm times the drop, each.
  EXPECT_NEAR(work, lost + stored(s, c) - begin, slips * 0.0006 * limit);
}

}  // namespace
}  // namespace telenano::physics
