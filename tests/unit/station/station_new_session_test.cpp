// A session that is lost and comes again.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>

#include "telenano/master/station/station.h"
#include "tests/unit/station/station_rig.h"

namespace telenano::station {
namespace {

const Vec3 kPush(0, 0, 50);  // nN at the tip: 1 N at the hand with the default α_F = 2e7

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

/// A session that is resumed: its tip is where the hand was some steps ago, and comes back by the log. Where no log
/// goes on, the tip's own place counts.
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
    link::Welcome welcome = StationRig::welcome_with_log();
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

}  // namespace
}  // namespace telenano::station
