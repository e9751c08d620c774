#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/particle/particle_bristle.h"
#include "telenano/nve_server/physics/particle/particle_equilibrium.h"
#include "telenano/nve_server/physics/surface/flat_surface.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"
#include "tests/support/alloc_guard.h"
#include "tests/support/contact_paths.h"
#include "tests/support/particle_grounds.h"

namespace telenano::physics {
namespace {

using telenano::support::AllocGuard;
using telenano::testing::material_of;

constexpr double kTip = 15;
constexpr double kParticle = 20;
// Maugis–Dugdale at lambda = 1 with 50 digits, without dimensions: at zero load, and under load control.
constexpr double kRestRadius = 1.636090490;
constexpr double kRestOverlap = 1.129893891;
constexpr double kPullOff = 1.600734911;
constexpr double kDigits = 3e-9;  // of those numbers

// lambda = 1 between particle and sample; no attraction beyond the Dugdale range, so that a tip far off is
// not felt; the tip neither sticks (much) nor rubs.
ParticleParameters plain() {
  ParticleParameters p;
  p.tip_radius_nm = kTip;
  p.particle_radius_nm = kParticle;
  p.particle_sample = material_of(1.0, false);
  p.tip_particle = p.particle_sample;
  p.tip_particle.work_of_adhesion_n_m = 1e-3;
  p.tip_sample = p.tip_particle;
  p.drag_n_s_m = 1e-12;
  return p;
}

ParticleEquilibrium on_level(const ParticleParameters& p) {
  return {std::make_shared<FlatSurface>(), p, support::level_ground(p)};
}

HeightGrid sampled(int n, double spacing, const std::function<double(double, double)>& height) {
  HeightGrid grid{n, n, spacing, spacing, 0, 0, {}};
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) grid.z_nm.push_back(height(column * spacing, row * spacing));
  }
  return grid;
}

ParticleEquilibrium on(const HeightGrid& grid, const ParticleParameters& p) {
  return {std::make_shared<SplineSurface>(grid), p, support::ground_on(grid, p)};
}

const Compliance kSprings = Vec3(0.05, 0.05, 0.075).asDiagonal();

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

TEST(Particle, RestsWhereItsAdhesionHoldsIt) {
  const ParticleEquilibrium scene = on_level(plain());
  ParticleState state = scene.place(3, -4);
  const ContactScales s = scene.model().laws[kParticleSample].scales(kParticle);
  EXPECT_NEAR(s.lambda, 1.0, 1e-12);
  const Vec3 rest(3, -4, kParticle - kRestOverlap * s.overlap_nm);
  EXPECT_LT((state.particle_centre_w_nm - rest).norm(), kDigits * s.overlap_nm);
  for (int i = 0; i < 100; ++i) {
    const ParticleSolution solution = scene.advance(Vec3(-100 + i, 0, 50), kSprings, 1e-3, state);
    ASSERT_EQ(solution.status, SolveStatus::kOk);
    EXPECT_EQ(solution.tip.force_w_nn, Vec3::Zero());
    EXPECT_LT(solution.dissipated_aj, 1e-30);  // of drag, for the last bit of the place
    EXPECT_TRUE(solution.on_surface);
    EXPECT_FALSE(solution.held_by_tip);
    const ParticleContactReport& contact = solution.contacts[kParticleSample];
    EXPECT_LT(contact.force_w_nn.norm(), 1e-9 * s.force_nn);  // the balance's own tolerance
    EXPECT_NEAR(contact.contact_radius_nm, kRestRadius * s.length_nm, kDigits * s.length_nm);
  }
  EXPECT_LT((state.particle_centre_w_nm - rest).norm(), 2 * kDigits * s.overlap_nm);
}

// Van der Waals between all, friction that holds: what a tip feels of a particle far away.
ParticleParameters felt_from_afar() {
  ParticleParameters p;
  p.tip_radius_nm = kTip;
  p.particle_radius_nm = kParticle;
  p.particle_sample = p.tip_particle = p.tip_sample = material_of(1.0, true);
  p.particle_sample_friction = {0.03, 8.0, 0.3};
  p.tip_particle_friction = p.particle_sample_friction;
  p.tip_sample_friction = {0.3, 8.0, 0.0};
  return p;
}

