// A tip that comes straight down beside a wall, and is withdrawn from there: it goes straight up, and nothing that
// it meets on the way may push or pull harder than what held it down there. Then what a wall does that faces along
// the lever, or stands oblique. The force is the simulated rig's own.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "tests/unit/afm/afm_bench.h"
#include "tests/unit/afm/step_scene.h"

namespace telenano::afm {
namespace {

struct Place {
  double height_nm = 20;
  double beside_nm = 10;  ///< of the base, before the wall's upper corner
  int direction_deg = 0;
  const char* points = "";  ///< the lever; "": yields along Z alone
};

/// Most of it, by the rig's own account.
struct Felt {
  double most_nn = 0, pull_nn = 0, along_nn = 0;
  void look(const Vec3& force_nn) {
    most_nn = std::max(most_nn, force_nn.norm());
    pull_nn = std::max(pull_nn, -force_nn.z());
    along_nn = std::max(along_nn, std::fabs(force_nn.y()));
  }
};

struct Came {
  Felt down, up;
  double pressed_nn = 0;  ///< when the withdrawal begins
};

Vec3 towards(int direction_deg, double way_nm, double z_nm) {
  const double angle = direction_deg * std::numbers::pi / 180;
  return {way_nm * std::cos(angle), way_nm * std::sin(angle), z_nm};
}

/// High above to there, straight down, pressed as hard as the limit lets it; then its station stops.
Came come_down_and_withdraw(Bench& b, const Place& place) {
  Came came;
  b.afm.emplace(b.config, b.rig, with_a_step(place.height_nm, place.direction_deg, 2, place.points));
  EXPECT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
  const auto& tip = b.afm->controller().tip();
  const double way_nm = 60 - place.beside_nm;
  b.follow(towards(place.direction_deg, way_nm, place.height_nm + 25));
  b.run(600);
  EXPECT_LT(tip.force_w_nn().norm(), 1) << "it comes from above";
  b.follow(towards(place.direction_deg, way_nm, -20));
  for (int i = 0; i < 1200; ++i) {
    b.run(1);
    came.down.look(tip.force_w_nn());
  }
  EXPECT_GT(came.down.most_nn, 2) << "the ground, or the wall, was met";
  came.pressed_nn = tip.force_w_nn().norm();
  b.wish.retract = true;
  b.wish.follow = false;
  for (int i = 0; i < 1000 && !(i > 100 && b.afm->controller().withdrawn()); ++i) {
    b.afm->advance_to(b.afm->now_ns() + kMs / 2, b.wish);
    came.up.look(tip.force_w_nn());
  }
  EXPECT_TRUE(b.afm->controller().withdrawn());
  EXPECT_LT(tip.force_w_nn().norm(), 1);
  return came;
}

// 10 to 50 nm, from where the ball stands on the ground beside the wall to where it stands on the corner.
TEST(AfmWithdrawal, BesideAWallNothingPushesHarderThanBefore) {
  double most_nn = 0, pull_nn = 0;
  int places = 0;
  for (const double height_nm : {10.0, 20.0, 30.0, 40.0, 50.0}) {
    for (double beside_nm = 26; beside_nm >= -4; beside_nm -= 2) {
      SCOPED_TRACE(::testing::Message() << height_nm << " nm, base " << beside_nm << " nm before the corner");
      Bench b;
      const Came came = come_down_and_withdraw(b, {height_nm, beside_nm});
      // All of the limits at once, noise, and bending with temperature.
      EXPECT_LE(came.down.most_nn, 10 + std::hypot(b.config.force_max_nn, b.config.lateral_max_nn));
      EXPECT_LE(came.up.most_nn, came.pressed_nn + b.config.spring_constant_n_m * b.config.step_nm);
      EXPECT_LE(came.up.pull_nn, 60) << "what holds a ball on a flat";
      most_nn = std::max(most_nn, came.up.most_nn);
      pull_nn = std::max(pull_nn, came.up.pull_nn);
      ++places;
    }
  }
  std::printf("%d places: at most %.0f nN while it goes up, and a pull of %.0f nN\n", places, most_nn,
              pull_nn);
  EXPECT_EQ(places, 80);
}

// The rig alone, led to where no logic would lead it: pressed with up to the whole limit and then with 160 nN
// against the wall. Straight up from there, in steps of 2.5 nm as at 5 um/s. Fields that take a wall for nearer
// than it is gave up to 17 uN here, high above the ground.
TEST(AfmWithdrawal, TheSimulatedTipLosesNoWall) {
  afm_sim::SimConfig still;
  still.creep = still.z_lag_s = still.drift_x_nm_s = still.drift_y_nm_s = still.drift_z_nm_s = 0;
  double most_nn = 0, pull_nn = 0;
  int places = 0;
  for (const double edge_nm : {2.0, 6.0}) {
    for (const double height_nm : {20.0, 30.0, 50.0}) {
      const auto scene = with_a_step(height_nm, 0, edge_nm);
      for (const double press_nn : {20.0, 280.0}) {
        for (double beside_nm = 40; beside_nm >= 0; beside_nm -= 8) {
          SCOPED_TRACE(::testing::Message()
                       << "edge of " << edge_nm << " nm, " << height_nm << " nm high, base " << beside_nm
                       << " nm before, pressed with " << press_nn << " nN");
          afm_sim::SimTip tip(still, scene);
          const auto go = [&](double x_nm, double z_nm) { tip.step(Vec3(60 + x_nm, 0, z_nm), 1e-3); };
          double x = -60, z = height_nm + 60;
          for (go(x, z); x < -beside_nm;) go(x += 1, z);
          while (z > -20 && tip.normal_force_nn() < press_nn && std::fabs(tip.force_w_nn().x()) < 190)
            go(x, z -= 0.2);
          while (x < 20 && std::fabs(tip.force_w_nn().x()) < 160 && tip.force_w_nn().norm() < 400)
            go(x += 0.1, z);
          const double pressed_nn = tip.force_w_nn().norm();
          Felt up;
          while (z < height_nm + 60) {
            go(x, z += 2.5);
            up.look(tip.force_w_nn());
          }
          // Adhesion, up to six times along the steepest wall.
          EXPECT_LE(up.most_nn, std::max(pressed_nn, 450.0));
          EXPECT_LE(up.pull_nn, 100);
          most_nn = std::max(most_nn, up.most_nn);
          pull_nn = std::max(pull_nn, up.pull_nn);
          ++places;
        }
      }
    }
  }
  std::printf("%d places: at most %.0f nN while it goes up, and a pull of %.0f nN\n", places, most_nn,
              pull_nn);
}

/// How steep the way of a ball's middle is where the ball meets the corner of a step.
double steepness(double height_nm) {
  constexpr double r = 20;
  const double down = r - height_nm;
  return std::sqrt(r * r - down * down) / down;
}

// Along the lever no signal shows the force. Pressed straight down onto the corner, with the slope told, the
// limit of the force down holds it; not told, it is what this prints.
TEST(AfmWithdrawal, PressedStraightDownAlongTheLeverAKnownSlopeHoldsIt) {
  double told_nn = 0, untold_nn = 0;
  for (const char* points : {"", "+y"}) {
    for (const double height_nm : {7.0}) {
      for (double beside_nm = 16; beside_nm >= 4; beside_nm -= 2) {
        SCOPED_TRACE(::testing::Message()
                     << height_nm << " nm, base " << beside_nm << " nm before, lever '" << points << "'");
        Bench told, untold;
        told.config.along_slope = steepness(height_nm);
        const Came came = come_down_and_withdraw(told, {height_nm, beside_nm, 90, points});
        EXPECT_LE(came.down.along_nn, told.config.lateral_max_nn);
        EXPECT_LE(came.up.along_nn, told.config.lateral_max_nn);
        told_nn = std::max(told_nn, came.down.along_nn);
        untold_nn = std::max(
            untold_nn, come_down_and_withdraw(untold, {height_nm, beside_nm, 90, points}).down.along_nn);
      }
    }
  }
  std::printf("straight down along the lever: at most %.0f nN with the slope told, %.0f nN without\n",
              told_nn, untold_nn);
  EXPECT_GT(told_nn, 20) << "the corner was met";
  EXPECT_GT(untold_nn, AfmConfig{}.lateral_max_nn) << "else the rule does nothing here";
}

// What is not held where no slope is told: a wall as high as the tip's radius and more, met by its corner from
// above. A lever that points to it shows nothing, or a pull, and goes on down.
TEST(AfmWithdrawal, PressedStraightDownAlongTheLeverNothingTellsOfAHighWall) {
  for (const char* points : {"", "+y", "-y"}) {
    double most_nn = 0;
    for (const double height_nm : {20.0, 40.0}) {
      for (const double beside_nm : {20.0, 18.0, 16.0}) {
        Bench b;
        most_nn =
            std::max(most_nn, come_down_and_withdraw(b, {height_nm, beside_nm, 90, points}).down.along_nn);
      }
    }
    std::printf("straight down on a wall of 20 or 40 nm along the lever '%s': %.0f nN\n", points, most_nn);
    EXPECT_GT(most_nn, 500) << "held after all: then SAFETY.md says too much";
  }
}

/// Led across at the ground against a wall that stands oblique, or held beside one while the sample drifts along.
double along_of(Bench& b, double height_nm, int direction_deg, double beside_nm, const Vec3& way_nm,
                double depth_nm, int ms) {
  b.afm.emplace(b.config, b.rig, with_a_step(height_nm, direction_deg, 2, ""));
  EXPECT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
  const Vec3 at = towards(direction_deg, 60 - beside_nm, 0);
  b.follow(at + Vec3(0, 0, height_nm + 25));
  b.run(600);
  b.follow(at + Vec3(0, 0, -depth_nm));
  b.run(1000);
  b.follow(at + way_nm + Vec3(0, 0, -depth_nm));
  Felt felt;
  for (int i = 0; i < ms; ++i) {
    b.run(1);
    felt.look(b.afm->controller().tip().force_w_nn());
  }
  return felt.along_nn;
}

TEST(AfmWithdrawal, AcrossAlongAnObliqueWallAKnownSlopeHoldsIt) {
  for (const int direction_deg : {45, 60, 75, 85}) {
    for (const double height_nm : {7.0, 15.0}) {
      SCOPED_TRACE(::testing::Message() << height_nm << " nm towards " << direction_deg);
      Bench told, untold;
      told.config.along_slope = steepness(7);
      const Vec3 way(100, 0, 0);
      const double without_nn = along_of(untold, height_nm, direction_deg, 24, way, 4, 5000);
      const double with_nn = height_nm > 7 ? 0 : along_of(told, height_nm, direction_deg, 24, way, 4, 5000);
      std::printf("oblique wall of %g nm towards %d: along the lever %.0f nN, with the slope told %.0f nN\n",
                  height_nm, direction_deg, without_nn, with_nn);
      if (height_nm <= 7) {
        EXPECT_GT(with_nn, direction_deg < 80 ? 10 : -1) << "the wall was met";
      }
      EXPECT_LE(with_nn, told.config.lateral_max_nn);
    }
  }
}

TEST(AfmWithdrawal, DriftAlongTheLeverAKnownSlopeHoldsIt) {
  for (const double drift_nm_s : {0.05, 0.5}) {
    for (const double height_nm : {7.0, 15.0}) {
      SCOPED_TRACE(::testing::Message() << drift_nm_s << " nm/s, " << height_nm << " nm");
      Bench told, untold;
      told.rig.drift_y_nm_s = untold.rig.drift_y_nm_s = drift_nm_s;
      told.config.along_slope = steepness(7);
      const double without_nn = along_of(untold, height_nm, 90, 24, Vec3::Zero(), 20, 30000);
      const double with_nn = height_nm > 7 ? 0 : along_of(told, height_nm, 90, 24, Vec3::Zero(), 20, 30000);
      if (drift_nm_s > 0.1) {
        EXPECT_GT(without_nn, told.config.lateral_max_nn) << "else the rule does nothing here";
      }
      std::printf("drift along of %g nm/s for 30 s, wall of %g nm: %.0f nN, with the slope told %.0f nN\n",
                  drift_nm_s, height_nm, without_nn, with_nn);
      EXPECT_LE(with_nn, told.config.lateral_max_nn);
    }
  }
}

}  // namespace
}  // namespace telenano::afm
