// The AFM slave's logic against the simulated controller, in virtual time.
#include "telenano/nve_server/afm/afm_logic.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "telenano/nve_server/afm/afm_adapters.h"
#include "tests/unit/afm/afm_bench.h"

namespace telenano::afm {
namespace {

TEST(AfmLogic, ItFindsTheSurfaceTaresAndMeasuresTheDrift) {
  Bench b;
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing))
      << b.afm->logic().news() << b.afm->logic().refusal() << int(b.phase());
  const AfmLogic& logic = b.afm->logic();
  // Two touches a second apart, each known to a fraction of the step of 1 nm.
  EXPECT_NEAR(logic.drift_nm_s(), -b.rig.drift_z_nm_s, 0.3) << "the surface comes up as the tip sinks";
  // The tare: the offset, and the thermal bending of that moment (at most 0.1 nm, that is 4 nN).
  EXPECT_NEAR(logic.tare_nn(), 40 * b.rig.deflection_offset_nm, 40 * b.rig.thermal_nm);
  // 5e-4 nm/√Hz at 200 Hz: 5 pm, times 40 N/m; from 20 readings known to a sixth.
  EXPECT_NEAR(logic.state().noise_nn, 0.2, 0.12);
  EXPECT_EQ(b.afm->controller().status(), nanonis::ZStatus::kOff);
  EXPECT_NEAR(logic.state().base_w_nm.z(), b.config.lift_nm, 2);
  EXPECT_EQ(b.afm->controller().safe_tips(), 0u);
}

TEST(AfmLogic, ItFollowsPressesAndComesBack) {
  Bench b;
  b.config.along_slope = 0.5;
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing));
  b.follow(Vec3(10, -5, 10));
  b.run(300);
  EXPECT_LT((b.afm->logic().state().base_w_nm - b.wish.target_w_nm).norm(), 0.1);
  b.follow(Vec3(10, -5, -4));
  b.run(1000);
  const auto& s = b.afm->logic().state();
  EXPECT_TRUE(s.touching);
  EXPECT_NEAR(s.measured_force_w_nn.z(), b.afm->controller().tip().force_w_nn().z(), 5);
  b.follow(Vec3(10, -5, 20));
  b.run(500);
  EXPECT_FALSE(b.afm->logic().state().touching);
  EXPECT_EQ(b.phase(), Phase::kFollowing);
}

TEST(AfmLogic, TheForceLimitHoldsTheTipBack) {
  Bench b;
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing));
  b.follow(Vec3(0, 0, -30));
  b.afm->controller().tip().forget_peak();
  b.run(3000);
  EXPECT_EQ(b.phase(), Phase::kFollowing) << b.afm->logic().news();
  EXPECT_TRUE(b.afm->logic().state().held_by_force);
  const double peak = b.afm->controller().tip().peak_force_nn();
  // Over the limit by noise and what the thermal bending has drifted since the tare.
  EXPECT_LT(peak, b.config.force_max_nn + 40 * 2 * b.rig.thermal_nm + 2);
  EXPECT_GT(peak, 0.9 * b.config.force_max_nn);
}

TEST(AfmLogic, LinkLossStopAndSilenceWithdraw) {
  for (int kind = 0; kind < 3; ++kind) {
    Bench b;
    b.start();
    ASSERT_TRUE(b.until(Phase::kFollowing));
    b.follow(Vec3(0, 0, -4));
    b.run(500);
    ASSERT_GT(b.afm->controller().tip().normal_force_nn(), 20);
    if (kind == 0) {
      b.afm->advance_to(b.afm->now_ns() + 200 * kMs, b.wish);  // no time in it goes on
    } else if (kind == 1) {
      b.wish.retract = true;
      b.wish.follow = false;
      b.run(100);
    } else {
      b.afm->apply({0, afm_sim::FaultKind::kSilent, 300 * kMs, 0});
      b.run(450);
    }
    EXPECT_TRUE(b.afm->controller().withdrawn()) << kind;
    b.run(100);
    EXPECT_EQ(b.phase(), Phase::kWithdrawn) << kind;
    const Cause cause = b.afm->logic().state().cause;
    EXPECT_TRUE(kind == 0   ? cause == Cause::kLinkLoss
                : kind == 1 ? cause == Cause::kStop
                            : cause == Cause::kStaleForce || cause == Cause::kSilent)
        << name(cause);
    // Latched, until it is cleared.
    b.wish.retract = false;
    b.follow(Vec3(0, 0, 5));
    b.run(500);
    EXPECT_EQ(b.phase(), Phase::kWithdrawn) << kind;
    ++b.wish.clears;
    EXPECT_TRUE(b.until(Phase::kFollowing)) << kind << b.afm->logic().news();
  }
}