// A particle that sleeps where it can, and one that never does, under the same tip: to and fro far away,
// pressed on the ground, up to a nanometre from the particle, away, by and by. The forces differ by less than
// the bound that is stated; what the particle itself does by less than its contact yields under the pull at
// which it wakes: 1e-4 F_c on the rolling bristle, of 4 F_c/R, are 2.5e-5 R.
TEST(Particle, AsleepIsFeltAsAwake) {
  ParticleParameters p = felt_from_afar();
  const ParticleEquilibrium sleeper = on_level(p);
  p.sleeps = false;
  const ParticleEquilibrium watcher = on_level(p);
  ParticleState a = sleeper.place(0, 0), b = watcher.place(0, 0);
  const double pull_off = sleeper.model().pull_off_nn[kParticleSample];
  int slept = 0, woke = 0, steps = 0;
  double worst = 0;
  const auto to = [&](const Vec3& from, const Vec3& end, int count) {
    for (int i = 1; i <= count; ++i, ++steps) {
      const Vec3 at = from + (end - from) * i / count;
      const bool was_asleep = a.sleep.asleep;
      const ParticleSolution s = sleeper.advance(at, kSprings, 1e-3, a);
      const ParticleSolution t = watcher.advance(at, kSprings, 1e-3, b);
      ASSERT_EQ(s.status, SolveStatus::kOk) << at.transpose();
      ASSERT_EQ(t.status, SolveStatus::kOk) << at.transpose();
      ASSERT_FALSE(b.sleep.asleep);
      slept += a.sleep.asleep;
      woke += was_asleep && !a.sleep.asleep;
      worst = std::max(worst, (s.tip.force_w_nn - t.tip.force_w_nn).norm());
      ASSERT_LT((s.tip.force_w_nn - t.tip.force_w_nn).norm(), kSleepError * pull_off) << at.transpose();
      ASSERT_LT((s.particle_centre_w_nm - t.particle_centre_w_nm).norm(), 2.5e-5 * kParticle);
      ASSERT_EQ(s.on_surface, t.on_surface);
      ASSERT_EQ(s.held_by_tip, t.held_by_tip);
      ASSERT_NEAR(s.tip.potential_aj, t.tip.potential_aj, 1e-6 * pull_off);
      ASSERT_NEAR(s.contacts[kParticleSample].contact_radius_nm,
                  t.contacts[kParticleSample].contact_radius_nm, 1e-4);
    }
  };
  const Vec3 far(-150, 20, 40), ground(-150, 20, -1.5), by(-120, 60, -1.5), up(-120, 60, 30);
  const Vec3 near(-kTip - kParticle - 1, 0, 5), high(0, 0, 120);
  for (int round = 0; round < 3; ++round) {
    to(far, ground, 60);
    to(ground, by, 100);
    to(by, up, 60);
    to(up, near, 150);
    to(near, up, 150);
    to(up, high, 100);
    to(high, far, 100);
  }
  EXPECT_GT(slept, steps / 2);
  EXPECT_GE(woke, 3);
  EXPECT_GT(worst, 0);
}

// What sleeps is left where it lies, to the last bit; a new state is awake, so is one that is woken; and a
// particle that nothing holds runs after any pull and does not sleep.
TEST(Particle, SleepsOnlyWhereItIsHeld) {
  const ParticleEquilibrium held = on_level(felt_from_afar());
  ParticleState state = held.place(0, 0);
  EXPECT_FALSE(state.sleep.asleep);
  for (int i = 0; i < 5; ++i) held.advance(Vec3(-150 + i, 0, 30), kSprings, 1e-3, state);
  ASSERT_TRUE(state.sleep.asleep);
  const Vec3 lies = state.particle_centre_w_nm;
  held.advance(Vec3(-130, 3, 20), kSprings, 1e-3, state);
  EXPECT_TRUE(state.sleep.asleep);
  EXPECT_EQ(state.particle_centre_w_nm, lies);
  ParticleEquilibrium::wake(state);
  ParticleState awake = state;
  EXPECT_FALSE(awake.sleep.asleep);
  // One long step to a nanometre away finds it awake at the end.
  held.advance(Vec3(-kTip - kParticle - 1, 0, 5), kSprings, 1e-3, state);
  EXPECT_FALSE(state.sleep.asleep);
  EXPECT_NE(state.particle_centre_w_nm, lies);

  ParticleParameters loose = felt_from_afar();
  loose.particle_sample_friction = {};
  const ParticleEquilibrium free = on_level(loose);
  state = free.place(0, 0);
  for (int i = 0; i < 5; ++i) {
    free.advance(Vec3(-60 - i, 0, 10), kSprings, 1e-3, state);
    EXPECT_FALSE(state.sleep.asleep);
  }
  EXPECT_LT(state.particle_centre_w_nm.x(), 0);
}

