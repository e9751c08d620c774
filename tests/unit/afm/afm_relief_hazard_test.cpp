// What a fault tree of the rig finds besides lost connections and signals that die. The force is the simulated
// rig's own. Here: relief that stands in the way, across the lever and along it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>

#include "tests/unit/afm/afm_bench.h"
#include "tests/unit/afm/step_scene.h"

namespace telenano::afm {
namespace {

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

}  // namespace
}  // namespace telenano::afm
