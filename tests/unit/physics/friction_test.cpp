#include "telenano/nve_server/physics/contact/friction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/equilibrium/level_equilibrium.h"
#include "tests/support/shortest_turn.h"

namespace telenano::physics {
namespace {

constexpr double kTau = 0.2;    // GPa
constexpr double kShear = 8.0;  // G*, GPa
constexpr double kRadius = 20;

const FrictionParameters kParameters{kTau, kShear, 0.0};

Vec3 unit(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  return Vec3(normal(random), normal(random), 2 + std::abs(normal(random))).normalized();
}

// One axis, radius held: the bristle holds to T/k, then carries T; turned back it unloads over 2T/k first.
// Energy of a cycle of amplitude x0: 4 T (x0 − T/k).
TEST(Friction, SliderOnOneAxis) {
  const Friction friction(kParameters);
  const double a = 1.5, limit = kTau * kPi * a * a, k = 8 * kShear * a, slack = limit / k;
  EXPECT_NEAR(friction.limit_nn(a, 0), limit, 1e-14 * limit);
  FrictionState state = friction.move({}, Vec3::UnitZ(), Vec3(5, 0, 0), a, 1, false).after;
  EXPECT_EQ(state.extension_w_nm.norm(), 0);  // made in this step: unstressed
  double x = 0, lost = 0;
  const double x0 = 7 * slack;
  const auto go = [&](double to) {
    FrictionStep step;
    for (int i = 0; i < 700; ++i) {
      step = friction.move(state, Vec3::UnitZ(), Vec3((to - x) / (700 - i), 0, 0), a, 1, false);
      x += (to - x) / (700 - i);
      state = step.after;
      lost += step.dissipated_aj;
    }
    return step;
  };
  // 700 additions of rounded pieces.
  const double rounding = 1e-12 * limit;
  EXPECT_NEAR(go(0.999 * slack).force_w_nn.x(), -0.999 * limit, rounding);
  EXPECT_EQ(lost, 0);
  EXPECT_NEAR(go(x0).force_w_nn.x(), -limit, rounding);
  EXPECT_NEAR(lost, limit * (x0 - slack), rounding * x0);
  const double before = lost;
  EXPECT_NEAR(go(x0 - slack).force_w_nn.x(), 0, 10 * rounding);
  EXPECT_NEAR(lost, before, rounding);
  go(-x0);
  go(x0);
  EXPECT_NEAR(lost - before, 4 * limit * (x0 - slack), 10 * rounding * x0);
}

// Over random paths, turning normals and changing contacts: the header's energy identity, nothing below zero,
// the limit kept, the force in the plane.
TEST(Friction, EnergyIdentityOverRandomPaths) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> normal;
  const Friction friction({kTau, kShear, 0.3});
  FrictionState state;
  double worst = 0;
  int slipped = 0, grown = 0, shrunk = 0;
  Vec3 n = Vec3::UnitZ();
  for (int i = 0; i < 20000; ++i) {
    if (i % 3 == 0) n = (n + 0.2 * unit(random)).normalized();
    const double a = i % 50 == 49 ? 0.0 : 3 * uniform(random);
    const double load = 200 * (uniform(random) - 0.3);
    const Vec3 moved = 0.05 * Vec3(normal(random), normal(random), normal(random));
    const FrictionStep step = friction.move(state, n, moved, a, load, false);
    ASSERT_GE(step.dissipated_aj, 0);
    ASSERT_LE(step.force_w_nn.norm(), friction.limit_nn(a, load) * (1 + 1e-12));
    ASSERT_LT(std::abs(step.force_w_nn.dot(n)), 1e-12 * (1 + step.force_w_nn.norm()));
    if (state.stiffness_n_m > 0 && a > 0) {
      // Carried over, by the formulas: turned about n0 × n by an angle, scaled if grown.
      const Vec3 e0 = support::shortest_turn(state.normal_w, n) * state.extension_w_nm;
      const double k = 8 * kShear * a, k0 = state.stiffness_n_m;
      const Vec3 e1 = k > k0 ? Vec3(e0 * (k0 / k)) : e0;
      (k > k0 ? grown : shrunk)++;
      const Vec3 tangential = moved - n * n.dot(moved);
      const double work = -(-k * e1 + step.force_w_nn).dot(tangential - step.slip_w_nm) / 2 -
                          step.force_w_nn.dot(step.slip_w_nm);
      const double stored = 0.5 * k0 * state.extension_w_nm.squaredNorm();
      const double scale = stored + std::abs(work) + step.stored_aj + step.dissipated_aj;
      const double given = work + stored;
      worst = std::max(worst, std::abs(given - step.stored_aj - step.dissipated_aj) / scale);
      if (step.sliding) {
        ++slipped;
        ASSERT_LE(step.force_w_nn.dot(step.slip_w_nm), 0);
      }
    } else {
      // Nothing holds: what was stored is lost.
      EXPECT_EQ(step.stored_aj, 0);
      EXPECT_NEAR(step.dissipated_aj, 0.5 * state.stiffness_n_m * state.extension_w_nm.squaredNorm(), 1e-12);
    }
    state = step.after;
  }
  EXPECT_LT(worst, 1e-12);  // rounding of a few products
  EXPECT_GT(slipped, 1000);
  EXPECT_GT(grown, 1000);
  EXPECT_GT(shrunk, 1000);
}

// The same path seen from turned axes gives the same forces, turned.
TEST(Friction, Isotropic) {
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  const Friction friction(kParameters);
  const Mat3 turn = support::shortest_turn(Vec3(1, 2, 3), Vec3(-1, 1, 0.5));
  FrictionState here, there;
  there.normal_w = turn * here.normal_w;
  for (int i = 0; i < 2000; ++i) {
    const Vec3 n = unit(random);
    const Vec3 moved = 0.02 * Vec3(normal(random), normal(random), normal(random));
    const double a = 1 + 0.5 * std::sin(0.01 * i);
    const FrictionStep one = friction.move(here, n, moved, a, 1, false);
    const FrictionStep two = friction.move(there, turn * n, turn * moved, a, 1, false);
    // Rounding grows over the steps, and does not where slip forgets.
    ASSERT_LT((turn * one.force_w_nn - two.force_w_nn).norm(), 1e-11);
    here = one.after;
    there = two.after;
  }
}

// The tangents are the derivatives of the force: against central differences.
TEST(Friction, TangentsAreDerivatives) {
  const Friction friction({kTau, kShear, 0.3});
  const Vec3 n = Vec3(0.2, -0.3, 1).normalized();
  for (const double size : {0.002, 0.1}) {
    for (const double k0_of : {0.5, 2.0}) {
      FrictionState from;
      from.stiffness_n_m = k0_of * friction.stiffness_n_m(1.2);
      from.extension_w_nm = Vec3(size, 0, 0);
      const Vec3 moved = size * Vec3(0.3, 1, 0.2);
      const FrictionStep at = friction.move(from, n, moved, 1.2, 5, false);
      EXPECT_EQ(at.sliding, size > 0.01);
      constexpr double h = 1e-5;  // error h²: some 1e-8 of the forces over the slip's length
      for (int axis = 0; axis < 3; ++axis) {
        const Vec3 d = h * size * Vec3::Unit(axis);
        const Vec3 slope = (friction.move(from, n, moved + d, 1.2, 5, false).force_w_nn -
                            friction.move(from, n, moved - d, 1.2, 5, false).force_w_nn) /
                           (2 * h * size);
        EXPECT_LT((slope + at.stiffness_n_m.col(axis)).norm(), 1e-7 * friction.stiffness_n_m(1.2));
      }
      const Vec3 by_radius = (friction.move(from, n, moved, 1.2 + h, 5, false).force_w_nn -
                              friction.move(from, n, moved, 1.2 - h, 5, false).force_w_nn) /
                             (2 * h);
      EXPECT_LT((by_radius - at.force_per_radius_w_n_m).norm(), 1e-7 * by_radius.norm());
      const Vec3 by_load = (friction.move(from, n, moved, 1.2, 5 + h, false).force_w_nn -
                            friction.move(from, n, moved, 1.2, 5 - h, false).force_w_nn) /
                           (2 * h);
      EXPECT_LT((by_load - at.force_per_load_w).norm(), 1e-7);
    }
  }
}

TEST(Friction, RefusesWhatIsNoFriction) {
  EXPECT_THROW(Friction({-1, 8, 0}), UserError);
  EXPECT_THROW(Friction({NAN, 8, 0}), UserError);
  EXPECT_THROW(Friction({0, 8, 0}), UserError);
  EXPECT_THROW(Friction({0.1, 0, 0}), UserError);
  EXPECT_THROW(Friction({0.1, INFINITY, 0}), UserError);
  EXPECT_THROW(Friction({0.1, 8, -0.1}), UserError);
  EXPECT_THROW(Friction({0.1, 8, 0, 0}), UserError);
  EXPECT_THROW(Friction({0.1, 8, 0, 1.5}), UserError);
  EXPECT_NO_THROW(Friction({0, 8, 0.3}));
}

// --- with the tip on its springs, on a flat
// -----------------------------------------------------------------

std::shared_ptr<const TipSampleLaw> silicon_oxide() {
  return std::make_shared<TipSampleLaw>(TipSampleParameters{70.0329, 0.4, 0.165, true});
}

LevelEquilibrium flat_with(const FrictionParameters& friction) {
  return LevelEquilibrium(silicon_oxide(), kRadius, friction);
}

struct Drag {
  const LevelEquilibrium& equilibrium;
  Compliance c;
  LevelState state{};
  TipSolution s{};
  Vec3 end_w_nm = Vec3::Zero();
  double lost = 0;
  int worst_iterations = 0;
  void to(const Vec3& end) {
    s = equilibrium.advance(end, c, state);
    end_w_nm = end;
    ASSERT_EQ(s.status, SolveStatus::kOk);
    // A balance by its definition.
    EXPECT_LT((s.apex_w_nm - end - c * s.force_w_nn).norm(), 1e-12 * (1 + end.norm()));
    lost += s.friction_dissipated_aj + s.dissipated_aj;
    worst_iterations = std::max(worst_iterations, s.iterations);
  }
};

// Pulled sideways through a spring: the force rises with the stiffness of spring and contact in series,
// breaks away at τπa², stays there, and comes down the same slope when turned back; springs do not couple, so
// that the normal force is that without friction.
TEST(FrictionOnSprings, BreakawaySteadyDragAndReturn) {
  const LevelEquilibrium equilibrium = flat_with(kParameters);
  Drag drag{equilibrium, Vec3(0.05, 0.04, 0.075).asDiagonal()};
  for (double z = 3; z > -3.0001; z -= 0.1) drag.to(Vec3(0, 0, z));
  const double a = drag.s.contact_radius_nm, load = drag.s.normal_force_nn;
  EXPECT_GT(load, 20);
  const double limit = kTau * kPi * a * a;
  const double series = 1 / (0.05 + 1 / (8 * kShear * a));
  const double breakaway = limit / series;
  double x = 0;
  // The law's own 1e-9, in the radius and so in limit and stiffness.
  const double tolerance = 1e-8 * limit;
  for (; x < 0.99 * breakaway; x += 0.02 * breakaway) {
    drag.to(Vec3(x, 0, drag.end_w_nm.z()));
    EXPECT_NEAR(drag.s.friction_w_nn.x(), -series * x, tolerance);
    EXPECT_FALSE(drag.s.sliding);
  }
  for (; x < 4 * breakaway; x += 0.1 * breakaway) {
    drag.to(Vec3(x, 0, drag.end_w_nm.z()));
    if (x > 1.0001 * breakaway) {
      EXPECT_NEAR(drag.s.friction_w_nn.x(), -limit, tolerance);
      EXPECT_TRUE(drag.s.sliding);
    }
  }
  EXPECT_NEAR(drag.s.normal_force_nn, load, 1e-8 * load);
  EXPECT_NEAR(drag.s.force_w_nn.z(), load, 1e-8 * load);
  const double turned = x -= 0.1 * breakaway;
  for (; x > turned - 1.9 * breakaway; x -= 0.1 * breakaway) {
    drag.to(Vec3(x, 0, drag.end_w_nm.z()));
    EXPECT_NEAR(drag.s.friction_w_nn.x(), -limit + series * (turned - x), tolerance);
  }
  EXPECT_LE(drag.worst_iterations, 8);
}

// Cyclic: 4 F_f (x0 − F_f/k_series) a cycle, and what the free end gives is what is dissipated.
TEST(FrictionOnSprings, EnergyOfACycle) {
  const LevelEquilibrium equilibrium = flat_with(kParameters);
  Drag drag{equilibrium, Vec3(0.05, 0.04, 0.075).asDiagonal()};
  for (double z = 3; z > -3.0001; z -= 0.1) drag.to(Vec3(0, 0, z));
  const double z = drag.end_w_nm.z();
  const double limit = kTau * kPi * drag.s.contact_radius_nm * drag.s.contact_radius_nm;
  const double series = 1 / (0.05 + 1 / (8 * kShear * drag.s.contact_radius_nm));
  const double x0 = 5 * limit / series;
  for (int i = 1; i <= 100; ++i) drag.to(Vec3(x0 * i / 100, 0, z));
  drag.lost = 0;
  double work =
      0;  // backward Euler overestimates the work over the elastic stretch only: midpoints are exact
  for (int i = 1; i <= 4000; ++i) {
    const double x = x0 * (1 - (i <= 2000 ? i : 4000 - i) / 1000.0);
    const double before = drag.end_w_nm.x(), force = drag.s.force_w_nn.x();
    drag.to(Vec3(x, 0, z));
    work -= 0.5 * (force + drag.s.force_w_nn.x()) * (x - before);
  }
  const double expected = 4 * limit * (x0 - limit / series);
  EXPECT_NEAR(drag.lost, expected, 1e-8 * expected);
  // The trapezium errs only in the two steps that hold a breakaway: half a step's length times its force.
  EXPECT_NEAR(work, expected, 2 * 0.5 * (x0 / 1000) * series * (x0 / 1000));
}

// Below the limit nothing creeps.
TEST(FrictionOnSprings, NoDriftBelowTheLimit) {
  const LevelEquilibrium equilibrium = flat_with(kParameters);
  Drag drag{equilibrium, Vec3(0.05, 0.04, 0.075).asDiagonal()};
  for (double z = 3; z > -3.0001; z -= 0.1) drag.to(Vec3(0, 0, z));
  const double z = drag.end_w_nm.z();
  const Vec3 start = drag.s.apex_w_nm;
  const double a = drag.s.contact_radius_nm;
  const double breakaway = kTau * kPi * a * a * (0.05 + 1 / (8 * kShear * a));
  drag.lost = 0;
  for (int i = 1; i <= 20000; ++i) {
    const double t = 2 * kPi * i / 100.0;
    drag.to(breakaway * Vec3(0.5 * std::sin(t), 0.3 * (1 - std::cos(t)), 0) + Vec3(0, 0, z));
    EXPECT_FALSE(drag.s.sliding);
  }
  // 200 cycles: rounding of the positions, as often as there are steps.
  EXPECT_LT((drag.s.apex_w_nm - start).norm(), 1e-9);
  EXPECT_LT(drag.lost, 1e-9);
}

// Loaded and unloaded while it is pulled, y and z of the cantilever coupled: work = stored + dissipated to
// the path's own discretisation, whose error falls with the step.
TEST(FrictionOnSprings, WorkIsStoredOrDissipatedWithCoupledSprings) {
  const LevelEquilibrium equilibrium = flat_with({kTau, kShear, 0.1});
  Compliance c = Vec3(0.05, 0.06, 0.075).asDiagonal();
  c(1, 2) = c(2, 1) = 0.03;
  double error[2] = {0, 0};
  for (int fine = 0; fine < 2; ++fine) {
    const int steps = fine == 0 ? 1000 : 16000;
    Drag drag{equilibrium, c};
    for (double z = 3; z > -5.0001; z -= 0.1) drag.to(Vec3(0, 0, z));
    const double z = drag.end_w_nm.z();
    const auto stored = [&] {
      return drag.s.potential_aj + drag.s.friction_stored_aj +
             0.5 * drag.s.force_w_nn.dot(c * drag.s.force_w_nn);
    };
    const double before = stored();
    drag.lost = 0;
    double work = 0;
    for (int i = 1; i <= steps; ++i) {
      const double t = 6 * kPi * i / steps;
      const Vec3 end(6 * std::sin(t), 5 * std::sin(1.3 * t), z + 1.5 * std::sin(0.7 * t));
      const Vec3 from = drag.end_w_nm, force = drag.s.force_w_nn;
      drag.to(end);
      work -= 0.5 * (force + drag.s.force_w_nn).dot(end - from);
    }
    error[fine] = std::abs(work - (stored() - before) - drag.lost) / drag.lost;
    EXPECT_GT(drag.lost, 100);
    EXPECT_LE(drag.worst_iterations, 12);
  }
  EXPECT_LT(error[0], 1e-3);
  EXPECT_LT(error[1], error[0] / 8);  // first order would give 16, the second 256; breakaways fall anywhere
}

// A kinetic limit below the static one: a saw-tooth with the slope of the springs in series, between τπa² and
// r τπa², and the energy of every tooth, (T_s² − T_k²)/(2 k_series), dissipated.
TEST(FrictionOnSprings, StickSlipIsASawTooth) {
  FrictionParameters parameters = kParameters;
  parameters.kinetic_ratio = 0.6;
  const LevelEquilibrium equilibrium = flat_with(parameters);
  Drag drag{equilibrium, Vec3(0.05, 0.05, 0.075).asDiagonal()};
  for (double z = 3; z > -3.0001; z -= 0.1) drag.to(Vec3(0, 0, z));
  const double z = drag.end_w_nm.z(), a = drag.s.contact_radius_nm;
  const double limit = kTau * kPi * a * a, series = 1 / (0.05 + 1 / (8 * kShear * a));
  const double step = limit / series / 1000;
  drag.lost = 0;
  int teeth = 0;
  double last = 0, low = 1e9, high = 0;
  for (int i = 1; i < 8000; ++i) {
    drag.to(Vec3(i * step, 0, z));
    const double now = -drag.s.friction_w_nn.x();
    if (now < last) {
      ++teeth;
      EXPECT_NEAR(now, 0.6 * limit, 1e-7 * limit);
      EXPECT_NEAR(last, limit, 1.01e-3 * limit);  // within a step of the static limit
    } else {
      EXPECT_NEAR(now - last, series * step, 1e-7 * limit);
    }
    low = teeth > 0 ? std::min(low, now) : low;
    high = std::max(high, now);
    last = now;
  }
  EXPECT_EQ(teeth, 18);  // the first after 1000 steps, then one in some 400
  const double tooth = limit * limit * (1 - 0.36) / (2 * series);
  EXPECT_NEAR(drag.lost / teeth, tooth, 3e-3 * tooth);  // each breaks away up to a step, 1e-3, late
}

}  // namespace
}  // namespace telenano::physics