// Held sideways by the sliding bristle and, since the push passes a radius above it, by the rolling one:
// springs in a row with the tip's and the tip–particle contact's.
TEST(Particle, FirstGivesWayLikeSpringsInARow) {
  ParticleParameters p = plain();
  p.particle_sample_friction = {1.0, 8.0, 1.0};
  Push push(p);
  push.to(-kTip - kParticle + 0.3, 0.01);
  const ParticleSolution before = push.to(push.x_nm + 1e-4, 1e-4);
  const ParticleSolution after = push.to(push.x_nm + 1e-4, 1e-4);
  const ContactScales s = push.scene.model().laws[kParticleSample].scales(kParticle);
  const double slide = 8.0 * 8.0 * kRestRadius * s.length_nm;
  const double roll = 4.0 * kPullOff * s.force_nn / kParticle;
  const double contact =
      0.5 * (before.contacts[kTipParticle].stiffness_n_m + after.contacts[kTipParticle].stiffness_n_m);
  const double in_a_row = 1.0 / (kSprings(0, 0) + 1.0 / contact + 1.0 / slide + 1.0 / roll);
  ASSERT_FALSE(after.contacts[kParticleSample].slides || after.contacts[kParticleSample].rolls);
  // 1e-4 nm of the contact's curvature, and 1e-9 of the force over that step.
  EXPECT_NEAR((before.tip.force_w_nn.x() - after.tip.force_w_nn.x()) / 1e-4, in_a_row, 1e-4 * in_a_row);
  EXPECT_LT(after.dissipated_aj, 1e-12);
}

TEST(Particle, SlidesAtTheShearStrengthOfItsContact) {
  ParticleParameters p = plain();
  p.particle_sample_friction = {0.02, 8.0, 10.0};  // rolling would take 128 nN
  Push push(p);
  const ParticleSolution s = push.to(10, 0.1);
  const Vec3 from = s.particle_centre_w_nm;
  const ParticleSolution t = push.to(20, 0.1);
  const double a = kRestRadius * push.scene.model().laws[kParticleSample].scales(kParticle).length_nm;
  const double limit = 0.02 * M_PI * a * a;
  EXPECT_TRUE(t.contacts[kParticleSample].slides);
  EXPECT_FALSE(t.contacts[kParticleSample].rolls);
  EXPECT_NEAR(-t.tip.force_w_nn.x(), limit, 1e-6 * limit);  // the drag is 1e-10 nN
  EXPECT_LT(std::hypot(t.tip.force_w_nn.y(), t.tip.force_w_nn.z()), 1e-6 * limit);
  EXPECT_LT((t.particle_centre_w_nm - from - Vec3(10, 0, 0)).norm(), 1e-6);
  EXPECT_LT(t.turned_w_rad.norm(), 1e-9);  // it slides, the rolling bristle stays as it is
  EXPECT_NEAR(t.dissipated_aj, limit * 0.1, 1e-6 * limit);
}

TEST(Particle, RollsWhenThatIsEasier) {
  ParticleParameters p = plain();
  p.particle_sample_friction = {1.0, 8.0, 0.3};
  Push push(p);
  const ParticleSolution s = push.to(10, 0.1);
  const ContactScales scales = push.scene.model().laws[kParticleSample].scales(kParticle);
  const double limit = 4.0 * kPullOff * scales.force_nn * 0.3 / kParticle;  // M/R
  EXPECT_TRUE(s.contacts[kParticleSample].rolls);
  EXPECT_FALSE(s.contacts[kParticleSample].slides);
  EXPECT_NEAR(-s.tip.force_w_nn.x(), limit, 1e-6 * limit);
  const Vec3 from = s.particle_centre_w_nm;
  const double turned = push.state.turned_w_rad.y();
  const ParticleSolution t = push.to(20, 0.1);
  EXPECT_NEAR(t.particle_centre_w_nm.x() - from.x(), 10, 1e-6);
  EXPECT_NEAR(push.state.turned_w_rad.y() - turned, 10 / kParticle, 1e-7);  // v = ωR
  EXPECT_NEAR(t.dissipated_aj, limit * 0.1, 1e-6 * limit);
}

// Out and back in steps of 1e-4 nm, sticking, slipping, rolling: the work of the tip's force is what is
// stored and lost.
TEST(Particle, WorkIsStoredOrLostToMillionths) {
  ParticleParameters p = plain();
  p.particle_sample_friction = {0.3, 8.0, 0.3};
  p.tip_particle_friction = {0.1, 8.0, 0.2};
  const ParticleEquilibrium scene(on_level(p));
  ParticleState state = scene.place(0, 0);
  const double z = state.particle_centre_w_nm.z() - kTip;
  const auto at = [&](double t) {
    return Vec3(-35.0 + 2.0 * std::sin(3 * t), 0.3 * std::sin(2 * t), z + 0.2 * t);
  };
  const auto stored = [](const ParticleSolution& s) {
    return s.tip.potential_aj + 0.5 * s.tip.force_w_nn.dot(kSprings * s.tip.force_w_nn);
  };
  ParticleSolution s = scene.advance(at(0), kSprings, 1e-3, state);
  const double start = stored(s);
  double work = 0, size = 0, lost = 0, slipped = 0;
  constexpr int kSteps = 40000;
  for (int i = 1; i <= kSteps; ++i) {
    const Vec3 force = s.tip.force_w_nn;
    s = scene.advance(at(1.5 * i / kSteps), kSprings, 1e-3, state);
    ASSERT_EQ(s.status, SolveStatus::kOk);
    const double d = -0.5 * (force + s.tip.force_w_nn).dot(at(1.5 * i / kSteps) - at(1.5 * (i - 1) / kSteps));
    work += d;
    size += std::abs(d);
    lost += s.dissipated_aj;
    slipped += s.friction_loss_aj;
  }
  EXPECT_GT(slipped, 0.5 * size);
  // 3e-6: friction is taken at the end of a step, so the error is of first order while its limit changes.
  EXPECT_NEAR(work, stored(s) - start + lost, 5e-6 * size);
}

