#include "telenano/master/station/station.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/station/station_rig.h"

namespace telenano::station {
namespace {

const Vec3 kPush(0, 0, 50);  // nN at the tip: 1 N at the hand with the default α_F = 2e7

TEST(Station, ShowsTheScaledForceOnceEngaged) {
  StationRig rig;
  EXPECT_EQ(rig.tick(false).trace.mode, Mode::kReady);  // no reply yet
  EXPECT_EQ(rig.force_n(), 0);
  rig.engage(kPush);
  EXPECT_EQ(rig.station.mode(), Mode::kEngaged);
  EXPECT_NEAR(rig.output.hand_force_h_n.z(), 1.0, 1e-12);
  EXPECT_EQ(rig.output.trace.ramp, 1);
}

TEST(Station, EngagesWithoutAForceStep) {
  StationRig rig;
  rig.reply.force_w_nn = kPush;
  double last_n = 0, largest_step_n = 0;
  for (int k = 0; k < 400; ++k) {
    rig.tick();
    largest_step_n = std::fmax(largest_step_n, std::fabs(rig.force_n() - last_n));
    last_n = rig.force_n();
  }
  EXPECT_NEAR(last_n, 1, 1e-12);
  EXPECT_LE(largest_step_n, 1 * 1e-3 / 0.2 + 1e-12);  // the ramp: F·dt/0.2 s
}

TEST(Station, MapsPositionAndStreamsVelocity) {
  StationRig rig;
  rig.ticks(10);
  rig.input.hand_pos_h_m = Vec3(1e-4, 0, -2e-4);
  rig.tick();
  EXPECT_NEAR((rig.output.command.tip_pos_w_nm - Vec3(100.1, 200, 39.8)).norm(), 0, 1e-9);
  EXPECT_NEAR((rig.output.command.tip_vel_w_nm_s - Vec3(100, 0, -200)).norm(), 0, 1e-8);
  EXPECT_EQ(rig.output.command.flags, link::kFlagClutch | link::kFlagDeadman);
  rig.tick();
  EXPECT_EQ(rig.output.command.tip_vel_w_nm_s.norm(), 0);
  EXPECT_EQ(rig.output.command.newest_reply, rig.reply.sequence - 1 + 1);
}

TEST(Station, ClutchIsBumpless) {
  StationRig rig;
  rig.ticks(10);
  rig.input.hand_pos_h_m = Vec3(0, 0, 0.01);
  for (int k = 0; k < 30; ++k) {  // slowly, below the trip
    rig.input.hand_pos_h_m = Vec3(0, 0, 1e-4 * k);
    rig.tick();
  }
  const Vec3 before_w_nm = rig.output.command.tip_pos_w_nm;
  rig.input.buttons |= device::kButtonClutch;
  for (int k = 0; k < 100; ++k) {
    rig.input.hand_pos_h_m.x() += 1e-4;
    rig.tick();
    ASSERT_EQ(rig.output.command.tip_pos_w_nm, before_w_nm);
    ASSERT_EQ(rig.output.command.tip_vel_w_nm_s.norm(), 0);
    ASSERT_FALSE(rig.output.command.flags & link::kFlagClutch);
  }
  rig.input.buttons &= ~device::kButtonClutch;
  rig.tick();
  EXPECT_EQ(rig.output.command.tip_pos_w_nm, before_w_nm);
  rig.input.hand_pos_h_m.x() += 1e-4;
  rig.tick();
  EXPECT_NEAR(rig.output.command.tip_pos_w_nm.x() - before_w_nm.x(), 0.1, 1e-9);
}

TEST(Station, ReleasingTheDeadmanFadesTheForceAndHoldsTheTip) {
  StationRig rig;
  rig.engage(kPush);
  rig.input.buttons = 0;
  double last_n = rig.force_n();
  for (int k = 1; k <= 81; ++k) {
    rig.tick();
    ASSERT_LE(rig.force_n(), last_n);
    ASSERT_LE(last_n - rig.force_n(), 1e-3 / 0.08 + 1e-12);  // no step down either
    last_n = rig.force_n();
  }
  EXPECT_EQ(rig.force_n(), 0);
  EXPECT_EQ(rig.output.command.flags, 0u);
  EXPECT_EQ(rig.station.mode(), Mode::kReady);
}

TEST(Station, WorkspaceLimitsTheTarget) {
  StationRig rig;
  rig.welcome.workspace_min_w_nm = Vec3(0, 0, 39);
  rig.welcome.workspace_max_w_nm = Vec3(300, 300, 80);
  rig.station.begin_session(rig.welcome);
  rig.reply.sequence = 0;
  rig.ticks(5);
  for (int k = 0; k < 100; ++k) {
    rig.input.hand_pos_h_m.z() -= 1e-4;
    rig.tick();
    ASSERT_GE(rig.output.command.tip_pos_w_nm.z(), 39);
  }
  EXPECT_EQ(rig.output.command.tip_pos_w_nm.z(), 39);
}

TEST(Station, AccountsTheForceReallyApplied) {
  StationRig rig;
  rig.engage(kPush);
  rig.input.applied_force_h_n = Vec3(0, 0, 0.25);  // the device saturated, say
  rig.input.hand_pos_h_m.z() -= 1e-4;
  const double before_j = rig.output.trace.energy_j;
  rig.tick();
  EXPECT_NEAR(rig.output.trace.energy_j - before_j, 0.25e-4, 1e-15);
  EXPECT_NEAR(rig.output.command.energy_in_j - rig.output.command.energy_out_j, rig.output.trace.energy_j,
              1e-15);
}

TEST(Station, SlaveEnergyIsScaledByThePowerFactor) {
  StationRig rig;
  rig.reply.energy_in_aj = 50;  // 1 nm against 50 nN
  rig.tick();
  EXPECT_NEAR(rig.output.trace.slave_energy_in_j, 1e-3, 1e-15);  // 1 mm against 1 N
}

}  // namespace
}  // namespace telenano::station