// This thread stands still between deciding on a call and sending it: the reply is waited for from when it was sent.
TEST(AfmLogic, AReplyIsWaitedForFromWhenTheCallWasSent) {
  for (const bool was_sent : {true, false}) {
    const AfmConfig config;
    AfmLogic logic(config, make_adapter("nanonis", config));
    for (const Role role : {Role::kMotion, Role::kReads, Role::kData, Role::kEmergency})
      logic.connected(role, 0);
    AfmCommand call;
    std::optional<Role> asked;
    for (const Role role : {Role::kMotion, Role::kReads, Role::kData, Role::kEmergency})
      if (!asked && logic.next(role, 0, call)) asked = role;
    ASSERT_TRUE(asked);
    const std::int64_t late_ns = 4000 * kMs;
    if (was_sent) logic.sent(*asked, late_ns);
    logic.tick(late_ns + kMs, {});
    EXPECT_EQ(logic.waits_for(*asked) != nullptr, was_sent);
    logic.tick(late_ns + 4000 * kMs, {});
    EXPECT_EQ(logic.waits_for(*asked), nullptr);
  }
}

TEST(AfmLogic, AForceThatIsStaleWithdrawsThoughEveryReplyComesInTime) {
  Bench b;
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing));
  b.follow(Vec3(0, 0, -4));
  b.run(500);
  b.afm->apply({0, afm_sim::FaultKind::kSlow, 400 * kMs, 85 * kMs});  // less than the time-out of a reply
  b.run(200);
  EXPECT_EQ(b.afm->logic().state().cause, Cause::kStaleForce) << b.afm->logic().news();
  EXPECT_TRUE(b.afm->controller().withdrawn());
}

// The status is asked on two other connections than the one that switches the Z controller off, and one of
// them goes through another process. An answer of before the switching may come after it, within its
// time-out.
TEST(AfmLogic, AStatusOfBeforeTheSwitchingOffThatComesAfterItIsNobodyElses) {
  for (const Role role : {Role::kEmergency, Role::kData}) {
    for (const std::int64_t delay_ms : {20, 30, 40, 50, 60, 70, 80, 90}) {
      Bench b;
      b.start();
      ASSERT_TRUE(b.until(Phase::kEngaging));
      b.afm->delay_answers(role, delay_ms * kMs);
      EXPECT_TRUE(b.until(Phase::kFollowing) && b.afm->logic().state().latches == 0)
          << name(role) << " " << delay_ms << " ms: " << b.afm->logic().news();
    }
  }
}