// With friction at the tip the rolling surface rubs along it: up the tip's side, at its own limit, which
// presses the particle down or up and so has a part in the limits below.
TEST(Particle, RollsAgainstTheFrictionOfTheTip) {
  ParticleParameters p = plain();
  p.particle_sample_friction = {1.0, 8.0, 0.3};
  p.tip_particle_friction = {0.1, 8.0, 0.0};
  Push push(p);
  const ParticleSolution s = push.to(20, 0.1);
  const ParticleContactReport& tip = s.contacts[kTipParticle];
  const ParticleContactReport& floor = s.contacts[kParticleSample];
  ASSERT_TRUE(tip.slides && floor.rolls && !floor.slides);
  const ContactScales scales = push.scene.model().laws[kParticleSample].scales(kParticle);
  const double spread = floor.contact_radius_nm / (kRestRadius * scales.length_nm);
  const double moment = 4.0 * kPullOff * scales.force_nn * 0.3 * std::pow(spread, 1.5);
  const double rub = 0.1 * M_PI * tip.contact_radius_nm * tip.contact_radius_nm;
  EXPECT_NEAR(tip.friction_w_nn.norm(), rub, 1e-6 * rub);
  EXPECT_NEAR(floor.rolling_w_nn_nm.norm(), moment, 1e-6 * moment);
  // About the centre: floor·R = M + rub·R. The tip is not quite level with the particle, which the torque
  // does not see.
  EXPECT_NEAR(floor.friction_w_nn.norm(), moment / kParticle + rub, 1e-6 * rub);
  EXPECT_GT(rub, 0.05);
}

// What the particle feels adds up: to nothing but drag, force and torque; the springs hold the tip.
TEST(Particle, ForcesAndTorquesBalance) {
  ParticleParameters p = plain();
  for (TipSampleParameters* law : {&p.tip_particle, &p.tip_sample, &p.particle_sample}) {
    law->van_der_waals = true;
  }
  p.tip_particle.work_of_adhesion_n_m = 0.05;
  p.tip_sample_friction = {0.1, 8.0, 0.0};
  p.tip_particle_friction = {0.1, 8.0, 0.2};
  p.particle_sample_friction = {0.1, 8.0, 0.3};
  const auto surface =
      sampled(161, 1.0, [](double x, double y) { return std::sin(0.09 * x) + 1.5 * std::cos(0.07 * y); });
  const ParticleEquilibrium scene = on(surface, p);
  ParticleState state = scene.place(80, 80);
  const double floor = state.particle_centre_w_nm.z() - kParticle;
  int held = 0;
  for (int i = 0; i < 3000; ++i) {
    const double t = i * 1e-3;
    const Vec3 end(80 - 38 + 20 * t, 80 + 5 * std::sin(3 * t), floor + 5 + 8 * std::cos(2 * t));
    const Vec3 centre_before = state.particle_centre_w_nm;
    const ParticleSolution s = scene.advance(end, kSprings, 1e-3, state);
    ASSERT_EQ(s.status, SolveStatus::kOk) << i;
    const ParticleContactReport& tip = s.contacts[kTipParticle];
    const ParticleContactReport& ground = s.contacts[kParticleSample];
    const double load = tip.force_w_nn.norm() + ground.force_w_nn.norm() + 30.0;  // with the pull-offs
    const double drag = p.drag_n_s_m * (s.particle_centre_w_nm - centre_before).norm() / 1e-3;
    // 1e-9 asked for; 1e-6 where rounding stops the descent earlier.
    EXPECT_LT((tip.force_w_nn + ground.force_w_nn).norm(), 1e-6 * load + drag) << i;
    EXPECT_LT((s.tip.force_w_nn - s.contacts[kTipSample].force_w_nn + tip.force_w_nn).norm(), 1e-6 * load);
    EXPECT_LT((s.tip.apex_w_nm - end - kSprings * s.tip.force_w_nn).norm(), 1e-9);
    const Vec3 torque = -kParticle * (tip.normal_w.cross(tip.friction_w_nn) +
                                      ground.normal_w.normalized().cross(ground.friction_w_nn)) +
                        tip.rolling_w_nn_nm + tip.spinning_w_nn_nm + ground.rolling_w_nn_nm +
                        ground.spinning_w_nn_nm;
    EXPECT_LT(torque.norm(), 1e-6 * load * kParticle) << i;
    // Friction lies in the plane of contact.
    EXPECT_LT(std::abs(tip.friction_w_nn.dot(tip.normal_w)), 1e-6 * load);
    if (s.held_by_tip) ++held;
  }
  EXPECT_GT(held, 500);
}

