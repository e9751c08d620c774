// What a fault tree of the rig finds besides lost connections and signals that die: signals exchanged, units
// mistaken, somebody else at the controller, a controller that was started anew, answers that are no number.
// The force is the simulated rig's own.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <string>

#include "telenano/common/base/det_math.h"
#include "tests/support/virtual_afm_slave.h"
#include "tests/unit/afm/afm_bench.h"
#include "tests/unit/afm/step_scene.h"

namespace telenano::afm {
namespace {

using enum nanonis::CommandId;
using afm_sim::SensorFault;

void ask(Bench& b, nanonis::CommandId id, std::vector<double> numbers) {
  b.afm->controller().begin({id, std::move(numbers)}, -1, b.afm->now_ns());
}

/// Withdrawn by the logic itself, at a force that the limit and some steps of one reading explain.
void expect_withdrawn(Bench& b, double steps) {
  EXPECT_TRUE(b.afm->controller().withdrawn());
  EXPECT_EQ(b.afm->controller().safe_tips(), 0u) << "by the logic, not by the controller";
  EXPECT_LE(b.afm->controller().tip().peak_force_nn(),
            b.config.force_max_nn + steps * b.config.spring_constant_n_m * b.config.step_nm)
      << b.afm->logic().news();
}

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

TEST(AfmHazards, WhoChangesWhatTheStartHasSetEndsTheSession) {
  struct Case {
    const char* what;
    void (*change)(Bench&);
  };
  const Case cases[] = {
      {"calibration of the deflection", [](Bench& b) { b.afm->controller().scale_calibration(0.5); }},
      {"SafeTip was switched off", [](Bench& b) { ask(b, kSafeTipOnOffSet, {2}); }},
      {"SafeTip's settings",
       [](Bench& b) {
         ask(b, kSafeTipPropsSet, {0, 0, 1e-3});
       }},
      {"Z limits were switched off", [](Bench& b) { ask(b, kLimitsEnabledSet, {0}); }},
      {"acquisition period", [](Bench& b) { ask(b, kAcqPeriodSet, {0.02}); }},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(c.what);
    Bench b;
    b.config.stale_force_ms = 500;  // so that not the force's age tells
    b.start();
    ASSERT_TRUE(b.until(Phase::kFollowing));
    b.follow(Vec3(0, 0, -4));
    b.run(1000);
    c.change(b);
    b.run(2000);
    EXPECT_TRUE(b.afm->controller().withdrawn());
    EXPECT_NE(b.afm->logic().refusal().find(c.what), std::string::npos)
        << b.afm->logic().refusal() << b.afm->logic().news();
    expect_withdrawn(b, 1);
    // And nobody comes back over it.
    ++b.wish.clears;
    b.run(3000);
    EXPECT_TRUE(b.afm->controller().withdrawn());
  }
}

// Its program was ended and begun again: connections are made anew, but what the start had set is gone.
TEST(AfmHazards, AControllerThatWasStartedAnewIsNotApproachedWith) {
  Bench b;
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing));
  b.follow(Vec3(0, 0, -4));
  b.run(500);
  b.afm->cut(300 * kMs);
  b.run(150);
  b.afm->controller().restart();
  ASSERT_TRUE(b.until(Phase::kWithdrawn)) << b.afm->logic().news();
  ask(b, kLimitsEnabledSet, {1});  // as the guard leaves it
  const auto moves = b.afm->controller().moves();
  b.afm->controller().tip().forget_peak();
  ++b.wish.clears;
  b.run(5000);
  EXPECT_EQ(b.afm->controller().moves(), moves) << "nothing moves";
  EXPECT_TRUE(b.afm->controller().withdrawn());
  EXPECT_NE(b.afm->logic().refusal().find("SafeTip was switched off"), std::string::npos)
      << b.afm->logic().refusal();
}

