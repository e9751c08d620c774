#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <cmath>

#include "telenano/nve_server/physics/particle/particle_equilibrium.h"
#include "tests/unit/physics/particle_scene.h"

namespace telenano::physics {
namespace {

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

}  // namespace
}  // namespace telenano::physics
