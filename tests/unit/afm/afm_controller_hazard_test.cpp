// What a fault tree of the rig finds besides lost connections and signals that die. The force is the simulated
// rig's own. Here: somebody else at the controller, and a controller that was started anew.
#include <gtest/gtest.h>

#include <cstdio>
#include <string>

#include "tests/unit/afm/afm_bench.h"
#include "tests/unit/afm/hazard_bench.h"

namespace telenano::afm {
namespace {

using enum nanonis::CommandId;

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

// The withdrawal is answered and not done, on a sample that lies less than a tenth of the range below where the
// tip stood at the start. It is up only there.
TEST(AfmHazards, ATipWhoseWithdrawalIsNotDoneIsNotUp) {
  for (const int sign : {1, -1}) {
    for (const auto fault : {afm_sim::WithdrawFault::kUndone, afm_sim::WithdrawFault::kHalf}) {
      SCOPED_TRACE(::testing::Message() << sign << (fault == afm_sim::WithdrawFault::kHalf ? ", half" : ""));
      Bench b;
      b.rig.z_sign = b.config.z_sign = sign;
      b.rig.sample_z_nm = 460;
      b.start();
      ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
      b.follow(Vec3(0, 0, -4));
      b.run(1000);
      ASSERT_GT(b.afm->controller().tip().normal_force_nn(), 100);
      b.afm->controller().set_withdraw_fault(fault, -1);
      b.wish.retract = true;
      if (fault == afm_sim::WithdrawFault::kUndone) {
        std::vector<std::string> said;
        for (int ms = 0; ms < 15000; ++ms) {
          const auto before = b.afm->logic().news_count();
          b.run(1);
          ASSERT_EQ(b.phase(), Phase::kWithdrawing);
          if (ms > 500 && b.afm->logic().news_count() != before) said.push_back(b.afm->logic().news());
        }
        ASSERT_EQ(said.size(), 2u) << "after a second, and ten more";
        EXPECT_NE(said[0].find(sign > 0 ? "the tip is NOT up: Z = 45" : "the tip is NOT up: Z = -45"),
                  std::string::npos)
            << said[0];
        EXPECT_NE(said[0].find(sign > 0 ? "up is 500.0 nm" : "up is -500.0 nm"), std::string::npos)
            << said[0];
        b.afm->controller().set_withdraw_fault(fault, 3);
      }
      ASSERT_TRUE(b.until(Phase::kWithdrawn, 2000));
      EXPECT_GE(b.afm->controller().height_nm(), 489);
      EXPECT_EQ(b.afm->logic().news(), "withdrawn: stop");
    }
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