// What was read before the tip stood still in contact says nothing of it: on the way down the sample pulls.
TEST(AfmLogic, ReadingsThatComeLateMakeNoSignLookWrong) {
  for (const Role role : {Role::kReads, Role::kMotion, Role::kEmergency, Role::kData}) {
    for (const std::int64_t delay_ms : {30, 60, 100, 150, 200, 300, 500, 800}) {
      Bench b;
      b.config.stale_force_ms = b.config.reply_timeout_ms = 3000;
      b.config.timeout_s = 600;
      b.start();
      ASSERT_TRUE(b.until(Phase::kEngaging));
      b.afm->delay_answers(role, delay_ms * kMs);
      EXPECT_TRUE(b.until(Phase::kFollowing, 600'000) && b.afm->logic().state().latches == 0)
          << name(role) << " " << delay_ms << " ms: " << b.afm->logic().news() << " "
          << b.afm->logic().refusal();
    }
  }
}

// Every reply late, from the first one of the checks on, with the time-outs as they come.
TEST(AfmLogic, AControllerWhoseRepliesAreLateIsApproached) {
  for (const std::int64_t late_ms : {6, 20}) {
    for (std::uint64_t seed = 1; seed <= 8; ++seed) {
      Bench b;
      b.rig.seed = seed;
      b.start();
      b.afm->apply({0, afm_sim::FaultKind::kSlow, 60'000 * kMs, late_ms * kMs});
      EXPECT_TRUE(b.until(Phase::kFollowing) && b.afm->logic().state().latches == 0)
          << late_ms << " ms, seed " << seed << ": " << b.afm->logic().news() << b.afm->logic().refusal();
    }
  }
}

// Through the emergency port no reading comes: a busy machine between may take 300 ms over an answer. No
// answer at all is a withdrawal, as before.
TEST(AfmLogic, TheEmergencyPortMayTakeAsLongAsTheGuardWaits) {
  for (const std::int64_t delay_ms : {300, 500}) {
    Bench b;
    b.start();
    ASSERT_TRUE(b.until(Phase::kFollowing));
    b.afm->delay_answers(Role::kEmergency, delay_ms * kMs);
    b.run(3000);
    EXPECT_EQ(b.phase() == Phase::kFollowing, delay_ms < b.config.guard_silence_ms())
        << delay_ms << b.afm->logic().news();
  }
}

TEST(AfmLogic, AZControllerThatSomeoneElseSwitchesOnWithdraws) {
  for (const Role late : {Role::kMotion, Role::kEmergency, Role::kData}) {
    Bench b;
    b.start();
    ASSERT_TRUE(b.until(Phase::kFollowing));
    if (late != Role::kMotion) b.afm->delay_answers(late, 90 * kMs);
    b.run(100);
    b.afm->controller().begin({nanonis::CommandId::kOnOffSet, {1}}, -1, b.afm->now_ns());
    b.run(100);
    EXPECT_EQ(b.afm->logic().state().cause, Cause::kController) << b.afm->logic().news();
    b.run(200);
    EXPECT_TRUE(b.afm->controller().withdrawn());
  }
}

TEST(AfmLogic, ACommandThatComesAfterTheWithdrawalDoesNotLeaveTheTipDown) {
  Bench b;
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing));
  b.wish.session = 1;
  b.wish.retract = true;
  b.run(300);
  ASSERT_EQ(b.phase(), Phase::kWithdrawn);
  b.run(100);
  const auto late = [&] {
    b.afm->controller().begin({nanonis::CommandId::kZPosSet, {0.0}}, -1, b.afm->now_ns());
  };
  late();
  EXPECT_TRUE(b.afm->controller().withdrawn()) << "the controller's Z limits hold it";
  // A controller that does not hold direct commands to its limits.
  b.afm->controller().begin({nanonis::CommandId::kLimitsEnabledSet, {0}}, -1, b.afm->now_ns());
  late();
  ASSERT_FALSE(b.afm->controller().withdrawn());
  b.run(200);
  EXPECT_TRUE(b.afm->controller().withdrawn());
}

// A deadman that has withdrawn the tip answers ZCtrl.StatusGet with an error until somebody has looked.
TEST(AfmLogic, WhileTheEmergencyPortObjectsNothingApproaches) {
  Bench b;
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing));
  b.follow(Vec3(0, 0, 10));
  b.run(100);
  b.wish.retract = true;
  ASSERT_TRUE(b.until(Phase::kWithdrawn));
  b.wish.retract = false;
  ++b.wish.clears;
  b.wish.wanted = true;
  const std::uint64_t moves = b.afm->controller().moves();
  AfmReading objection;
  objection.refused = "Z.StatusGet";
  objection.why = "look at it";
  for (int i = 0; i < 2000; ++i) {
    const AfmCommand* asked = b.afm->logic().waits_for(Role::kEmergency);
    if (asked != nullptr && asked->op == AfmOp::kAskStatus)
      b.afm->logic().answered(Role::kEmergency, objection, b.afm->now_ns());
    b.afm->advance_to(b.afm->now_ns() + VirtualAfm::kStepNs, b.wish);
    b.wish.time_ns = b.afm->now_ns();
  }
  EXPECT_EQ(b.phase(), Phase::kWithdrawn);
  EXPECT_EQ(b.afm->controller().moves(), moves);
  EXPECT_NE(b.afm->logic().news().find("no approach: look at it"), std::string::npos)
      << b.afm->logic().news();
  EXPECT_TRUE(b.until(Phase::kFollowing)) << "as soon as it does not: " << b.afm->logic().news();
}

