#include "telenano/nve_server/server/port_control.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace telenano::server {
namespace {

constexpr double kT = 1e-3;
constexpr double kStiffness = 20;  // nN/nm

// A wall at z = 0 that the end presses into, with an exact account.
struct Wall {
  slave::SlaveLimits limits;
  slave::SlaveOutput output;

  Wall() {
    limits.coupling_stiffness_n_m = kStiffness;
    output.commanded_pos_w_nm = output.tip_pos_w_nm = Vec3(0, 0, 10);
  }
  void step(const slave::SlaveInput& input) {
    const auto potential = [](double z) { return z < 0 ? 0.5 * kStiffness * z * z : 0.0; };
    const double before = potential(output.commanded_pos_w_nm.z());
    output.commanded_pos_w_nm = input.tip_target_pos_w_nm;
    const double z = output.commanded_pos_w_nm.z();
    const double charge = potential(z) - before;
    (charge > 0 ? output.energy_in_aj : output.energy_out_aj) += std::fabs(charge);
    output.force_w_nn = Vec3(0, 0, z < 0 ? -kStiffness * z : 0);
  }
};

struct Rig {
  Wall wall;
  PortControl control;
  link::Command command;

  explicit Rig(std::uint32_t method) {
    command.control.method = method;
    command.control.energy_scale_aj_j = 1e5;
    command.control.wave_impedance_n_s_m = 0.1;
  }
  void tick(const Vec3& target_w_nm, bool follow = true) {
    command.tip_pos_w_nm = target_w_nm;
    slave::SlaveInput input;
    input.follow = follow;
    input.tip_target_pos_w_nm = target_w_nm;
    const slave::SlaveOutput last = wall.output;
    wall.step(control.before(command, input, last, wall.limits, kT));
    control.after(last, wall.output, kT);
  }
  double z() const { return wall.output.commanded_pos_w_nm.z(); }
};

TEST(PortControl, OtherMethodsLeaveTheCommandAsItIs) {
  for (std::uint32_t method :
       {link::kMethodNone, link::kMethodKs, link::kMethodKsClamp, link::kMethodModel}) {
    Rig rig(method);
    rig.tick(Vec3(3, -4, -50));
    EXPECT_EQ(rig.wall.output.commanded_pos_w_nm, Vec3(3, -4, -50));
  }
}

TEST(PortControl, InFreeSpaceTheEndFollowsWithoutEnergy) {
  for (std::uint32_t method : {link::kMethodTdpa, link::kMethodTank}) {
    Rig rig(method);
    for (int k = 0; k <= 100; ++k) rig.tick(Vec3(0.1 * k, 0, 10 + 0.05 * k));
    EXPECT_LT((rig.wall.output.commanded_pos_w_nm - Vec3(10, 0, 15)).norm(), 1e-12);
  }
}

TEST(PortControl, NothingIsPressedThatWasNotPaidFor) {
  Rig rig(link::kMethodTdpa);
  rig.tick(Vec3(0, 0, 0.0));
  for (int k = 1; k <= 100; ++k) rig.tick(Vec3(0, 0, -0.1 * k));  // 10 nm deep, nothing sent
  EXPECT_LE(rig.wall.output.energy_in_aj, PortControl::kUnforeseenJ * 1e5);
  rig.command.control.energy_sent_j = 4e-3;                  // 400 aJ
  for (int k = 0; k < 2000; ++k) rig.tick(Vec3(0, 0, -10));  // of ½·20·100 = 1000
  EXPECT_NEAR(rig.wall.output.energy_in_aj, 400, 1);
  EXPECT_NEAR(rig.z(), -std::sqrt(2 * 400 / kStiffness), 0.02);
  rig.command.control.energy_sent_j = 12e-3;
  for (int k = 0; k < 2000; ++k) rig.tick(Vec3(0, 0, -10));  // enough now: the drift is made good
  EXPECT_NEAR(rig.z(), -10, 1e-6);
}

TEST(PortControl, GroundMetInALeapCostsNoMoreThanIsAllowedFor) {
  for (std::uint32_t method : {link::kMethodTdpa, link::kMethodTank}) {
    Rig rig(method);
    rig.tick(Vec3(0, 0, 5));
    rig.tick(Vec3(0, 0, -200));  // after a burst of losses
    for (int k = 0; k < 500; ++k) {
      rig.tick(Vec3(0, 0, -200));
      ASSERT_LE(rig.wall.output.energy_in_aj - rig.wall.output.energy_out_aj,
                PortControl::kUnforeseenJ * 1e5 + 1e-9);
    }
    EXPECT_LT(rig.z(), 0);  // it did come down
  }
}

TEST(PortControl, TheEndMayAlwaysYield) {
  Rig rig(link::kMethodTdpa);
  rig.command.control.energy_sent_j = 1;
  for (int k = 0; k <= 100; ++k) rig.tick(Vec3(0, 0, -0.1 * k));
  for (int k = 100; k >= 0; --k) rig.tick(Vec3(0, 0, -0.1 * k));
  EXPECT_NEAR(rig.z(), 0, 1e-9);
}

// With tdpa what the port gives back is the station's to count; at the slave it buys no second press.
TEST(PortControl, OutputIsNoNewInput) {
  Rig rig(link::kMethodTdpa);
  rig.tick(Vec3(0, 0, 0));
  rig.command.control.energy_sent_j = 1e-2;  // 1000 aJ: one press of 10 nm
  for (int k = 0; k < 3000; ++k) rig.tick(Vec3(0, 0, -10));
  ASSERT_NEAR(rig.z(), -10, 1e-2);
  for (int k = 0; k < 3000; ++k) rig.tick(Vec3(0, 0, 0));
  ASSERT_NEAR(rig.z(), 0, 1e-6);
  for (int k = 0; k < 3000; ++k) rig.tick(Vec3(0, 0, -10));
  EXPECT_GT(rig.z(), -std::sqrt(2 * 2 * PortControl::kUnforeseenJ * 1e5 / kStiffness));
}

TEST(PortControl, TheTankConservesEnergy) {
  Rig rig(link::kMethodTank);
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal;
  double z = 10;
  for (int k = 0; k < 20'000; ++k) {
    z += 0.3 * normal(random) - 0.02 * z;
    rig.command.control.energy_sent_j += 1e-5 * std::fabs(normal(random));
    rig.tick(Vec3(0, 0, z));
    const double received = rig.command.control.energy_sent_j * 1e5;
    const double port = rig.wall.output.energy_in_aj - rig.wall.output.energy_out_aj;
    ASSERT_NEAR(rig.control.level_aj(), received - port - rig.control.answer().energy_sent_aj,
                1e-12 * (received + 1) * k);
    ASSERT_GE(rig.control.level_aj(), -PortControl::kUnforeseenJ * 1e5 - 1e-9);
  }
}

TEST(PortControl, AWaveNeverSendsMoreThanItGot) {
  Rig rig(link::kMethodWave);
  std::mt19937_64 random(13);
  std::normal_distribution<double> normal;
  double wave = 0;
  for (int k = 0; k < 20'000; ++k) {
    wave += 0.1 * normal(random) - 0.01 * wave;
    rig.command.control.wave_sum.z() += wave * kT;
    rig.command.control.wave_energy_aj += 0.5 * wave * wave * kT;
    rig.tick(Vec3(0, 0, -2));
    const double port = rig.wall.output.energy_in_aj - rig.wall.output.energy_out_aj;
    ASSERT_LE(rig.control.answer().wave_energy_aj + port + rig.control.level_aj(),
              rig.command.control.wave_energy_aj + 1e-9);
  }
}

TEST(PortControl, WavesOfASteadyHandPressAsHard) {
  // Statically u = f/√(2b): the wall ends where its force is √(2b)·u.
  Rig rig(link::kMethodWave);
  const double force = 30, b = rig.command.control.wave_impedance_n_s_m, u = force / std::sqrt(2 * b);
  for (int k = 0; k < 5000; ++k) {
    rig.command.control.wave_sum.z() -= u * kT;
    rig.command.control.wave_energy_aj += 0.5 * u * u * kT;
    rig.tick(rig.wall.output.commanded_pos_w_nm);  // no lag to catch up
  }
  EXPECT_NEAR(rig.wall.output.force_w_nn.z(), force, 0.01 * force);
}

TEST(PortControl, ALostCommandLosesNothing) {
  Rig whole(link::kMethodTdpa), lossy(link::kMethodTdpa);
  for (int k = 0; k <= 300; ++k) {
    const Vec3 target(0, 0, 5 - 0.05 * k);
    for (Rig* rig : {&whole, &lossy}) {
      rig->command.control.energy_sent_j = 1e-4 * k;
      if (rig == &whole || k % 4 != 1) rig->tick(target);
    }
  }
  for (int k = 0; k < 3000; ++k) {
    whole.tick(Vec3(0, 0, -10));
    lossy.tick(Vec3(0, 0, -10));
  }
  EXPECT_NEAR(whole.z(), -10, 1e-6);
  EXPECT_NEAR(lossy.z(), -10, 1e-6);
}

// A station sends the slave its allowance with the first replies, once. An operator who takes the hand later,
// or a tip that is not there yet, must find it.
TEST(PortControl, WhatComesBeforeTheTipFollowsIsKept) {
  for (const std::uint32_t method : {link::kMethodTdpa, link::kMethodTank}) {
    SCOPED_TRACE(method);
    Rig early(method), late(method);
    for (Rig* rig : {&early, &late}) {
      rig->command.control.energy_sent_j = 0.008;
      rig->wall.output.commanded_pos_w_nm = Vec3(0, 0, 1);
      for (int k = 0; k < 1000 && rig == &late; ++k) rig->tick(Vec3(0, 0, 1), false);
      for (int k = 0; k < 3000; ++k) rig->tick(Vec3(0, 0, -8));
    }
    EXPECT_NEAR(early.z(), -8, 1e-6);
    EXPECT_NEAR(late.z(), early.z(), 1e-6);
  }
}

// A joule of the hand is another number at the tip, and nobody has moved: level and debt stay worth what they
// were.
TEST(PortControl, AnotherScaleLeavesLevelAndDebtWhatTheyAreAtTheHand) {
  for (const double by : {0.04, 25.0}) {
    Rig rich(link::kMethodTank), poor(link::kMethodTdpa);
    rich.command.control.energy_sent_j = 5e-3;
    for (int k = 0; k < 3; ++k) rich.tick(Vec3(0, 0, 5));
    for (int k = 0; k < 500; ++k) poor.tick(Vec3(0, 0, -1));
    ASSERT_NEAR(rich.control.level_aj(), 5e-3 * 1e5, 1e-9);
    const double debt_j = poor.control.level_aj() / 1e5;
    ASSERT_LT(debt_j, 0);
    for (Rig* rig : {&rich, &poor}) {
      rig->command.control.energy_scale_aj_j = 1e5 * by;
      rig->tick(rig->wall.output.commanded_pos_w_nm);
    }
    EXPECT_NEAR(rich.control.level_aj() / (1e5 * by), 5e-3, 1e-15);
    EXPECT_NEAR(poor.control.level_aj() / (1e5 * by), debt_j, 1e-15);
  }
}

// Ten times in at one scale and out at the other: what the port gives back is worth no more at the hand than
// what was paid for it. Counted in hand joules, as they go in and come out, by the test itself.
TEST(PortControl, WhatWasPressedAtOneScaleIsNotWorthMoreAtAnother) {
  for (const double by : {0.04, 25.0}) {  // of the price of a joule at the tip, on the way out
    Rig rig(link::kMethodTank);
    double sent_back_j = 0;
    rig.command.control.energy_sent_j = 8e-3;
    const auto tick = [&](double z) {
      const double before_aj = rig.control.answer().energy_sent_aj;
      rig.tick(Vec3(0, 0, z));
      sent_back_j +=
          (rig.control.answer().energy_sent_aj - before_aj) / rig.command.control.energy_scale_aj_j;
    };
    for (int cycle = 0; cycle < 10; ++cycle) {
      rig.command.control.energy_scale_aj_j = 1e5;
      for (int k = 0; k <= 100; ++k) {
        rig.command.control.energy_sent_j += 1e-4;
        tick(-0.1 * k);
      }
      rig.command.control.energy_scale_aj_j = 1e5 / by;
      for (int k = 100; k >= -20; --k) tick(-0.1 * k);
      for (int k = 0; k < 3000; ++k) tick(2);
    }
    // Everything has come out of the wall; what is left in the tank is worth what it is worth.
    ASSERT_EQ(rig.wall.output.energy_in_aj > 5000, true);
    const double left_j = rig.control.level_aj() / rig.command.control.energy_scale_aj_j;
    EXPECT_LE(sent_back_j + left_j, rig.command.control.energy_sent_j + 1e-12) << by;
    // At the scale at which it was paid, or at a dearer one, nothing of it is lost.
    if (by > 1) {
      EXPECT_NEAR(sent_back_j + left_j, rig.command.control.energy_sent_j, 1e-9);
    }
  }
}

// What was pressed while `model` drove the tip is in the hand's own account, which goes on: the tank sends none of it, and all of what
// it has paid for itself.
TEST(PortControl, WhatAnotherMethodPressedDoesNotComeBackFromHere) {
  for (const std::uint32_t before :
       {link::kMethodNone, link::kMethodKs, link::kMethodModel, link::kMethodTwin}) {
    Rig rig(before);
    for (int k = 0; k <= 50; ++k) rig.tick(Vec3(0, 0, -0.1 * k));
    const double pressed_aj = rig.wall.output.energy_in_aj;
    ASSERT_GT(pressed_aj, 200);
    rig.command.control.method = link::kMethodTank;
    rig.command.control.energy_sent_j = 20e-3;  // enough for another 5 nm
    for (int k = 50; k <= 70; ++k) rig.tick(Vec3(0, 0, -0.1 * k));
    const double paid_aj = rig.wall.output.energy_in_aj - pressed_aj;
    ASSERT_GT(paid_aj, 100);
    for (int k = 70; k >= -20; --k) rig.tick(Vec3(0, 0, -0.1 * k));
    ASSERT_NEAR(rig.wall.output.energy_out_aj, pressed_aj + paid_aj, 1e-9);
    EXPECT_NEAR(rig.control.answer().energy_sent_aj + rig.control.level_aj(), 20e-3 * 1e5, 1e-9) << before;
  }
}

// A wave moves a tip by the energy that came with it, and what the wall gives back goes as a wave.
TEST(PortControl, WavesGainNothingByAnotherScaleEither) {
  Rig rig(link::kMethodWave);
  double back_j = 0, sent_j = 0;
  const auto tick = [&](double u) {
    const double before_aj = rig.control.answer().wave_energy_aj;
    rig.command.control.wave_sum.z() += u * kT;
    rig.command.control.wave_energy_aj += 0.5 * u * u * kT;
    sent_j += 0.5 * u * u * kT / rig.command.control.energy_scale_aj_j;
    rig.tick(rig.wall.output.commanded_pos_w_nm);
    back_j += (rig.control.answer().wave_energy_aj - before_aj) / rig.command.control.energy_scale_aj_j;
  };
  for (int cycle = 0; cycle < 10; ++cycle) {
    rig.command.control.energy_scale_aj_j = 1e5;
    for (int k = 0; k < 2000; ++k) tick(-30 / std::sqrt(0.2));
    rig.command.control.energy_scale_aj_j = 4e3;
    for (int k = 0; k < 2000; ++k) tick(0);
  }
  EXPECT_GT(rig.wall.output.energy_out_aj, 100) << "the wall gave something back";
  EXPECT_LE(back_j, sent_j + 1e-12);
}

// Two finite numbers may make one that is not, and a sum that is none would be on the wire for good.
TEST(PortControl, NoCommandMakesASumThatIsNotFinite) {
  const double kBad[] = {1e300, 1.7e308, 1e154, 1e-300, 4.9e-324};
  std::mt19937_64 random(17);
  std::uniform_int_distribution<int> which(0, 6);
  for (std::uint32_t method : {link::kMethodTdpa, link::kMethodWave, link::kMethodTank}) {
    for (int run = 0; run < 200; ++run) {
      Rig rig(method);
      for (int k = 0; k < 60; ++k) {
        link::PortControl& c = rig.command.control;
        const auto some = [&](double usual) {
          const int i = which(random);
          return i < 5 ? kBad[i] : usual;
        };
        c.energy_scale_aj_j = some(1e5);
        c.energy_sent_j = std::max(c.energy_sent_j, some(1e-3 * k));
        c.wave_energy_aj = std::max(c.wave_energy_aj, some(1.0 * k));
        c.wave_sum = Vec3(some(0), -some(0), some(-0.1));
        c.wave_impedance_n_s_m = some(0.1);
        rig.tick(Vec3(0, 0, 1 - 0.1 * (k % 20)));
        // A slave that is told what is not finite stays where it is (step_guarded); so does this wall.
        if (!is_finite(rig.wall.output.commanded_pos_w_nm)) break;
        ASSERT_TRUE(std::isfinite(rig.control.answer().energy_sent_aj)) << method;
        ASSERT_TRUE(std::isfinite(rig.control.answer().wave_energy_aj)) << method;
        ASSERT_TRUE(is_finite(rig.control.answer().wave_sum)) << method;
        ASSERT_TRUE(std::isfinite(rig.control.level_aj())) << method;
      }
    }
  }
}

TEST(PortControl, ANewSessionForgetsCreditAndKeepsDebt) {
  Rig rig(link::kMethodTdpa);
  rig.command.control.energy_sent_j = 1;
  rig.tick(Vec3(0, 0, 5));
  EXPECT_GT(rig.control.level_aj(), 0);
  rig.control.begin_session();
  EXPECT_EQ(rig.control.level_aj(), 0);
  rig.command.control.energy_sent_j = 0;
  for (int k = 0; k < 500; ++k) rig.tick(Vec3(0, 0, -1));
  const double owed = rig.control.level_aj();
  ASSERT_LT(owed, 0);
  rig.control.begin_session();
  EXPECT_EQ(rig.control.level_aj(), owed);
}

}  // namespace
}  // namespace telenano::server