// The tip comes down on the particle, presses and goes up: the stronger contact keeps it.
TEST(Particle, IsPickedUpByTheStrongerContactAndPutDownAgain) {
  for (const double w : {0.15, 0.35}) {
    ParticleParameters p = plain();
    p.tip_particle.work_of_adhesion_n_m = w;
    p.tip_particle_friction = {0.1, 8.0, 0.2};
    p.particle_sample_friction = {0.1, 8.0, 0.2};
    const ParticleEquilibrium scene(on_level(p));
    const double pull_tip = scene.model().pull_off_nn[kTipParticle];
    const double pull_floor = scene.model().pull_off_nn[kParticleSample];
    const bool stronger = pull_tip > pull_floor;
    EXPECT_EQ(stronger, w == 0.35);
    ParticleState state = scene.place(0, 0);
    const double top = 2 * state.particle_centre_w_nm.z();
    ParticleSolution s;
    double least = 0;
    for (double z = top + 3; z > top - 2; z -= 0.01) {
      s = scene.advance(Vec3(0.5, 0, z), kSprings, 1e-3, state);
      ASSERT_EQ(s.status, SolveStatus::kOk);
    }
    EXPECT_TRUE(s.held_by_tip && s.on_surface);
    for (double z = top - 2; z < top + 40; z += 0.01) {
      s = scene.advance(Vec3(0.5, 0, z), kSprings, 1e-3, state);
      ASSERT_EQ(s.status, SolveStatus::kOk);
      least = std::min(least, s.tip.force_w_nn.z());
    }
    EXPECT_EQ(s.held_by_tip, stronger);
    EXPECT_EQ(s.on_surface, !stronger);
    // It took the weaker pull-off: less by what one step of 0.01 nm at 13 N/m misses, and by the tilt.
    EXPECT_NEAR(-least, std::min(pull_tip, pull_floor), 0.15);
    EXPECT_EQ(s.particle_centre_w_nm.z() - kParticle > 30, stronger);
  }
}

// Pushed off its centre the particle swerves: to the other side, as in the mirror, and alike in any
// direction.
TEST(Particle, SwervesAwayAlikeInAllDirections) {
  ParticleParameters p = plain();
  p.particle_sample_friction = {0.02, 8.0, 0.3};
  p.tip_particle_friction = {0.01, 8.0, 0.1};
  const ParticleEquilibrium scene(on_level(p));
  const auto run = [&](double aside, double angle) {
    ParticleState state = scene.place(0, 0);
    const double z = state.particle_centre_w_nm.z() - kTip;
    const Mat3 turn = Eigen::AngleAxisd(angle, Vec3::UnitZ()).toRotationMatrix();
    const Compliance springs = Vec3(0.05, 0.05, 0.075).asDiagonal();
    for (int i = 0; i < 400; ++i) {
      const Vec3 end = turn * Vec3(-40 + 0.2 * i, aside, z);
      EXPECT_EQ(scene.advance(end, springs, 1e-3, state).status, SolveStatus::kOk);
    }
    return Vec3(turn.transpose() * state.particle_centre_w_nm);
  };
  const Vec3 straight = run(0, 0);
  EXPECT_NEAR(straight.y(), 0, 1e-9);
  EXPECT_GT(straight.x(), 60);
  const Vec3 right = run(3, 0);
  EXPECT_LT(right.y(), -10);  // gone aside
  const Vec3 left = run(-3, 0);
  // The swerve is an instability: what a step leaves open, 1e-9 of the forces, grows with the way.
  EXPECT_LT((left - Vec3(right.x(), -right.y(), right.z())).norm(), 1e-4);
  for (const double angle : {0.7, 2.0, 4.0}) EXPECT_LT((run(3, angle) - right).norm(), 1e-4) << angle;
  EXPECT_EQ(run(3, 0.7), run(3, 0.7));
}

// In a groove narrower than the particle it stands on both flanks; pushed along it goes straight.
TEST(Particle, StandsOnBothFlanksOfAGroove) {
  const auto surface =
      sampled(161, 1.0, [](double x, double) { return 10 * (1 - 1 / (1 + (x - 80) * (x - 80) / 36)); });
  ParticleParameters p = plain();
  p.particle_sample_friction = {0.02, 8.0, 0.3};
  const ParticleEquilibrium scene = on(surface, p);
  ParticleState state = scene.place(80.3, 80);
  const double z = state.particle_centre_w_nm.z() + 8;
  ParticleSolution s;
  for (double y = 40; y < 90; y += 0.1) {
    s = scene.advance(Vec3(80, y, z - kTip), kSprings, 1e-3, state);
    ASSERT_EQ(s.status, SolveStatus::kOk) << y;
  }
  EXPECT_NEAR(s.particle_centre_w_nm.x(), 80, 0.5);
  EXPECT_GT(s.particle_centre_w_nm.y(), 100);
  EXPECT_GT(s.contacts[kParticleSample].normal_force_nn, 0);
}

