// What takes the force away at once, and how it comes back.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "telenano/master/station/station.h"
#include "tests/unit/station/station_rig.h"

namespace telenano::station {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
const Vec3 kPush(0, 0, 50);  // nN at the tip: 1 N at the hand with the default α_F = 2e7

TEST(Station, NonFiniteRepliesGiveZeroForceAndANamedFault) {
  for (int field = 0; field < 5; ++field) {
    StationRig rig;
    rig.engage(kPush);
    link::Reply bad = rig.reply;
    if (field == 0) bad.force_w_nn.x() = kNan;
    if (field == 1) bad.tip_pos_w_nm.y() = std::numeric_limits<double>::infinity();
    if (field == 2) bad.deflection_nm = kNan;
    if (field == 3) bad.energy_in_aj = kNan;
    if (field == 4) bad.energy_out_aj = -std::numeric_limits<double>::infinity();
    const link::Reply good = rig.reply;
    rig.reply = bad;
    rig.tick();
    EXPECT_EQ(rig.force_n(), 0);
    EXPECT_STREQ(fault_name(rig.output.trace.faults), "reply not finite");
    EXPECT_TRUE(is_finite(rig.station.reply().force_w_nn));
    const auto sequence = rig.reply.sequence;
    rig.reply = good;
    rig.reply.sequence = sequence;
    rig.tick();
    EXPECT_LE(rig.force_n(), 1e-3 / 0.2 + 1e-12);  // comes back with the ramp
    rig.ticks(300);
    EXPECT_NEAR(rig.force_n(), 1, 1e-12);
  }
}

TEST(Station, ANonFiniteHandIsALatchedStop) {
  StationRig rig;
  rig.engage(kPush);
  rig.input.hand_pos_h_m.y() = kNan;
  rig.tick();
  EXPECT_EQ(rig.force_n(), 0);
  EXPECT_STREQ(fault_name(rig.output.trace.faults), "hand position not finite or not believable");
  EXPECT_TRUE(is_finite(rig.output.command.tip_pos_w_nm));
  EXPECT_TRUE(is_finite(rig.output.command.tip_vel_w_nm_s));
  EXPECT_TRUE(std::isfinite(rig.output.command.energy_in_j));
  rig.input.hand_pos_h_m.setZero();
  rig.ticks(10);
  EXPECT_EQ(rig.station.mode(), Mode::kStopped);
  EXPECT_TRUE(std::isfinite(rig.output.trace.energy_j));
}

TEST(Station, ANonFiniteAppliedForceIsALatchedStop) {
  StationRig rig;
  rig.engage(kPush);
  rig.input.applied_force_h_n.x() = kNan;
  rig.tick();
  EXPECT_EQ(rig.station.mode(), Mode::kStopped);
  EXPECT_STREQ(fault_name(rig.output.trace.faults), "applied force not finite or not believable");
  EXPECT_TRUE(std::isfinite(rig.output.trace.energy_j));
}

TEST(Station, AFiniteButImpossibleMeasurementBuysNoEnergy) {
  StationRig rig;
  rig.engage(kPush);
  const double before_j = rig.output.trace.account_j;
  rig.input.hand_pos_h_m.z() = -1e300;
  rig.tick();
  EXPECT_EQ(rig.station.mode(), Mode::kStopped);
  EXPECT_EQ(rig.output.trace.account_j, before_j);
  rig.input.hand_pos_h_m.z() = -1e-4;
  rig.input.applied_force_h_n.z() = 1e300;
  rig.tick();
  EXPECT_EQ(rig.output.trace.account_j, before_j);
}

TEST(Station, ABadTickGivesZeroForce) {
  for (double dt_s : {0.0, -1e-3, kNan, std::numeric_limits<double>::infinity()}) {
    StationRig rig;
    rig.engage(kPush);
    rig.station.step(rig.input, dt_s, rig.output);
    EXPECT_EQ(rig.force_n(), 0);
    EXPECT_STREQ(fault_name(rig.output.trace.faults), "bad tick length");
    EXPECT_TRUE(is_finite(rig.output.command.tip_vel_w_nm_s));
  }
}

TEST(Station, StopIsLatchedUntilAPersonClearsIt) {
  StationRig rig;
  rig.engage(kPush);
  rig.input.buttons |= device::kButtonStop;
  rig.tick();
  EXPECT_EQ(rig.force_n(), 0);  // at once
  EXPECT_EQ(rig.output.command.flags & link::kFlagStop, link::kFlagStop);
  rig.input.buttons &= ~device::kButtonStop;
  rig.ticks(1000);
  EXPECT_EQ(rig.force_n(), 0);
  EXPECT_EQ(rig.station.mode(), Mode::kStopped);
  rig.station.clear_stop();
  rig.tick();
  EXPECT_EQ(rig.station.mode(), Mode::kEngaged);
  EXPECT_LE(rig.force_n(), 1e-3 / 0.2 + 1e-12);
}

TEST(Station, VelocityTripIsLatched) {
  StationRig rig;
  rig.engage(kPush);
  rig.input.hand_pos_h_m.x() += 0.49e-3;
  rig.tick();
  EXPECT_EQ(rig.station.mode(), Mode::kEngaged);
  rig.input.hand_pos_h_m.x() += 0.51e-3;
  rig.tick();
  EXPECT_EQ(rig.station.mode(), Mode::kStopped);
  EXPECT_EQ(rig.force_n(), 0);
  EXPECT_STREQ(fault_name(rig.output.trace.faults), "hand faster than the velocity trip");
}

TEST(Station, AFailedDeviceStopsAndOneWithoutForceDisengages) {
  StationRig rig;
  rig.engage(kPush);
  rig.input.device_status = device::DeviceStatus::kForceOff;
  rig.tick();
  EXPECT_EQ(rig.station.mode(), Mode::kReady);
  rig.input.device_status = device::DeviceStatus::kFailed;
  rig.tick();
  EXPECT_EQ(rig.station.mode(), Mode::kStopped);
}

TEST(Station, AfterAStopTheTipStaysWhereItWithdrewTo) {
  StationRig rig;
  rig.engage(kPush);
  rig.input.buttons |= device::kButtonStop;
  rig.tick();
  rig.input.buttons &= ~device::kButtonStop;
  const Vec3 withdrawn_w_nm(100, 200, 140);
  rig.reply.fault_bits = link::kFaultRetracted;
  rig.reply.force_w_nn.setZero();
  for (int k = 0; k <= 100; ++k) {
    rig.reply.tip_pos_w_nm = Vec3(100, 200, 40 + k);
    rig.tick();
    ASSERT_EQ(rig.output.command.tip_vel_w_nm_s.norm(), 0);
  }
  rig.station.clear_stop();
  rig.tick();
  EXPECT_EQ(rig.station.mode(), Mode::kReady) << "the slave does not say yet that its tip follows again";
  EXPECT_EQ(rig.output.command.tip_vel_w_nm_s.norm(), 0);
  rig.reply.fault_bits = 0;
  rig.tick();
  EXPECT_EQ(rig.station.mode(), Mode::kEngaged);
  EXPECT_EQ(rig.output.command.tip_pos_w_nm, withdrawn_w_nm);
  EXPECT_EQ(rig.output.command.tip_vel_w_nm_s.norm(), 0);
}

TEST(Station, ForceComesBackWithTheRampAfterTheDeviceHadNone) {
  StationRig rig;
  rig.engage(Vec3(0, 0, 400));  // 8 N
  rig.input.device_status = device::DeviceStatus::kForceOff;
  for (int k = 0; k < 3; ++k) {
    rig.tick();
    rig.input.applied_force_h_n.setZero();
  }
  rig.input.device_status = device::DeviceStatus::kOk;
  rig.tick();
  EXPECT_LE(rig.force_n(), 8e-3 / 0.2 + 1e-12);
}

}  // namespace
}  // namespace telenano::station