TEST(AfmHazards, AUnitMistakenForTheDeflectionIsRefused) {
  for (const double factor : {0.001, 0.1, 10.0, 1000.0}) {
    SCOPED_TRACE(factor);
    Bench b;
    b.config.sensitivity_nm_v = 50 * factor;
    b.start();
    b.run(1000);
    EXPECT_EQ(b.phase(), Phase::kRefused);
    EXPECT_EQ(b.afm->controller().moves(), 0u);
    EXPECT_NE(b.afm->logic().refusal().find("sensitivity_nm_v"), std::string::npos)
        << b.afm->logic().refusal();
  }
}

// Where the controller's calibration is as wrong as the file, what the lever does in contact tells: it cannot
// bend by more than its base moves.
TEST(AfmHazards, ALeverThatBendsByMoreThanItsBaseMovesIsRefused) {
  Bench b;
  b.config.sensitivity_nm_v = 150;
  b.rig.deflection_nm_v = 50;
  b.rig.safe_tip_signal = afm_sim::kDeflectionSignal;
  b.start();
  b.afm->controller().scale_calibration(3);
  for (int i = 0; i < 30000 && !b.afm->logic().finished() && b.phase() != Phase::kFollowing; ++i) b.run(1);
  b.run(200);
  EXPECT_EQ(b.phase(), Phase::kWithdrawn) << b.afm->logic().news();
  EXPECT_NE(b.afm->logic().refusal().find("by more than its base moved"), std::string::npos)
      << b.afm->logic().refusal() << b.afm->logic().news();
  EXPECT_LT(b.afm->controller().tip().peak_force_nn(), b.config.force_max_nn);
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

// Ten minutes on a rig whose drift goes up and down, with creep of any size, touched every ten seconds at
// least: W's zero, the rig's own, and the bound that the slave states. Then a minute in the air.
TEST(AfmHazards, WsZeroAndItsBoundOnRigsOfAnyDriftAndCreep) {
  constexpr int kRigs = 8;
  double worst_nm = 0;
  int within = 0, all = 0, air_within = 0, air_all = 0;
  for (int seed = 1; seed <= kRigs; ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    Bench b;
    const int sign = random.chance(0.5) ? 1 : -1;
    const double period_s = random.uniform(100, 900), phase = random.uniform(0, 6);
    b.rig.seed = static_cast<std::uint64_t>(seed);
    b.rig.creep = random.uniform(0, 0.0045);
    b.rig.creep_s = random.uniform(6, 60);
    b.start();
    const auto run = [&](int ms) {
      for (int i = 0; i < ms; i += 10) {
        const double t_s = 1e-9 * static_cast<double>(b.afm->now_ns());
        b.afm->controller().tip().set_drift_z_nm_s(
            sign * (0.275 + 0.225 * det_sin_cos(2 * std::numbers::pi * t_s / period_s + phase).sin));
        b.run(10);
      }
    };
    for (int i = 0; i < 3000 && b.phase() != Phase::kFollowing; ++i) run(10);
    ASSERT_EQ(b.phase(), Phase::kFollowing) << b.afm->logic().news();
    const auto off_nm = [&] {
      return b.afm->logic().state().base_w_nm.z() - b.afm->controller().tip().base_w_nm().z();
    };
    b.follow(Vec3(0, 0, 10));
    run(100);
    const double first_nm = off_nm();
    for (double t_s = 0; t_s < 600 && b.phase() == Phase::kFollowing;) {
      const int wait_ms = static_cast<int>(1000 * random.uniform(2, 7.5));
      b.follow(Vec3(0, 0, 5));
      for (int t = 0; t < wait_ms; t += 100) {
        run(100);
        const double off = std::fabs(off_nm() - first_nm);
        worst_nm = std::max(worst_nm, off);
        ++all;
        if (off <= b.afm->logic().state().surface_bound_nm) ++within;
      }
      for (int i = 0; i < 100; ++i) {  // down to -5 at 10 nm/s
        b.follow(Vec3(0, 0, 5 - 0.1 * i));
        run(10);
      }
      run(1500);
      t_s += 2.5 + 1e-3 * wait_ms;
    }
    b.follow(Vec3(0, 0, 15));
    for (int t = 0; t < 60'000 && b.phase() == Phase::kFollowing; t += 100) {
      run(100);
      ++air_all;
      if (std::fabs(off_nm() - first_nm) <= b.afm->logic().state().surface_bound_nm) ++air_within;
    }
    EXPECT_EQ(b.phase(), Phase::kFollowing) << b.afm->logic().news();
  }
  std::printf(
      "%d rigs: W's zero off by at most %.2f nm; the bound covered %.1f %%, in a minute of air %.1f %%\n",
      kRigs, worst_nm, 100.0 * within / all, 100.0 * air_within / air_all);
  EXPECT_LE(worst_nm, 2);
  EXPECT_GE(within, 0.95 * all);
  EXPECT_GE(air_within, 0.95 * air_all);
}

/// How steep the way of a ball's middle is where the ball meets the corner of a step.
double steepness(double height_nm) {
  constexpr double r = 20;
  const double down = r - height_nm;
  return std::sqrt(r * r - down * down) / down;
}

/// What the tip has truly felt while a hand led it 140 nm against a step, pressing down `depth_nm` below the
/// ground (negative: above it).
struct Ran {
  double down_nn = 0, across_nn = 0, along_nn = 0;  // most; across and along the lever either way
  double pressed_nn = 0, end_nm = 0;
  bool still_there = false;
  double base_x_nm = 0, base_y_nm = 0;
};

Ran run_against(Bench& b, std::shared_ptr<const scene::Scene> scene, int direction_deg, double depth_nm,
                int ms = 6000) {
  b.afm.emplace(b.config, b.rig, std::move(scene));
  EXPECT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
  b.follow(Vec3(0, 0, -depth_nm));
  b.run(1000);
  Ran ran;
  const auto& tip = b.afm->controller().tip();
  ran.pressed_nn = tip.normal_force_nn();
  const Vec3 way = direction_deg == 0     ? Vec3(140, 0, 0)
                   : direction_deg == 180 ? Vec3(-140, 0, 0)
                   : direction_deg == 90  ? Vec3(0, 140, 0)
                                          : Vec3(0, -140, 0);
  b.follow(way + Vec3(0, 0, -depth_nm));
  for (int i = 0; i < ms; ++i) {
    b.run(1);
    const Vec3& force = tip.force_w_nn();
    ran.down_nn = std::max(ran.down_nn, force.z());
    ran.across_nn = std::max(ran.across_nn, std::fabs(force.x()));
    ran.along_nn = std::max(ran.along_nn, std::fabs(force.y()));
  }
  ran.still_there = b.phase() == Phase::kFollowing;
  ran.base_x_nm = b.afm->logic().state().base_w_nm.x();
  ran.base_y_nm = b.afm->logic().state().base_w_nm.y();
  EXPECT_EQ(b.afm->controller().safe_tips(), 0u);
  return ran;
}

// A hand that scans runs the tip against a step, up to one that is as high as the tip's radius and more, where
// the ball meets a wall: as fast as the rig goes, pressed hard, pressed lightly, and a little above the ground,
// where no reading warns. The lever of this rig is rigid across: nothing but the contact yields.
TEST(AfmHazards, ATipThatRunsAgainstAStepIsHeld) {
  for (const double height_nm : {5.0, 15.0, 20.0, 40.0}) {
    for (const double speed_nm_s : {1000.0, 200.0}) {
      if (speed_nm_s < 1000 && height_nm != 20) continue;
      for (const double depth_nm : {-3.0, 1.5, 4.0}) {
        const int direction_deg = depth_nm == 1.5 ? 180 : 0;
        SCOPED_TRACE(::testing::Message() << height_nm << " nm at " << speed_nm_s << " nm/s, " << depth_nm
                                          << " nm below the ground");
        Bench b;
        b.config.speed_nm_s = speed_nm_s;
        const Ran ran = run_against(b, with_a_step(height_nm, direction_deg, 2), direction_deg, depth_nm);
        std::printf("%g nm at %g nm/s, pressed with %.0f nN: %.0f nN down, %.0f nN across, at x = %.1f nm\n",
                    height_nm, speed_nm_s, ran.pressed_nn, ran.down_nn, ran.across_nn, ran.base_x_nm);
        EXPECT_LE(ran.down_nn, b.config.force_max_nn + 5) << "noise, and bending with temperature";
        EXPECT_LE(ran.across_nn, b.config.lateral_max_nn);
        EXPECT_TRUE(ran.still_there) << b.afm->logic().news();
        // What stands in the way was met; what is lower than the limit lets it climb was climbed.
        EXPECT_GT(std::fabs(ran.base_x_nm), 15);
        if (height_nm >= 15) {
          EXPECT_LT(std::fabs(ran.base_x_nm), 62);
        }
      }
    }
  }
}

// What the rule is for: where the operator says that there is no relief, the first reading after the corner
// tells, and a few nanometres too late.
TEST(AfmHazards, WhoSaysThatThereIsNoReliefGetsTheForceOfTheFirstReading) {
  Bench b;
  b.config.relief_nm = 0;
  const Ran ran = run_against(b, with_a_step(15), 0, 4, 2000);
  EXPECT_GT(ran.across_nn, 2 * b.config.lateral_max_nn);
  EXPECT_FALSE(ran.still_there);
  EXPECT_EQ(name(b.afm->logic().state().cause), "lateral force limit") << b.afm->logic().news();
}

// Along the lever no signal shows the force (derived in across_rule.h). Where nobody has said how steep the sample
// is, the tip is not led there near the ground: begun as close to a step as can be, whichever way the lever
// points, and pressing or a little above the ground.
TEST(AfmHazards, AlongTheLeverNothingIsMetWhereNoSlopeIsKnown) {
  double most_nn = 0;
  for (const char* points : {"", "+y", "-y"}) {
    for (const int direction_deg : {90, 270}) {
      for (const double height_nm : {5.0, 15.0}) {
        for (const double depth_nm : {-3.0, 4.0}) {
          SCOPED_TRACE(::testing::Message() << height_nm << " nm towards " << direction_deg << ", lever "
                                            << points << ", " << depth_nm << " nm below the ground");
          const double side = direction_deg == 90 ? 1 : -1;
          Bench b;
          b.afm.emplace(b.config, b.rig, with_a_step(height_nm, direction_deg, 2, points));
          ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
          const auto& tip = b.afm->controller().tip();
          // High above to beside the step, and down there: as close as the force along is at most 40 nN.
          double from_nm = 20;
          for (const double part_nm : {1.0, 0.1}) {
            const auto meets = [&](double y_nm) {
              b.follow(Vec3(0, side * y_nm, 55));
              b.run(500);
              b.follow(Vec3(0, side * y_nm, -depth_nm));
              b.run(1000);
              const bool met = std::fabs(tip.force_w_nn().y()) > 40;
              b.follow(Vec3(0, side * y_nm, 55));
              b.run(300);
              return met;
            };
            while (from_nm < 60 && !meets(from_nm + part_nm)) from_nm += part_nm;
          }
          b.follow(Vec3(0, side * from_nm, 55));
          b.run(500);
          b.follow(Vec3(0, side * from_nm, -depth_nm));
          b.run(1000);
          ASSERT_LT(std::fabs(tip.force_w_nn().y()), 60) << "from " << from_nm;
          ASSERT_GT(from_nm, 20);
          b.follow(Vec3(0, side * 140, -depth_nm));
          for (int i = 0; i < 3000; ++i) {
            b.run(1);
            most_nn = std::max(most_nn, std::fabs(tip.force_w_nn().y()));
            ASSERT_LE(std::fabs(tip.force_w_nn().y()), b.config.lateral_max_nn);
          }
          EXPECT_EQ(b.phase(), Phase::kFollowing) << b.afm->logic().news();
          EXPECT_TRUE(b.afm->logic().state().held_by_force);
          EXPECT_NE(b.afm->logic().news().find("held along the lever"), std::string::npos);
          EXPECT_NEAR(side * b.afm->logic().state().base_w_nm.y(), from_nm, 0.2 + 1e-9);
          // High enough above the ground it is led.
          b.follow(Vec3(0, side * 140, 55));
          b.run(2000);
          EXPECT_NEAR(side * b.afm->logic().state().base_w_nm.y(), 140, 0.5);
        }
      }
    }
  }
  std::printf("where no slope is known: at most %.0f nN along\n", most_nn);
  EXPECT_GT(most_nn, 40) << "the wall was met";
}

// Who says how steep it is goes along the lever, and up the steps that are no steeper, with less force down.
TEST(AfmHazards, AlongTheLeverAKnownSlopeHoldsTheForceDown) {
  for (const char* points : {"", "+y", "-y"}) {
    for (const int direction_deg : {90, 270}) {
      for (const double height_nm : {2.5, 5.0}) {
        SCOPED_TRACE(::testing::Message()
                     << height_nm << " nm towards " << direction_deg << ", lever " << points);
        Bench b;
        b.config.along_slope = steepness(height_nm);
        const Ran ran = run_against(b, with_a_step(height_nm, direction_deg, 2, points), direction_deg, 30);
        std::printf(
            "%g nm towards %d, lever %s: told %.2f, pressed with %.0f nN: %.0f nN down, %.0f nN along, at y "
            "= %.0f "
            "nm\n",
            height_nm, direction_deg, *points != 0 ? points : "rigid along", b.config.along_slope,
            ran.pressed_nn, ran.down_nn, ran.along_nn, ran.base_y_nm);
        EXPECT_LE(ran.along_nn, b.config.lateral_max_nn);
        EXPECT_GT(ran.along_nn, 20) << "the step was met";
        EXPECT_GT(std::fabs(ran.base_y_nm), 80) << "and climbed";
        EXPECT_TRUE(ran.still_there);
      }
    }
  }
}

// What the slope is for: who says too little gets the force of the step.
TEST(AfmHazards, AlongTheLeverASlopeThatIsToldTooSmallPassesTheLimit) {
  Bench b;
  b.config.along_slope = 0.5;
  const Ran ran = run_against(b, with_a_step(15, 90), 90, 4);
  std::printf(
      "15 nm along the lever, told a slope of 0.5, pressed with %.0f nN: %.0f nN down, %.0f nN along\n",
      ran.pressed_nn, ran.down_nn, ran.along_nn);
  EXPECT_GT(ran.along_nn, 2 * b.config.lateral_max_nn);
  EXPECT_LE(ran.along_nn, steepness(15) * (b.config.force_max_nn + 5));
}

// A signal of the force across that stands still, as that of a broken cable, gives no leave to come near the
// ground, nor to move across there.
TEST(AfmHazards, AFrozenLateralSignalKeepsTheTipAboveTheRelief) {
  for (const double noise_nn : {0.0, 0.02}) {
    Bench b;
    b.rig.lateral_noise_nn_sqrt_hz = noise_nn;
    b.start();
    ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
    b.afm->controller().tip().forget_peak();
    b.follow(Vec3(0, 0, -2));
    b.run(1000);
    b.follow(Vec3(10, 0, -2));
    b.run(2000);
    EXPECT_EQ(b.phase(), Phase::kFollowing) << b.afm->logic().news();
    const auto& tip = b.afm->controller().tip();
    EXPECT_NEAR(b.afm->logic().state().base_w_nm.x(), 10, 0.5);
    if (noise_nn > 0) {
      EXPECT_GT(tip.peak_force_nn(), 20);
    } else {
      EXPECT_EQ(tip.peak_force_nn(), 0);
      EXPECT_NEAR(b.afm->logic().state().base_w_nm.z(), b.config.relief_nm, 0.1);
      EXPECT_NE(b.afm->logic().news().find("the lateral signal stands still"), std::string::npos);
    }
  }
}

// What it costs: over flat ground, in contact, at so many readings a second.
TEST(AfmHazards, HowFastTheRuleLeads) {
  for (const double rate_hz : {100.0, 200.0, 1000.0}) {
    Bench b;
    b.config.force_rate_hz = rate_hz;
    b.rig.acquisition_s = 1 / rate_hz;
    b.start();
    ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
    b.follow(Vec3(0, 0, -2));
    b.run(1000);
    b.follow(Vec3(400, 0, -2));
    b.run(1000);
    const double led_nm = b.afm->logic().state().base_w_nm.x();
    const double s_nm =
        AcrossRule::kAcrossPart * AcrossRule::kPart * b.config.lateral_max_nn / b.config.across_n_m;
    std::printf("%g readings a second: %.1f nm/s, %.2f of s a period\n", rate_hz, led_nm,
                led_nm / (s_nm * rate_hz));
    // At most s for each two windows, at least s for each three and the round trip.
    EXPECT_LE(led_nm, 1.05 * s_nm * 0.5 * rate_hz);
    EXPECT_GE(led_nm, s_nm / (3 / rate_hz + 0.003));
  }
}

// The rule across where larger Z is towards the sample and both signals have the other sign.
TEST(AfmHazards, TheRuleAcrossHoldsWithEverySignTheOtherWay) {
  for (const int direction_deg : {0, 180}) {
    SCOPED_TRACE(direction_deg);
    Bench b;
    b.config.z_sign = b.rig.z_sign = -1;
    b.config.sensitivity_nm_v = b.rig.deflection_nm_v = -50;
    b.config.lateral_nn_v = b.rig.lateral_nn_v = -100;
    const Ran ran = run_against(b, with_a_step(15, direction_deg), direction_deg, 4, 3000);
    EXPECT_LE(ran.down_nn, b.config.force_max_nn + 5);
    EXPECT_LE(ran.across_nn, b.config.lateral_max_nn);
    EXPECT_GT(ran.across_nn, 0.5 * b.config.lateral_max_nn) << "it was met";
    EXPECT_TRUE(ran.still_there) << b.afm->logic().news();
  }
}

/// Down to `depth_nm`, and `high_nm` up in between if that is positive, while the photodiode's zero drifts.
void press_while_the_zero_drifts(Bench& b, double nm_s, double high_nm, double duration_s) {
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
  b.follow(Vec3(0, 0, 5));
  b.run(500);
  b.afm->controller().tip().forget_peak();
  const std::int64_t begin_ns = b.afm->now_ns();
  const auto run = [&](int ms) {
    for (int i = 0; i < ms; i += 10) {
      b.afm->controller().set_photodiode(1, nm_s * 1e-9 * static_cast<double>(b.afm->now_ns() - begin_ns));
      b.run(10);
    }
  };
  while (1e-9 * static_cast<double>(b.afm->now_ns() - begin_ns) < duration_s &&
         b.phase() == Phase::kFollowing) {
    b.follow(Vec3(0, 0, -30));  // far more than the limit allows
    run(4000);
    if (high_nm > 0) b.follow(Vec3(0, 0, high_nm));
    run(1000);
  }
}

// A laser that wanders on the photodiode moves the deflection's zero: what reads as a pull makes the force look
// smaller. High above the sample, where there is none, that is found at a tenth of the limit. In contact no
// signal tells: the force goes beyond the limit by what the zero has moved since the tip was last up.
TEST(AfmHazards, AZeroThatMovesIsFoundWhereverTheTipComesUp) {
  constexpr double kDrift_nm_s = -0.04;
  for (const double high_nm : {30.0, 0.0}) {
    SCOPED_TRACE(high_nm);
    Bench b;
    press_while_the_zero_drifts(b, kDrift_nm_s, high_nm, 60);
    const double k = b.config.spring_constant_n_m;
    const double peak_nn = b.afm->controller().tip().peak_force_nn();
    std::printf("zero at %g nm/s, %s: pressed with at most %.0f nN, %s\n", kDrift_nm_s,
                high_nm > 0 ? "up each 5 s" : "never up", peak_nn, std::string(name(b.phase())).c_str());
    if (high_nm > 0) {
      EXPECT_EQ(name(b.afm->logic().state().cause), "signal not plausible") << b.afm->logic().news();
      // A tenth of the limit, what moves in one more way down, and what the drift of the lever's own bending adds.
      EXPECT_LE(peak_nn, 1.1 * b.config.force_max_nn - k * 6 * kDrift_nm_s + k * 2 * b.rig.thermal_nm + 5);
      b.run(500);
      EXPECT_TRUE(b.afm->controller().withdrawn());
    } else {
      EXPECT_LE(peak_nn, b.config.force_max_nn - k * 62 * kDrift_nm_s + k * 2 * b.rig.thermal_nm + 5);
      EXPECT_GT(peak_nn, 1.1 * b.config.force_max_nn) << "so much is open";
    }
  }
}

// The other way the force looks larger: the tip is held back, and in the air it looks like a contact that does not
// follow the motion.
TEST(AfmHazards, AZeroThatMovesTheOtherWayErrsOnTheSafeSide) {
  Bench b;
  press_while_the_zero_drifts(b, 0.04, 30, 60);
  b.run(500);
  EXPECT_EQ(name(b.afm->logic().state().cause), "signal not plausible") << b.afm->logic().news();
  EXPECT_TRUE(b.afm->controller().withdrawn());
  EXPECT_LE(b.afm->controller().tip().peak_force_nn(), b.config.force_max_nn + 5);
}

// A laser that weakens by so much, where the controller does not divide by the sum: all forces are read smaller
// by as much, stiffness with them, and nothing tells. The limit holds what is read.
TEST(AfmHazards, AWeakerLaserMakesTheLimitLargerByAsMuch) {
  for (const double gain : {0.8, 0.5}) {
    SCOPED_TRACE(gain);
    Bench b;
    b.start();
    ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
    b.follow(Vec3(0, 0, 5));
    b.run(500);
    b.afm->controller().tip().forget_peak();
    for (int i = 0; i < 3000; ++i) {
      b.afm->controller().set_photodiode(1 - (1 - gain) * std::min(1.0, i / 2000.0), 0);
      b.follow(Vec3(0, 0, -30));
      b.run(10);
    }
    const double peak_nn = b.afm->controller().tip().peak_force_nn();
    std::printf("laser at %g: pressed with at most %.0f nN, %s\n", gain, peak_nn,
                std::string(name(b.phase())).c_str());
    EXPECT_LE(peak_nn, b.config.force_max_nn / gain + 5 / gain);
    EXPECT_EQ(b.afm->controller().safe_tips(), 0u);
  }
}

// Another client of the controller moves the tip down while it presses. The first reading tells, and beyond the
// workspace's depth the controller's Z limits refuse it.
TEST(AfmHazards, AnotherClientThatMovesTheTipIsOverruledOrWithdraws) {
  for (const double deeper_nm : {1.0, 8.0, 400.0}) {
    SCOPED_TRACE(deeper_nm);
    Bench b;
    b.start();
    ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
    b.follow(Vec3(0, 0, -4));
    b.run(1500);
    auto& controller = b.afm->controller();
    const double pressed_nn = controller.tip().normal_force_nn();
    ASSERT_GT(pressed_nn, 100);
    controller.tip().forget_peak();
    controller.begin({nanonis::CommandId::kZPosSet, {1e-9 * (controller.height_nm() - deeper_nm)}}, -1,
                     b.afm->now_ns());
    b.run(300);
    const double peak_nn = controller.tip().peak_force_nn();
    std::printf("%g nm deeper by another client: %.0f nN, %s\n", deeper_nm, peak_nn,
                std::string(name(b.phase())).c_str());
    if (deeper_nm > 100) {
      EXPECT_LE(peak_nn, pressed_nn + 2) << "the controller's Z limits refuse it";
    } else {
      EXPECT_LE(peak_nn, pressed_nn + b.config.spring_constant_n_m * deeper_nm + 5);
    }
    // Beyond the limit and two steps the next reading withdraws it; less is taken back by the next command.
    EXPECT_EQ(b.phase(), deeper_nm == 8 ? Phase::kWithdrawn : Phase::kFollowing) << b.afm->logic().news();
  }
}

}  // namespace
}  // namespace telenano::afm