// Up against a step, pushed from behind: it weighs nothing, so it rolls over the edge; it never goes through.
TEST(Particle, NeverGoesThroughAStep) {
  const auto surface = sampled(201, 1.0, [](double x, double) { return x < 110 ? 0.0 : 12.0; });
  ParticleParameters p = plain();
  p.tip_particle.work_of_adhesion_n_m = 0.02;
  p.particle_sample_friction = {0.05, 8.0, 0.3};
  p.tip_particle_friction = {0.02, 8.0, 0.1};
  const ParticleEquilibrium scene = on(surface, p);
  ParticleState state = scene.place(70, 100);
  int not_converged = 0;
  for (double x = 30; x < 150; x += 0.5) {
    const ParticleSolution s =
        scene.advance(Vec3(x, 100.0, std::max(5.0, 5 + (x - 70) * 0.5)), kSprings, 1e-3, state);
    if (s.status != SolveStatus::kOk) {
      ++not_converged;
      continue;
    }
    // Above the ground as the dilation by a ball of its radius has it: an oracle beside the fields.
    const Vec3& centre = state.particle_centre_w_nm;
    double nearest = HUGE_VAL;
    for (double at = centre.x() - 40; at < centre.x() + 40; at += 0.25) {
      nearest = std::min(nearest, std::hypot(at - centre.x(), (at < 110 ? 0.0 : 12.0) - centre.z()));
    }
    ASSERT_GT(nearest, kParticle - 3) << x;
    ASSERT_GT((state.particle_centre_w_nm - state.tip_centre_w_nm).norm(), kParticle + kTip - 3) << x;
  }
  EXPECT_EQ(not_converged, 0);
  EXPECT_GT(state.particle_centre_w_nm.x(), 130);
  const double rest = scene.place(180, 100).particle_centre_w_nm.z();
  EXPECT_NEAR(state.particle_centre_w_nm.z(), rest, 0.02);  // on the terrace, pressed by less than a nN
}

// An independent way to the same path: explicit Euler in the plane, with Hertz contacts and bristles written
// for two dimensions, small steps.
class ExplicitPlane {
 public:
  ExplicitPlane(double k_gpa, double tau, double g, double drag, double start_z)
      : k_gpa_(k_gpa), tau_(tau), g_(g), drag_(drag), z(start_z) {}
  void step(double tip_x, double tip_z, double dt) {
    double fx = 0, fz = 0, torque = 0;
    const double floor = kParticle - z;
    if (floor > 0) {
      const double a = std::sqrt(kParticle * floor);
      fz += k_gpa_ * a * floor;
      const double friction =
          bend(floor_bristle_, floor_k_, x - last_x_ - kParticle * (turn - last_turn_), a);
      fx -= friction;
      torque += kParticle * friction;
    } else {
      floor_bristle_ = floor_k_ = 0;
    }
    const double dx = x - tip_x, dz = z - tip_z, r = std::hypot(dx, dz);
    const double nx = dx / r, nz = dz / r, overlap = kTip + kParticle - r;
    if (overlap > 0) {
      const double radius = kTip * kParticle / (kTip + kParticle);
      const double a = std::sqrt(radius * overlap);
      const double normal = k_gpa_ * a * overlap;
      // Tangent (−n_z, n_x); turning by φ about y moves the particle's surface at −R n by φ ŷ × (−R n).
      const double moved = -nz * (x - last_x_ - (tip_x - last_tip_x_)) +
                           nx * (z - last_z_ - (tip_z - last_tip_z_)) + kParticle * (turn - last_turn_);
      const double friction = bend(tip_bristle_, tip_k_, moved, a);
      fx += normal * nx + friction * nz;
      fz += normal * nz - friction * nx;
      torque -= kParticle * friction;
    } else {
      tip_bristle_ = tip_k_ = 0;
    }
    last_x_ = x, last_z_ = z, last_turn_ = turn, last_tip_x_ = tip_x, last_tip_z_ = tip_z;
    x += dt * fx / drag_;
    z += dt * fz / drag_;
    turn += dt * torque / (drag_ * kParticle * kParticle);
  }

