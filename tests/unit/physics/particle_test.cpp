#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <string>

#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/particle/particle_balance.h"
#include "telenano/nve_server/physics/particle/particle_equilibrium.h"
#include "tests/support/alloc_guard.h"
#include "tests/unit/physics/particle_scene.h"

namespace telenano::physics {
namespace {

using telenano::support::AllocGuard;

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

// The tip snaps in far from the particle, on a spring that gives along one tilted direction only. Rounding of the stiff
// one's force, some 1e-8 of the load, is more than a balance asks for: four in ten descents end where the jump has just been
// gone over, with no step behind it. It is one jump all the same. On a spring a thousand times less stiff, where rounding is
// nothing, small steps down the same way find one jump too, a balance from behind the jump none, and all end at one energy.
TEST(Particle, AJumpIsCountedOnceWhereRoundingEndsTheDescent) {
  constexpr double kStiff = 3e8, kLessStiff = 3e5, kSoft = 0.3;  // N/m
  constexpr double kAbove = 1, kDown = 10, kSmall = 0.1;         // nm
  ParticleParameters p = plain();
  p.tip_sample = telenano::testing::material_of(3.0, false);
  const ParticleEquilibrium scene = on_level(p);
  for (int i = 0; i < 50; ++i) {
    const double tilt = 0.1 + 0.01 * i;
    const Vec3 along(std::sin(tilt), 0, std::cos(tilt));
    const auto end = [&](double down) { return Vec3(Vec3(-60, 0, kTip) - down / along.z() * along); };
    struct Step {
      int jumps;
      double energy_aj;  // with the spring's
    };
    const auto go = [&](double stiff_n_m, double down, ParticleState& state) {
      const Mat3 spring =
          stiff_n_m * (Mat3::Identity() - along * along.transpose()) + kSoft * along * along.transpose();
      ParticleBalance balance(scene.model(), state, spring, end(down), 1e-3);
      EXPECT_EQ(balance.solve(), SolveStatus::kOk) << tilt << " at " << down;
      balance.store(state);
      return Step{balance.jumps(),
                  state.potential_aj + 0.5 * state.tip_force_w_nn.dot(state.tip_centre_w_nm - end(down))};
    };
    ParticleState leaping = scene.place(0, 0);
    leaping.started = true;
    leaping.tip_centre_w_nm = end(-kAbove);
    ParticleState walking = leaping;

    const Step leap = go(kStiff, kDown, leaping);
    EXPECT_EQ(leap.jumps, 1) << tilt;
    EXPECT_TRUE(is_on_curve(leaping.contacts[kTipSample].law.branch)) << tilt;
    int jumps = 0;
    Step walk{};
    for (int n = 1; n <= std::lround((kAbove + kDown) / kSmall); ++n) {
      walk = go(kLessStiff, -kAbove + n * kSmall, walking);
      jumps += walk.jumps;
    }
    EXPECT_EQ(jumps, 1) << tilt;
    const Step again = go(kLessStiff, kDown, leaping);
    EXPECT_EQ(again.jumps, 0) << tilt;
    // Of 2 to 8 aJ: the stiff spring's force is known to a few units of its last digit, 3e-7 nN, over 10 nm.
    EXPECT_NEAR(leap.energy_aj, walk.energy_aj, 3e-5) << tilt;
    EXPECT_NEAR(again.energy_aj, walk.energy_aj, 2e-7) << tilt;
  }
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

// What is found once for level ground is what each evaluation would find there: from the fields themselves.
TEST(Particle, WhatLevelGroundGivesIsFoundOnce) {
  const ParticleParameters p = plain();
  const ParticleEquilibrium scene = on_level(p);
  const ParticleModel& model = scene.model();
  for (const int i : {kTipSample, kParticleSample}) {
    ContactJet at;
    model.ground[static_cast<std::size_t>(i)]->fields().contact_at(Vec3(3, -2, 0.1), at);
    const ParticleModel::LevelGround& level = model.level[static_cast<std::size_t>(i)];
    EXPECT_EQ(level.log_radius, at.log_radius);
    EXPECT_EQ(level.radius_nm, det_exp(at.log_radius));
    const ContactScales scales = model.laws[static_cast<std::size_t>(i)].scales(level.radius_nm);
    EXPECT_EQ(level.at.scales.force_nn, scales.force_nn);
    EXPECT_EQ(level.at.scales.overlap_nm, scales.overlap_nm);
    // a0 goes like R^(2/3).
    const double relative = level.radius_nm / (i == kTipSample ? kTip : kParticle);
    EXPECT_NEAR(level.at.zero_load_radius_nm,
                model.zero_load_radius_nm[static_cast<std::size_t>(i)] * std::pow(relative, 2.0 / 3.0),
                1e-14);
  }
  const ParticleModel::LevelGround& between = model.level[kTipParticle];
  EXPECT_EQ(between.radius_nm, model.nominal_radius_nm[kTipParticle]);
  EXPECT_EQ(between.at.relative, 1.0);
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

}  // namespace
}  // namespace telenano::physics
