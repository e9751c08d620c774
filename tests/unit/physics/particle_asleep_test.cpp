#include <gtest/gtest.h>

#include <algorithm>

#include "telenano/nve_server/physics/particle/particle_equilibrium.h"
#include "tests/unit/physics/particle_scene.h"

namespace telenano::physics {
namespace {

// Van der Waals between all, friction that holds: what a tip feels of a particle far away.
ParticleParameters felt_from_afar() {
  ParticleParameters p;
  p.tip_radius_nm = kTip;
  p.particle_radius_nm = kParticle;
  p.particle_sample = p.tip_particle = p.tip_sample = telenano::testing::material_of(1.0, true);
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

}  // namespace
}  // namespace telenano::physics