 private:
  double bend(double& s, double& k_before, double moved, double a) const {
    const double k = 8 * g_ * a;
    if (k > k_before) s *= k_before / k;
    k_before = k;
    const double reach = tau_ * M_PI * a * a / k;
    s = std::clamp(s + moved, -reach, reach);
    return k * s;
  }
  double k_gpa_, tau_, g_, drag_;
  double floor_bristle_ = 0, floor_k_ = 0, tip_bristle_ = 0, tip_k_ = 0;
  double last_x_ = 0, last_z_ = 0, last_turn_ = 0, last_tip_x_ = 0, last_tip_z_ = 0;

 public:
  double x = 0, z = 0, turn = 0;
};

TEST(Particle, GoesTheWayOfAnExplicitIntegration) {
  constexpr double kModulus = 20, kShear = 0.05, kG = 4, kDrag = 2e-2, kEnd_s = 0.06;
  ParticleParameters p = plain();
  for (TipSampleParameters* law : {&p.tip_particle, &p.tip_sample, &p.particle_sample}) {
    *law = {kModulus, 1e-7, 0.165, false};  // Hertz, but for 1e-5 nN
  }
  p.tip_particle_friction = p.particle_sample_friction = {kShear, kG, 0.0};
  p.drag_n_s_m = kDrag;
  const ParticleEquilibrium scene(on_level(p));
  const double start_z = scene.place(0, 0).particle_centre_w_nm.z();
  const double reach = (kTip + kParticle) / std::sqrt(2.0) + 0.1;
  const auto tip_at = [&](double t) { return Vec3(-reach + 80 * t, 0, start_z + reach - 25 * t); };

  ExplicitPlane plane(kModulus, kShear, kG, kDrag, start_z);
  // Spin has no part in the plane. 300 000 steps.
  constexpr double kSmall_s = 2e-7;
  for (int i = 1; i * kSmall_s < kEnd_s + 0.5 * kSmall_s; ++i) {
    const Vec3 tip = tip_at(i * kSmall_s);
    plane.step(tip.x(), tip.z(), kSmall_s);
  }
  EXPECT_GT(std::abs(plane.x), 0.5);
  EXPECT_GT(std::abs(plane.turn), 1e-3);
  double errors[3];
  for (int level = 0; level < 3; ++level) {
    const double dt = 5e-4 / (1 << level);
    ParticleState state = scene.place(0, 0);
    for (int i = 1; i * dt < kEnd_s + 0.5 * dt; ++i) {
      const Vec3 apex = tip_at(i * dt) - Vec3(0, 0, kTip);
      ASSERT_EQ(scene.advance(apex, Compliance::Zero(), dt, state).status, SolveStatus::kOk);
    }
    errors[level] =
        std::hypot(state.particle_centre_w_nm.x() - plane.x, state.particle_centre_w_nm.z() - plane.z) +
        kParticle * std::abs(state.turned_w_rad.y() - plane.turn);
  }
  // Of 5.7 nm and 0.013 rad. Steps of 1e-6 s leave 1e-4 nm in the explicit method, five times smaller ones a
  // fifth of it.
  EXPECT_LT(errors[0], 3e-4);
  EXPECT_LT(errors[2], 1e-4);
}

TEST(Particle, LongStepsDoNotPassThroughIt) {
  ParticleParameters p = plain();
  p.particle_sample_friction = {0.02, 8.0, 0.3};
  const ParticleEquilibrium scene(on_level(p));
  ParticleState state = scene.place(0, 0);
  const double z = state.particle_centre_w_nm.z() - kTip;
  ASSERT_EQ(scene.advance(Vec3(-500, 0, z), kSprings, 1e-3, state).status, SolveStatus::kOk);
  const ParticleSolution s = scene.advance(Vec3(500, 0, z), kSprings, 1e-3, state);
  ASSERT_EQ(s.status, SolveStatus::kOk);
  EXPECT_GT(s.particle_centre_w_nm.x(), 500 + kTip + kParticle - 3);
  EXPECT_GE(s.substeps, 285);  // the last 535 nm in eighths of the tip's radius
}

TEST(Particle, BadInputIsRefusedAndChangesNothing) {
  const ParticleEquilibrium scene = on_level(plain());
  ParticleState state = scene.place(0, 0);
  scene.advance(Vec3(-60, 0, 5), kSprings, 1e-3, state);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Vec3 tip = state.tip_centre_w_nm;
  const auto refused = [&](const Vec3& end, const Compliance& c, double dt) {
    const ParticleSolution s = scene.advance(end, c, dt, state);
    return s.status == SolveStatus::kNonFinite && s.tip.status == SolveStatus::kNonFinite &&
           s.tip.force_w_nn == Vec3::Zero() && state.tip_centre_w_nm == tip;
  };
  EXPECT_TRUE(refused(Vec3(nan, 0, 0), kSprings, 1e-3));
  EXPECT_TRUE(refused(Vec3(0, 0, 5), kSprings * nan, 1e-3));
  EXPECT_TRUE(refused(Vec3(0, 0, 5), -kSprings, 1e-3));
  EXPECT_TRUE(refused(Vec3(0, 0, 5), kSprings, 0));
  EXPECT_TRUE(refused(Vec3(0, 0, 5), kSprings, nan));
}

