#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "telenano/nve_server/scene/readers.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"
#include "tests/support/alloc_guard.h"
#include "tests/support/slave_walk.h"

namespace telenano::slave {
namespace {

constexpr double kDt_s = SlaveWalk::kDt_s;

std::shared_ptr<const scene::Scene> deployed() {
  return scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/particle.toml");
}

std::shared_ptr<const scene::Scene> changed(const std::function<void(scene::Scene&)>& change) {
  auto scene = std::make_shared<scene::Scene>(*deployed());
  change(*scene);
  return scene;
}

double charged(const SlaveOutput& out) {
  return out.energy_in_aj - out.energy_out_aj;
}

// Centres at equal heights: the push is along x. By geometry alone the particle is ahead of the tip by the
// sum of the radii, less the contact's overlap: adhesion pulls in less than 1 nm (u_delta = 0.9 nm for
// R = 12 nm), the push itself less than that.
TEST(ParticleSlave, ParticleMovesWithTheTipThatPushesIt) {
  SlaveWalk session(deployed());
  const double start_x = session.particle().particle_centre_w_nm.x();
  EXPECT_NEAR(start_x, 60, 1e-3);  // the tip's van der Waals from 90 nm bends its bristles by 2e-5 nm
  session.go_to(Vec3(0, 0, 10), 1.0);
  EXPECT_NEAR(session.particle().particle_centre_w_nm.x(), start_x, 0.02);  // van der Waals at 10 nm
  bool met = false;
  const SlaveOutput out = session.go_to(Vec3(150, 0, 10), 1.0, [&](const SlaveOutput& o) {
    ASSERT_EQ(o.fault_bits, 0u) << session.at().x();
    if (!session.particle().held_by_tip) {
      ASSERT_FALSE(met) << "let go at " << session.at().x();
      return;
    }
    met = true;
    const Vec3 tip_centre = o.tip_pos_w_nm + Vec3(0, 0, 20);
    const double apart = (session.particle().particle_centre_w_nm - tip_centre).norm();
    ASSERT_LT(apart, 50.0 + 0.3);  // the range of adhesion
    ASSERT_GT(apart, 50.0 - 3.0);
  });
  EXPECT_TRUE(met);
  EXPECT_GT(session.particle().particle_centre_w_nm.x(), 180);
  EXPECT_NEAR(session.particle().particle_centre_w_nm.y(), 0, 1e-3);
  EXPECT_TRUE(session.particle().on_surface);
  EXPECT_LT(out.force_w_nn.x(), -1.0);  // it resists
}

// Forces on the particle balance but for the drag, which is some 1e-4 nN at 1 um/s: what the tip gives it is
// what the sample takes.
TEST(ParticleSlave, WhatTheTipGivesTheSampleTakes) {
  SlaveWalk session(deployed());
  session.go_to(Vec3(0, 0, 10), 1.0);
  int pushed = 0;
  session.go_to(Vec3(120, 0, 12), 1.0, [&](const SlaveOutput& out) {
    const auto& contacts = session.particle().contacts;
    const Vec3 from_tip = contacts[physics::kTipParticle].force_w_nn;
    const Vec3 from_sample = contacts[physics::kParticleSample].force_w_nn;
    // Newton's tolerance on forces of up to 500 nN, and the drag.
    ASSERT_LT((from_tip + from_sample).norm(), 1e-3) << session.at().x();
    const Vec3 on_tip = contacts[physics::kTipSample].force_w_nn - from_tip;
    ASSERT_LT((on_tip - out.force_w_nn).norm(), 1e-6);  // the port's springs, against the contacts
    // Coupling 20 N/m, lever 100 N/m across and 40 N/m upwards: apex = commanded end + C F.
    const Vec3 f = out.force_w_nn;
    const Vec3 bent(f.x() * (1 / 20.0 + 1 / 100.0), f.y() / 20, f.z() * (1 / 20.0 + 1 / 40.0));
    ASSERT_LT((out.tip_pos_w_nm - out.commanded_pos_w_nm - bent).norm(), 1e-6) << session.at().x();
    if (from_tip.norm() > 1) ++pushed;
  });
  EXPECT_GT(pushed, 50);
}

// The account against an independent integral: work of the commanded end by the trapezium rule. Where nothing
// ends the rule's error is of second order in the step (0.05 nm): 0.2 aJ over 140 nm of pushing. A jump
// within a step (meeting, parting) adds up to dF step/2 = 20 nN x 0.025 nm each.
TEST(ParticleSlave, ChargesTheWorkOfTheCommandedEnd) {
  SlaveWalk session(deployed());
  SlaveOutput before = session.go_to(Vec3(0, 0, 10), 1.0);
  const double counted_at_start = charged(before);
  double work = 0, most = 0;
  Vec3 at = session.at();
  const auto add = [&](const SlaveOutput& out) {
    ASSERT_EQ(out.fault_bits, 0u);
    work -= 0.5 * (out.force_w_nn + before.force_w_nn).dot(session.at() - at);
    most = std::max(most, std::fabs(charged(out) - counted_at_start - work));
    at = session.at();
    before = out;
  };
  session.go_to(Vec3(70, 0, 10), 0.05, add);
  session.go_to(Vec3(0, 0, 10), 0.05, add);
  EXPECT_GT(work, 10.0);  // rolling and sliding cost
  EXPECT_LT(most, 2.0) << "of " << work;
  EXPECT_LT(most, 0.01 * work);
}

// Whatever the path, with leaps of some nm: the account is stored plus lost, neither loss nor account runs
// backwards, and a closed loop yields nothing: back at the start, charged + what was stored at first >= 0.
TEST(ParticleSlave, NoPathDrawsEnergy) {
  SlaveWalk session(deployed());
  NveSlave& slave = session.slave();
  const double stored_at_start = slave.trace().stored_aj;
  std::mt19937 random(31);
  std::uniform_real_distribution<double> unit(-1, 1);
  double dissipated = 0, in = 0, gave = 0;
  int touched = 0;
  const auto check = [&](const SlaveOutput& out) {
    ASSERT_TRUE(is_finite(out.force_w_nn) && is_finite(out.tip_pos_w_nm));
    // Rounding of sums of some 1e5 aJ.
    ASSERT_NEAR(charged(out), slave.trace().stored_aj - stored_at_start + slave.trace().dissipated_aj,
                1e-9 * out.energy_in_aj + 1e-9);
    ASSERT_GE(slave.trace().dissipated_aj, dissipated);
    ASSERT_GE(out.energy_in_aj, in);
    ASSERT_GE(out.energy_out_aj, gave);
    dissipated = slave.trace().dissipated_aj;
    in = out.energy_in_aj;
    gave = out.energy_out_aj;
    touched += session.particle().held_by_tip;
  };
  for (int loop = 0; loop < 6; ++loop) {
    const Vec3 particle = session.particle().particle_centre_w_nm;
    session.go_to(particle + Vec3(-80, 10 * unit(random), -20), 5.0, check);
    for (int i = 0; i < 150; ++i) {
      // Around where the particle is now, so that the tip meets it from all sides.
      Vec3 target = session.particle().particle_centre_w_nm + Vec3(40 * unit(random), 40 * unit(random), 0);
      target.z() = 25 + 25 * unit(random);
      const Vec3 step = target - session.at();
      session.go_to(session.at() + step * std::min(1.0, 4.0 / step.norm()), 4.0, check);
    }
    Vec3 above = session.at();
    above.z() = 100;
    session.go_to(above, 2.0, check);
    const SlaveOutput out = session.go_to(slave.limits().start_pos_w_nm, 5.0, check);
    // At the start position again; the particle may lie elsewhere on the flat, with its bristles still bent:
    // nothing more than what it had when the tip was first brought in can have come back.
    ASSERT_GE(charged(out), -1e-6) << loop;
  }
  EXPECT_GT(touched, 100);
  EXPECT_GT(dissipated, 100);
}

// A particle that sleeps is not balanced: while the tip is far only the tip's own step is made, pressed or
// above. What is felt is that of one that never sleeps, to what a sleeping particle leaves out (1e-6 of the
// pull-off of particle and sample, 60 nN), also while the tip comes near, so that the particle wakes, is
// pushed, and falls asleep again. The tip's own snap into contact is counted by the law alone and by the
// trapezium with the particle: apart by 30 nN × 0.25 nm.
TEST(ParticleSlave, BesideASleeperItIsAsIfItWereAwake) {
  SlaveWalk sleeper(deployed());
  SlaveWalk watcher(changed([](scene::Scene& s) { s.particle->parameters.sleeps = false; }));
  int alone = 0, steps = 0, woken = 0;
  double most = 0, most_counted = 0;
  const auto both = [&](const Vec3& to, double step) {
    std::vector<SlaveOutput> a, b;
    std::vector<int> substeps;
    sleeper.go_to(to, step, [&](const SlaveOutput& out) {
      a.push_back(out);
      substeps.push_back(sleeper.particle().substeps);
    });
    watcher.go_to(to, step, [&](const SlaveOutput& out) { b.push_back(out); });
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i) {
      const double charged_apart = charged(a[i]) - charged(b[i]);
      most = std::max(most, (a[i].force_w_nn - b[i].force_w_nn).norm());
      most_counted = std::max(most_counted, std::fabs(charged_apart));
      alone += substeps[i] == 0;
      woken += sleeper.particle().held_by_tip;
      ++steps;
    }
  };
  both({-100, 0, 10}, 1.0);
  both({-100, 0, -4}, 0.5);  // pressed, and dragged over the sample
  both({-60, 20, -4}, 0.5);
  both({-60, 20, 12}, 0.5);
  EXPECT_GT(alone, steps / 2);
  const int before = alone;
  both({30, 0, 12}, 0.5);  // against it, and off again
  both({-80, 0, 12}, 0.5);
  both({-120, 0, 12}, 0.5);
  EXPECT_GT(woken, 5);
  EXPECT_GT(alone, before + 50);
  std::printf("forces apart by %.2g nN, charges by %.2g aJ, %d of %d steps alone\n", most, most_counted,
              alone, steps);
  EXPECT_LT(most, 6e-5);
  EXPECT_LT(most_counted, 7.5);
}

// Pressed on from above and drawn off. Which contact breaks is decided by the pull-offs: for equal pairs of
// materials they go as the effective radii, 12 nm at the tip and 30 nm at the sample, so the particle stays;
// on a sample that it hardly sticks to, it comes along.
TEST(ParticleSlave, IsLostOnTheSampleOrPickedUpFromWhatHoldsItLess) {
  for (const bool weak : {false, true}) {
    SlaveWalk session(changed([&](scene::Scene& s) {
      if (weak) s.particle->parameters.particle_sample.work_of_adhesion_n_m *= 0.1;
      scene::make_level_ground(s);
    }));
    const SlaveOutput before = session.go_to(Vec3(60, 0, 80), 1.0);
    EXPECT_EQ(before.particle.status, link::ParticleStatus::kRests);
    EXPECT_EQ(before.particle.radius_nm, 30);
    EXPECT_EQ(before.particle.pos_w_nm, session.particle().particle_centre_w_nm);
    double most = 0;
    const SlaveOutput pressed = session.go_to(
        Vec3(60, 0, 57), 0.2, [&](const SlaveOutput& o) { most = std::max(most, o.force_w_nn.z()); });
    EXPECT_GT(most, 1.0) << weak;
    EXPECT_TRUE(session.particle().held_by_tip) << weak;
    EXPECT_EQ(pressed.particle.status, link::ParticleStatus::kPushed);
    double least = 0;
    const SlaveOutput out = session.go_to(
        Vec3(60, 0, 95), 0.2, [&](const SlaveOutput& o) { least = std::min(least, o.force_w_nn.z()); });
    EXPECT_EQ(session.particle().held_by_tip, weak);
    EXPECT_EQ(session.particle().on_surface, !weak);
    EXPECT_EQ(out.particle.status, weak ? link::ParticleStatus::kHeld : link::ParticleStatus::kRests);
    EXPECT_EQ(out.particle.pos_w_nm, session.particle().particle_centre_w_nm);
    // The weaker pull-off, between 1.5 (JKR) and 2 (DMT) times pi w R, is what the tip felt.
    const double w = session.slave().sample().particle() == nullptr ? 0 : 2 * std::sqrt(0.2 * 0.066);
    const double unit_nn = weak ? M_PI * 0.1 * w * 30 : M_PI * w * 12;
    EXPECT_GT(-least, 1.3 * unit_nn) << weak;  // it leans on springs and steps: reached within a step or two
    EXPECT_LT(-least, 2.05 * unit_nn) << weak;
    if (weak) {
      // It hangs: centre a radius below the apex, and the force on the tip is nothing.
      EXPECT_NEAR(session.particle().particle_centre_w_nm.z(), out.tip_pos_w_nm.z() - 30, 2.0);
      EXPECT_NEAR(out.force_w_nn.norm(), 0, 0.05);
    } else {
      EXPECT_NEAR(session.particle().particle_centre_w_nm.z(), 30, 2.0);
    }
  }
}

TEST(ParticleSlave, ForceLimitHoldsFromAboveAndFromTheSide) {
  SlaveWalk session(changed([](scene::Scene& s) { s.limits.force_max_nn = 25; }));
  bool reached = false;
  const auto check = [&](const SlaveOutput& out) {
    ASSERT_LE(out.force_w_nn.norm(), 25.0 * (1 + 1e-9)) << session.at().transpose();
    reached |= (out.fault_bits & link::kFaultForceLimit) != 0;
  };
  session.go_to(Vec3(60, 0, 75), 1.0, check);
  session.go_to(Vec3(60, 0, 35), 0.5, check);
  EXPECT_TRUE(reached);
  reached = false;
  session.go_to(Vec3(60, 0, 95), 1.0, check);
  session.go_to(Vec3(-20, 0, 95), 1.0, check);
  session.go_to(Vec3(-20, 0, 3), 1.0, check);
  session.go_to(Vec3(100, 0, -5), 0.5, check);
  EXPECT_TRUE(reached);
}

TEST(ParticleSlave, RetractsInTheMiddleOfAPush) {
  SlaveWalk session(deployed());
  session.go_to(Vec3(0, 0, 10), 1.0);
  session.go_to(Vec3(60, 0, 10), 1.0);
  ASSERT_TRUE(session.particle().held_by_tip);
  const Vec3 lay = session.particle().particle_centre_w_nm;
  SlaveInput input;
  input.tip_target_pos_w_nm = Vec3(500, 0, -50);  // must not count
  input.retract = true;
  SlaveOutput out;
  double z = 10;
  for (int i = 0; i < 200; ++i) {
    session.slave().step(input, kDt_s, out);
    ASSERT_TRUE(out.fault_bits & link::kFaultRetracted);
    ASSERT_FALSE(out.fault_bits & link::kFaultNoEquilibrium) << i;
    const double now = session.slave().trace().commanded_end_w_nm.z();
    ASSERT_GE(now, z);
    z = now;
  }
  EXPECT_EQ(z, session.slave().limits().workspace_max_w_nm.z());
  EXPECT_LT(out.force_w_nn.norm(), 0.05);  // van der Waals at 50 nm
  EXPECT_FALSE(session.particle().held_by_tip);
  EXPECT_TRUE(session.particle().on_surface);
  EXPECT_LT((session.particle().particle_centre_w_nm - lay).norm(), 40.0);  // rolled about the tip at most
}

// A particle turns its side to the tip, and a contact that sticks holds it sideways: the wall that is felt
// may face anywhere. Along the lever, which is rigid, only the coupling of 20 N/m gives way; upwards alone it
// would be 1/(1/20 + 1/40).
TEST(ParticleSlave, TellsTheStiffnessOfItsStiffestDirection) {
  const NveSlave slave(deployed());
  EXPECT_NEAR(slave.limits().coupling_stiffness_n_m, 20.0, 1e-9);
  EXPECT_TRUE(slave.limits().has_particle);
  const NveSlave sticking(changed([](scene::Scene& s) { s.particle.reset(); }));
  EXPECT_FALSE(sticking.limits().has_particle);
  EXPECT_NEAR(sticking.limits().coupling_stiffness_n_m, 20.0, 1e-9);
  const NveSlave smooth(changed([](scene::Scene& s) {
    s.particle.reset();
    s.friction.reset();
  }));
  EXPECT_NEAR(smooth.limits().coupling_stiffness_n_m, 1 / (1 / 20.0 + 1 / 40.0), 1e-9);
}

TEST(ParticleSlave, EachSessionHasAParticleOfItsOwnAndTheSameBits) {
  const auto scene = deployed();
  SlaveWalk a(scene), b(scene), idle(scene);
  for (SlaveWalk* session : {&a, &b}) {
    session->go_to(Vec3(0, 0, 10), 1.0);
    session->go_to(Vec3(90, 3, 10), 1.0);
  }
  EXPECT_EQ(a.particle().particle_centre_w_nm, b.particle().particle_centre_w_nm);
  EXPECT_EQ(a.slave().trace().stored_aj, b.slave().trace().stored_aj);
  EXPECT_NEAR(idle.particle().particle_centre_w_nm.x(), 60, 1e-3);
}

// A trial that is not accepted (the end was drawn back at the force limit) leaves no trace: same bits as if
// it had never been tried.
TEST(ParticleSlave, RejectedTrialLeavesNoTrace) {
  const auto scene = deployed();
  TouchedSample tried(scene), plain(scene);
  physics::PotentialState unused;
  const physics::Compliance springs = scene->port_compliance_nm_nn();
  for (const double x : {0.0, 5.0, 12.0, 20.0}) {
    tried.advance(Vec3(x + 15, 3, 2), springs, kDt_s, unused);  // into the particle, or farther along with it
    const Vec3 end(x, 0, 10);
    const physics::TipSolution a = tried.advance(end, springs, kDt_s, unused);
    const physics::TipSolution b = plain.advance(end, springs, kDt_s, unused);
    ASSERT_EQ(a.force_w_nn, b.force_w_nn) << x;
    ASSERT_EQ(a.dissipated_aj, b.dissipated_aj) << x;
    tried.accept(a);
    plain.accept(b);
    ASSERT_EQ(tried.particle()->particle_centre_w_nm, plain.particle()->particle_centre_w_nm) << x;
  }
  EXPECT_GT(plain.particle()->particle_centre_w_nm.x(), 65);
}

TEST(ParticleSlave, StepTakesNothingFromTheHeap) {
  SlaveWalk session(deployed());
  session.go_to(Vec3(0, 0, 10), 1.0);
  SlaveInput input;
  SlaveOutput out;
  const support::AllocGuard guard;
  for (int i = 0; i < 120; ++i) {
    input.tip_target_pos_w_nm = Vec3(i, 0.02 * i, 10);
    session.slave().step(input, kDt_s, out);
  }
  EXPECT_EQ(guard.allocations(), 0u);
  if (!support::AllocGuard::active()) GTEST_SKIP() << "allocations are not counted in this build";
}

}  // namespace
}  // namespace telenano::slave