TEST(AfmLogic, ASetPointBeyondTheForceLimitIsRefusedAndNothingMoves) {
  Bench b;
  b.rig.setpoint_nn = 2000;
  b.start();
  b.until(Phase::kRefused, 10000);
  EXPECT_LT(b.afm->controller().tip().peak_force_nn(), b.config.force_max_nn);
  EXPECT_EQ(b.phase(), Phase::kRefused) << b.afm->logic().news();
  EXPECT_NE(b.afm->logic().refusal().find("set point"), std::string::npos) << b.afm->logic().refusal();
  EXPECT_EQ(b.afm->controller().moves(), 0u);
}

/// What the controller's own motion adds beyond the limit until a reading has shown it: two periods, the
/// slowest reply and a step of this time, at its speed, as the lever's force.
double over_in_the_approach_nn(const Bench& b) {
  return b.config.spring_constant_n_m * b.rig.approach_nm_s *
         (2 * b.config.period_s() + 3 * b.rig.latency_s + 1e-3);
}

nanonis::Call set_point(const Bench& b, double force_nn) {
  const double nm = force_nn * b.afm->controller().tip().deflection_nm_nn() + b.rig.deflection_offset_nm;
  return {nanonis::CommandId::kSetpointSet, {1e-9 * nm}};
}

TEST(AfmLogic, ASetPointThatIsRaisedInTheApproachIsNotPressed) {
  Bench b;
  b.start();
  ASSERT_TRUE(b.until(Phase::kEngaging));
  b.run(200);
  // Without the controller's own protection, which would act at the step.
  b.afm->controller().begin({nanonis::CommandId::kSafeTipOnOffSet, {2}}, -1, b.afm->now_ns());
  b.afm->controller().begin(set_point(b, 2000), -1, b.afm->now_ns());
  ASSERT_TRUE(b.until(Phase::kWithdrawn));
  EXPECT_EQ(b.afm->logic().state().cause, Cause::kForceLimit);
  const double peak_nn = b.afm->controller().tip().peak_force_nn();
  EXPECT_GT(peak_nn, b.config.force_max_nn) << "else nothing is shown";
  EXPECT_LT(peak_nn, b.config.force_max_nn + over_in_the_approach_nn(b));
  b.run(100);  // the last of the way, at 20 um/s
  EXPECT_TRUE(b.afm->controller().withdrawn());
}

TEST(AfmLogic, ALaterApproachAsksForTheSetPointAgain) {
  Bench b;
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing));
  b.wish.session = 1;
  b.wish.retract = true;
  ASSERT_TRUE(b.until(Phase::kWithdrawn));
  b.afm->controller().begin(set_point(b, 2000), -1, b.afm->now_ns());
  const std::uint64_t moves = b.afm->controller().moves();
  b.wish.retract = false;
  ++b.wish.clears;
  b.follow(Vec3(0, 0, 5));
  b.run(1000);
  EXPECT_EQ(b.phase(), Phase::kWithdrawn);
  EXPECT_EQ(b.afm->logic().state().cause, Cause::kForceLimit);
  EXPECT_EQ(b.afm->controller().moves(), moves) << "the controller was not switched on";
  b.afm->controller().begin(set_point(b, 15), -1, b.afm->now_ns());
  ++b.wish.clears;
  EXPECT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().news();
}

}  // namespace
}  // namespace telenano::afm
