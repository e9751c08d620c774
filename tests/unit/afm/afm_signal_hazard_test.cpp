// What a fault tree of the rig finds besides lost connections and signals that die. The force is the simulated
// rig's own. Here: signals that are exchanged, and answers that are no number.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>

#include "tests/support/virtual_afm_slave.h"
#include "tests/unit/afm/afm_bench.h"
#include "tests/unit/afm/hazard_bench.h"

namespace telenano::afm {
namespace {

using afm_sim::SensorFault;

TEST(AfmHazards, SignalsThatAreExchangedWhileItPressesWithdraw) {
  for (const int sign : {1, -1}) {
    for (const bool moves : {false, true}) {
      SCOPED_TRACE(::testing::Message() << sign << (moves ? ", pressing on" : ", at rest first"));
      Bench b;
      b.config.sensitivity_nm_v = b.rig.deflection_nm_v = sign * 50;
      b.start();
      ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
      b.follow(Vec3(0, 0, -4));
      b.run(1000);
      ASSERT_GT(b.afm->controller().tip().normal_force_nn(), 80);
      // Without the controller's own protection.
      b.afm->apply({0, afm_sim::FaultKind::kSensor, 0, 0, SensorFault::kSwapped});
      // At rest the two may differ by less than the noise of the lateral one: then the next motion tells.
      if (!moves) b.run(400);
      b.follow(Vec3(0, 0, -20));
      b.run(400);
      EXPECT_EQ(name(b.afm->logic().state().cause), "signal not plausible") << b.afm->logic().news();
      // Else a step, and the way of two readings at full speed.
      expect_withdrawn(b, moves ? 1 : 1 + b.config.speed_nm_s * 2 * b.config.period_s() / b.config.step_nm);
    }
  }
}

// In the air both may stand at the same value: then only touching tells, by the other signal.
TEST(AfmHazards, SignalsThatAreExchangedInTheAirWithdrawAtTheTouch) {
  Bench b;
  b.rig.deflection_offset_nm = 0;
  b.rig.thermal_nm = 0;
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
  b.follow(Vec3(0, 0, 10));
  b.run(500);
  b.afm->controller().tip().forget_peak();
  b.afm->apply({0, afm_sim::FaultKind::kSensor, 0, 0, SensorFault::kSwapped});
  for (int i = 0; i < 300; ++i) {
    b.follow(Vec3(0, 0, std::max(10 - 0.1 * i, -30.0)));
    b.run(10);
  }
  EXPECT_EQ(name(b.afm->logic().state().cause), "signal not plausible") << b.afm->logic().news();
  expect_withdrawn(b, 0);
}

TEST(AfmHazards, SignalsThatAreExchangedInAnApproachWithdraw) {
  for (const Phase phase : {Phase::kEngaging, Phase::kTaring, Phase::kTouching}) {
    SCOPED_TRACE(name(phase));
    Bench b;
    b.rig.deflection_offset_nm = 0;
    b.rig.thermal_nm = 0;
    b.start();
    ASSERT_TRUE(b.until(phase));
    b.run(100);
    b.afm->apply({0, afm_sim::FaultKind::kSensor, 0, 0, SensorFault::kSwapped});
    b.run(8000);
    EXPECT_TRUE(b.afm->controller().withdrawn()) << name(b.phase());
    EXPECT_EQ(b.phase(), Phase::kWithdrawn);
    // The Z controller goes on at its speed until two readings have shown it.
    const double late_nn =
        b.config.spring_constant_n_m * b.rig.approach_nm_s * (2 * b.config.period_s() + 0.01);
    EXPECT_LE(b.afm->controller().tip().peak_force_nn(),
              b.config.force_max_nn + (phase == Phase::kEngaging ? late_nn : 40))
        << b.afm->logic().news();
  }
}

// Any other signal that is alive and shows no force, by another client's or an operator's hand: SafeTip, which
// still watches the right one, sees what is not read.
TEST(AfmHazards, AnotherSignalThanSafeTipsIsFound) {
  Bench b;
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing));
  b.follow(Vec3(0, 0, 10));
  b.run(500);
  // SafeTip's was changed instead, which looks the same from here: it now sees the height, some 10 nm.
  b.afm->controller().watch_by_safe_tip(afm_sim::kZSignal);
  b.run(8000);
  EXPECT_TRUE(b.afm->controller().withdrawn()) << b.afm->logic().news();
  EXPECT_NE(b.phase(), Phase::kFollowing);
}

// Answers and targets that are no number, while it presses.
TEST(AfmHazards, WhatIsNoNumberMovesNothing) {
  const double no_number = std::numeric_limits<double>::quiet_NaN();
  const double infinite = std::numeric_limits<double>::infinity();
  for (const double value : {no_number, infinite, -infinite}) {
    Bench b;
    b.start();
    ASSERT_TRUE(b.until(Phase::kFollowing));
    b.follow(Vec3(0, 0, -4));
    b.run(500);
    for (const AfmOp op : {AfmOp::kRead, AfmOp::kAskStatus}) {
      VirtualAfm copy = *b.afm;
      const Role role = op == AfmOp::kRead ? Role::kReads : Role::kData;
      while (copy.logic().waits_for(role) == nullptr || copy.logic().waits_for(role)->op != op)
        copy.advance_to(copy.now_ns() + kMs, b.wish);
      AfmReading wrong;
      wrong.kind = op == AfmOp::kRead ? ReadingKind::kSignals : ReadingKind::kStatus;
      wrong.numbers = {value, 0, value, 0};
      wrong.status = AfmStatus::kOff;
      copy.logic().answered(role, wrong, copy.now_ns());
      b.wish.time_ns = copy.now_ns();
      copy.advance_to(copy.now_ns() + 400 * kMs, b.wish);
      EXPECT_TRUE(copy.controller().withdrawn()) << copy.logic().news();
      EXPECT_LT(copy.controller().tip().peak_force_nn(), b.config.force_max_nn);
    }
    support::VirtualAfmSlave slave(*b.afm);
    slave::SlaveInput input;
    slave::SlaveOutput output;
    input.follow = true;
    input.by_operator = true;
    input.tip_target_pos_w_nm = Vec3(0, 0, value);
    for (int i = 0; i < 200; ++i) {
      slave.step(input, 0.001, output);
      EXPECT_TRUE(std::isfinite(output.force_w_nn.norm()) && std::isfinite(output.tip_pos_w_nm.norm()));
      ASSERT_TRUE((output.fault_bits & link::kFaultNonFinite) != 0);
    }
    EXPECT_LT(slave.afm().controller().tip().peak_force_nn(), b.config.force_max_nn);
  }
}

}  // namespace
}  // namespace telenano::afm
