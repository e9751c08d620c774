// Replies that are old or do not come, and ticks that are late.
#include <gtest/gtest.h>

#include <cmath>

#include "telenano/master/station/station.h"
#include "tests/unit/station/station_rig.h"

namespace telenano::station {
namespace {

const Vec3 kPush(0, 0, 50);  // nN at the tip: 1 N at the hand with the default α_F = 2e7

TEST(Station, HoldsThenFadesAStaleForceInItsStatedTimes) {
  StationRig rig;
  rig.engage(kPush);
  for (int ms = 1; ms <= 20; ++ms) {
    rig.tick(false);
    ASSERT_NEAR(rig.force_n(), 1, 1e-12) << ms;
  }
  for (int ms = 21; ms < 100; ++ms) {
    rig.tick(false);
    ASSERT_NEAR(rig.force_n(), (100 - ms) / 80.0, 1e-9) << ms;
    ASSERT_TRUE(rig.output.trace.faults & kFaultStale);
  }
  rig.tick(false);
  EXPECT_EQ(rig.force_n(), 0);
  EXPECT_EQ(rig.station.mode(), Mode::kHeld);
  EXPECT_FALSE(rig.output.command.flags & link::kFlagClutch);
  EXPECT_NEAR(rig.output.trace.stale_s, 0.1, 1e-12);
}

// Replies come in every tick, but each is old. The fade is the stale one's: 80 ms; the way back is the ramp
// of 200 ms, from zero.
TEST(Station, ARoundTripTooLongFadesTheForceAndHoldsTheTipUntilItIsShort) {
  using control::Method;
  for (const Method method : {Method::kNone, Method::kKs, Method::kKsClamp}) {
    StationConfig config;
    config.method = method;
    StationRig rig(config);
    rig.input.rtt_s = 0.39;
    rig.engage(kPush);
    ASSERT_NEAR(rig.force_n(), 1, 1e-12) << "below 0.4 s all is as ever";
    ASSERT_EQ(rig.output.trace.faults, 0u);
    rig.input.rtt_s = 0.41;
    double last_n = rig.force_n();
    for (int ms = 0; ms < 80; ++ms) {
      rig.tick();
      ASSERT_NEAR(rig.force_n(), (80 - ms) / 80.0, 1e-9) << ms;
      ASSERT_EQ(rig.output.trace.faults, kFaultOld) << ms;
      ASSERT_LE(rig.force_n(), last_n);
      last_n = rig.force_n();
    }
    rig.ticks(2);
    EXPECT_EQ(rig.force_n(), 0);
    EXPECT_EQ(rig.station.mode(), Mode::kHeld);
    EXPECT_FALSE(rig.output.command.flags & link::kFlagClutch) << "the slave holds the tip";
    EXPECT_STREQ(fault_name(rig.output.trace.faults), "round trip too long for the method");
    rig.input.rtt_s = 0.33;
    rig.ticks(100);
    EXPECT_EQ(rig.force_n(), 0) << "not back and forth about the limit";
    rig.input.rtt_s = 0.31;
    for (int ms = 1; ms <= 200; ++ms) {
      rig.tick();
      ASSERT_EQ(rig.output.trace.faults, 0u);
      ASSERT_NEAR(rig.force_n(), ms / 200.0, 1e-9) << ms;
    }
    EXPECT_EQ(rig.station.mode(), Mode::kEngaged);
  }
}

TEST(Station, HowOldAForceMayBeIsTheMethodsOrThePersons) {
  using control::Method;
  StationConfig config;
  EXPECT_EQ(config.age_most_s(Method::kKs), 0.4);
  EXPECT_EQ(config.age_most_s(Method::kTank), 0.5);
  EXPECT_EQ(config.age_most_s(Method::kWave), 0.5);
  EXPECT_EQ(config.age_most_s(Method::kTdpa), 0.5);
  EXPECT_EQ(config.age_most_s(Method::kModel), 0.8);
  config.force_age_s = 0.1;
  EXPECT_EQ(config.age_most_s(Method::kKs), 0.1);
  EXPECT_EQ(config.age_most_s(Method::kModel), 0.1);
  EXPECT_EQ(config.age_most_s(Method::kTwin), HUGE_VAL) << "it has two of its own";
}

TEST(Station, TheSameReplyAgainDoesNotCountAsNew) {
  StationRig rig;
  rig.engage(kPush);
  for (int ms = 0; ms < 100; ++ms) {
    rig.tick(false);
    rig.input.reply = &rig.reply;  // the next tick() sets it again; step by hand
    rig.input.time_ns += 1'000'000;
    rig.station.step(rig.input, 1e-3, rig.output);
    rig.input.applied_force_h_n = rig.output.hand_force_h_n;
  }
  EXPECT_EQ(rig.force_n(), 0);
}

TEST(Station, ALongRoundTripNeverTripsTheStalePolicy) {
  StationRig rig;
  rig.reply.measurement_age_ns = 2'000'000'000;
  rig.reply.command_sequence = 1;
  rig.engage(kPush);
  rig.ticks(500);
  EXPECT_NEAR(rig.force_n(), 1, 1e-12);
}

TEST(Station, ResumesWithoutAForceStepAfterAnyOutage) {
  for (int outage_ms = 1; outage_ms <= 400; outage_ms += 7) {
    StationRig rig;
    rig.engage(kPush);
    rig.ticks(outage_ms, false);
    double last_n = rig.force_n();
    rig.reply.force_w_nn = Vec3(0, 0, 300);  // six times as much: the hand has pushed on meanwhile
    rig.tick();
    if (outage_ms >= 20) {
      // The new force may not be larger than the old one, plus one tick of the ramp.
      ASSERT_LE(rig.force_n(), last_n + 6 * 1e-3 / 0.2 + 1e-9) << outage_ms;
    }
    last_n = rig.force_n();
    for (int k = 0; k < 300; ++k) {
      rig.tick();
      ASSERT_LE(rig.force_n() - last_n, outage_ms >= 20 ? 6 * 1e-3 / 0.2 + 1e-9 : 4.0 + 1e-9) << outage_ms;
      last_n = rig.force_n();
    }
    EXPECT_NEAR(rig.force_n(), 6, 1e-9);
  }
}

TEST(Station, HeldTipDoesNotJumpOnResume) {
  StationRig rig;
  rig.engage(kPush);
  rig.ticks(100, false);
  const Vec3 held_w_nm = rig.output.command.tip_pos_w_nm;
  for (int k = 0; k < 200; ++k) {
    rig.input.hand_pos_h_m.z() -= 1e-4;  // 20 mm during the outage
    rig.tick(false);
  }
  EXPECT_EQ(rig.output.command.tip_pos_w_nm, held_w_nm);
  rig.tick(true);
  EXPECT_EQ(rig.station.mode(), Mode::kEngaged);
  EXPECT_EQ(rig.output.command.tip_pos_w_nm, held_w_nm);
}

TEST(Station, ALateTickBuysNoForceStep) {
  // The process was kept from running: nothing has been shown for that time, so ramp and slew may grow by one
  // period only.
  for (int late_ms : {5, 15, 50, 90}) {
    StationRig rig;
    rig.engage(kPush);
    rig.reply.force_w_nn = Vec3(0, 0, 300);  // six times as much
    ++rig.reply.sequence;
    rig.input.reply = &rig.reply;
    rig.input.time_ns += late_ms * 1'000'000;
    rig.station.step(rig.input, 1e-3 * late_ms, rig.output);
    // Within the hold time the slew limit holds, 4 N a tick; later the force begins with a ramp as well.
    ASSERT_LE(rig.force_n() - 1, late_ms <= 20 ? 4.0 + 1e-9 : 6 * 1e-3 / 0.2 + 1e-9) << late_ms;
  }
}

TEST(Station, ABlindStationDoesNotMoveTheTip) {
  // A pause of the whole process, long enough to be an outage, that ends with the reply that waited in the
  // socket: the hand has moved unseen, and the tip must not leap after it.
  StationRig rig;
  rig.engage(kPush);
  const Vec3 before_w_nm = rig.output.command.tip_pos_w_nm;
  rig.input.hand_pos_h_m.z() -= 0.02;
  ++rig.reply.sequence;
  rig.input.reply = &rig.reply;
  rig.input.time_ns += 150'000'000;
  rig.station.step(rig.input, 0.150, rig.output);
  EXPECT_EQ(rig.station.latched_faults(), 0u);
  EXPECT_EQ(rig.output.command.tip_pos_w_nm, before_w_nm);
  rig.tick();
  EXPECT_EQ(rig.station.mode(), Mode::kEngaged);
  EXPECT_EQ(rig.output.command.tip_pos_w_nm, before_w_nm);
}

}  // namespace
}  // namespace telenano::station