TEST(Particle, DescriptionsThatMakeNoSenseAreRefused) {
  const auto refused = [](const std::function<void(ParticleParameters&)>& spoil) {
    ParticleParameters p = plain();
    spoil(p);
    try {
      const ParticleEquilibrium scene(std::make_shared<FlatSurface>(), p, support::level_ground(plain()));
    } catch (const UserError& error) {
      return std::string(error.what()).find("particle: ") == 0;
    }
    return false;
  };
  EXPECT_TRUE(refused([](ParticleParameters& p) { p.particle_radius_nm = 0; }));
  EXPECT_TRUE(refused([](ParticleParameters& p) { p.tip_radius_nm = -1; }));
  EXPECT_TRUE(refused([](ParticleParameters& p) { p.drag_n_s_m = 0; }));
  EXPECT_TRUE(refused([](ParticleParameters& p) { p.tip_particle_friction.shear_strength_gpa = -1; }));
  EXPECT_TRUE(refused([](ParticleParameters& p) { p.tip_particle_friction = {1, 0, 0}; }));
  EXPECT_TRUE(refused([](ParticleParameters& p) { p.particle_sample_friction.rolling_length_nm = NAN; }));
  // Jelly: adhesion alone draws it in altogether.
  EXPECT_TRUE(refused([](ParticleParameters& p) { p.particle_sample.contact_modulus_gpa = 1e-4; }));
  EXPECT_FALSE(refused([](ParticleParameters&) {}));
}

TEST(Particle, StepsTakeNothingFromTheHeap) {
  ParticleParameters p = plain();
  p.particle_sample_friction = {0.02, 8.0, 0.3};
  const ParticleEquilibrium scene(on_level(p));
  ParticleState state = scene.place(0, 0);
  const double z = state.particle_centre_w_nm.z() - kTip;
  scene.advance(Vec3(-60, 0, z), kSprings, 1e-3, state);
  const AllocGuard guard;
  for (int i = 0; i < 100; ++i) scene.advance(Vec3(-60 + i, 0, z), kSprings, 1e-3, state);
  EXPECT_EQ(guard.allocations(), 0u);
}

// The bristle alone: the envelope's gradient and Hessian are its force and stiffness, and nothing is gained.
TEST(ParticleBristle, ForceIsTheGradientOfTheEnvelope) {
  const Bristle bristle{30.0, 6.0};
  for (const Vec3& s : {Vec3(0.1, 0.05, 0), Vec3(0.3, -0.4, 0.1), Vec3(-3, 1, 2)}) {
    const BristleResponse at = respond(bristle, s);
    for (int axis = 0; axis < 3; ++axis) {
      constexpr double kH = 1e-5;
      const BristleResponse up = respond(bristle, s + kH * Vec3::Unit(axis));
      const BristleResponse down = respond(bristle, s - kH * Vec3::Unit(axis));
      // Central differences: h² times the third derivative, some 100.
      EXPECT_NEAR((up.envelope - down.envelope) / (2 * kH), at.force[axis], 1e-7);
      EXPECT_LT(((up.force - down.force) / (2 * kH) - at.tangent.col(axis)).norm(), 1e-6);
    }
    EXPECT_LE(at.force.norm(), 6.0 * (1 + 1e-15));
    EXPECT_NEAR(at.stored, 0.5 * 30 * at.deflection.squaredNorm(), 1e-12);
    EXPECT_NEAR(at.envelope, at.stored + at.dissipated, 1e-12);
  }
}

TEST(ParticleBristle, ChangingItsStiffnessYieldsNoEnergy) {
  const Vec3 s(0.1, 0.2, -0.05);
  for (const double k : {0.0, 1.0, 9.0, 10.0, 11.0, 1000.0}) {
    const Vec3 after = carried_over(s, 10.0, k);
    EXPECT_LE(0.5 * k * after.squaredNorm(), 0.5 * 10 * s.squaredNorm() * (1 + 1e-15)) << k;
  }
}

TEST(ParticleBristle, TurnsWithThePlaneOfContact) {
  const Vec3 from = Vec3(0.1, -0.2, 1).normalized(), to = Vec3(-0.3, 0.4, 0.8).normalized();
  const Vec3 s = from.cross(Vec3(1, 2, 3));
  const Vec3 turned = transported(s, from, to);
  const Vec3 expected = Eigen::Quaterniond::FromTwoVectors(from, to) * s;
  EXPECT_LT((turned - expected).norm(), 1e-14);
  EXPECT_LT(std::abs(turned.dot(to)), 1e-14);
}

}  // namespace
}  // namespace telenano::physics
