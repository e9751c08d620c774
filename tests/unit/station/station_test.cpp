#include "telenano/master/station/station.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/unit/station/station_rig.h"

namespace telenano::station {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
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

TEST(Station, ALostAndNewSessionIsHeldAndResumed) {
  StationRig rig;
  rig.engage(kPush);
  rig.input.session_up = false;
  double last_n = rig.force_n();
  for (int k = 0; k < 200; ++k) {
    rig.tick(false);
    ASSERT_LE(last_n - rig.force_n(), 2e-3 / 0.08);
    last_n = rig.force_n();
  }
  EXPECT_EQ(rig.force_n(), 0);
  EXPECT_EQ(rig.station.mode(), Mode::kHeld);
  rig.welcome.start_pos_w_nm = Vec3(1, 2, 3);
  rig.station.begin_session(rig.welcome);
  rig.reply.sequence = 0;  // sequences start again
  rig.input.session_up = true;
  rig.tick(false);
  EXPECT_EQ(rig.station.mode(), Mode::kHeld);
  rig.tick();
  EXPECT_EQ(rig.station.mode(), Mode::kEngaged);
  EXPECT_EQ(rig.output.command.tip_pos_w_nm, Vec3(1, 2, 3));
  EXPECT_LE(rig.force_n(), 1e-3 / 0.2 + 1e-12);
  rig.ticks(300);
  EXPECT_NEAR(rig.force_n(), 1, 1e-12);
}

/// A session that is taken up from a checkpoint: its tip is where the hand was some steps ago, and comes back by the
/// log. Where no log goes on, the tip's own place counts.
TEST(Station, ALogThatGoesOnIsTheAnchorAndNotWhereTheServerHasGotTo) {
  struct Case {
    const char* what;
    std::uint64_t executed;
    std::uint32_t epoch, breaks;
    bool at_log;
  };
  for (const Case& one :
       {Case{"the log goes on", 50, 1, 3, true}, Case{"all is executed", 100, 1, 3, false},
        Case{"of before a break", 50, 1, 2, true}, Case{"a break more: it has moved itself", 50, 1, 4, false},
        Case{"another slave", 50, 2, 0, false}, Case{"steps that nobody made", 200, 1, 3, false}}) {
    Station station{StationConfig{}, StationRig::device(), {10, 0, 500}};
    link::Welcome welcome;
    welcome.epoch = 1;
    welcome.feature_bits = link::kFeatureStepLog;
    welcome.workspace_min_w_nm = Vec3::Constant(-100);
    welcome.workspace_max_w_nm = Vec3::Constant(100);
    station.begin_session(welcome);
    StationInput input;
    StationOutput output;
    link::Reply reply;
    input.session_up = true;
    input.buttons = device::kButtonDeadman;
    input.reply = &reply;
    for (std::uint64_t k = 1; k <= 100; ++k) {
      input.time_ns = static_cast<std::int64_t>(k) * 1'000'000;
      input.next_step = reply.sequence = k;
      reply.steps.executed = k > 5 ? k - 5 : 0;
      reply.steps.breaks = 3;
      input.hand_pos_h_m = Vec3(0, 0, -1e-5 * static_cast<double>(k));
      station.step(input, 1e-3, output);
    }
    const Vec3 led_to = link::target_w_nm(output.step);
    ASSERT_LT(led_to.z(), -0.5);
    welcome.start_pos_w_nm = Vec3(0, 0, 7);
    welcome.epoch = one.epoch;
    welcome.steps.executed = one.executed;
    welcome.steps.breaks = one.breaks;
    station.begin_session(welcome);
    input.reply = nullptr;
    input.time_ns += 1'000'000;
    ++input.next_step;
    station.step(input, 1e-3, output);
    EXPECT_EQ(output.command.tip_pos_w_nm, one.at_log ? led_to : welcome.start_pos_w_nm) << one.what;
  }
}

TEST(Station, ANewSessionInContactMakesNoStep) {
  StationRig rig;
  rig.engage(kPush);
  rig.station.begin_session(rig.welcome);
  rig.reply.sequence = 0;
  double last_n = 1;
  for (int k = 0; k < 500; ++k) {
    rig.tick(k > 30);
    ASSERT_LE(std::fabs(rig.force_n() - last_n), 1e-3 / 0.08 + 1e-9) << k;
    last_n = rig.force_n();
  }
  EXPECT_NEAR(last_n, 1, 1e-12);
}

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

TEST(Station, AStifferSlaveThanPlannedIsALatchedStop) {
  // The server was replaced by one with another scene: scaling, damper and clamp were planned for the first.
  for (int field = 0; field < 2; ++field) {
    StationRig rig({}, {10, 0.001, 500});
    rig.welcome.coupling_stiffness_n_m = 10;
    rig.welcome.coupling_damping_n_s_m = 0.001;
    rig.engage(kPush);
    rig.station.begin_session(rig.welcome);  // the same again
    rig.reply.sequence = 0;
    rig.ticks(300);
    EXPECT_EQ(rig.station.mode(), Mode::kEngaged);
    if (field == 0) rig.welcome.coupling_stiffness_n_m = 11;
    if (field == 1) rig.welcome.coupling_damping_n_s_m = 0.002;
    rig.station.begin_session(rig.welcome);
    rig.reply.sequence = 0;
    rig.tick();
    EXPECT_EQ(rig.station.mode(), Mode::kStopped);
    EXPECT_EQ(rig.force_n(), 0);
    EXPECT_STREQ(fault_name(rig.output.trace.faults), "slave stiffer than planned");
  }
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

TEST(Station, ForceIsLimitedAndSlewed) {
  StationConfig config;
  config.method = control::Method::kNone;
  StationRig rig(config);
  rig.engage(Vec3(0, 0, 0));
  rig.reply.force_w_nn = Vec3(0, 0, 5000);  // 100 N
  rig.tick();
  EXPECT_NEAR(rig.force_n(), 4, 1e-9);  // 4000 N/s
  EXPECT_TRUE(rig.output.trace.slewed);
  rig.ticks(2);
  EXPECT_NEAR(rig.force_n(), 9.6, 1e-9);  // ε f̂_a
  EXPECT_TRUE(rig.output.trace.limited);
  EXPECT_LE(rig.force_n(), 9.6);
  rig.reply.force_w_nn = Vec3(0, 0, -5000);
  rig.tick();
  EXPECT_NEAR(rig.output.hand_force_h_n.z(), -4, 1e-9);  // a reversal grows from zero
  rig.reply.force_w_nn.setZero();
  rig.tick();
  EXPECT_EQ(rig.force_n(), 0);  // a decrease is never delayed
}

TEST(Station, HugeButFiniteForcesStayFiniteAndLimited) {
  StationRig rig;
  rig.engage(Vec3(1e300, -1e300, 1e300));
  EXPECT_TRUE(is_finite(rig.output.hand_force_h_n));
  EXPECT_LE(rig.force_n(), 9.6);
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

TEST(ForceLimits, SlewIsRotationFriendly) {
  bool cut = false;
  const Vec3 turned = limit_slew(Vec3(0, 3, 0), Vec3(3, 0, 0), 0.5, cut);
  EXPECT_TRUE(cut);
  EXPECT_NEAR(turned.norm(), 0.5, 1e-12);  // nothing of the old force acts in the new direction
  EXPECT_EQ(limit_slew(Vec3(2, 0, 0), Vec3(3, 0, 0), 0, cut), Vec3(2, 0, 0));
  EXPECT_FALSE(cut);
}

TEST(ForceLimits, NormNeverExceedsTheBound) {
  for (double bound : {1e-300, 1e-9, 0.1, 9.6, 1e9}) {
    for (double scale : {1.0000001, 3.0, 1e12}) {
      bool cut = false;
      const Vec3 f = limit_norm(bound * scale * Vec3(0.3, -0.5, 0.812), bound, cut);
      EXPECT_LE(f.norm(), bound);
    }
  }
}

}  // namespace
}  // namespace telenano::station
