// The rule for moves across against a ground in closed form: a rigid plane of any slope in the way of a tip on
// springs, F = n max(0, n·(g − b)) / (nᵀ C n).
#include "telenano/nve_server/afm/across_rule.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>

#include "telenano/common/base/random.h"

namespace telenano::afm {
namespace {

constexpr double kLever = 40, kAcross = 400, kLimit = 200;

struct Plane {
  Vec3 normal, point;
  Vec3 force_nn(const Vec3& base) const {
    const double yields =
        (normal.x() * normal.x() + normal.y() * normal.y()) / kAcross + normal.z() * normal.z() / kLever;
    return normal * (std::max(0.0, normal.dot(point - base)) / yields);
  }
};

// Walks that want further into the wall and down along it, at any speed, with readings that come late and may
// be of any moment of their window.
TEST(AcrossRule, NoPlaneInTheWayPassesTheLimitBetweenReadings) {
  const AcrossRule rule({kLever, kAcross, kLimit});
  Random random(7);
  double worst_nn = 0, least_nn = 1e9;
  for (int trial = 0; trial < 400; ++trial) {
    const double side = random.chance(0.5) ? 1 : -1;
    // From a wall that leans by a hundredth to a slope of 1 in 2, turned by up to 80 degrees about z.
    const double slope = std::pow(10, random.uniform(-0.3, 2)), turn = random.uniform(-1.4, 1.4);
    Plane plane;
    plane.normal = Vec3(-side * slope * std::cos(turn), slope * std::sin(turn), 1).normalized();
    Vec3 base(0, 0, random.uniform(-2, 2));
    plane.point = base + plane.normal * random.uniform(-5, 0);  // free at the start
    const int period = 2 + static_cast<int>(random.below(12));
    std::deque<Vec3> since = {base};
    double read_nn = 0, peak_nn = 0;
    std::size_t from = 0;
    for (int i = 0; i < 3000; ++i) {
      if (i % period == period - 1) {
        read_nn = plane.force_nn(since[from + random.below(since.size() - from)]).x();
        since.erase(since.begin(), since.begin() + static_cast<std::ptrdiff_t>(from));
        from = since.size() - 1;  // where the next window begins
      }
      AcrossRule::Since s{since.front(), since.front(), read_nn};
      for (const Vec3& at : since) {
        s.low_w_nm = s.low_w_nm.cwiseMin(at);
        s.high_w_nm = s.high_w_nm.cwiseMax(at);
      }
      if (random.chance(0.7)) {
        base += rule.allowed(base, Vec3(side * random.uniform(0, 2), random.uniform(-1, 1), 0), s);
      } else {
        base.z() = std::max(base.z() - random.uniform(0, 1), rule.lowest_nm(base, s));
      }
      since.push_back(base);
      peak_nn = std::max(peak_nn, std::fabs(plane.force_nn(base).x()));
    }
    worst_nn = std::max(worst_nn, peak_nn);
    // Steep walls across the way are met with what is allowed: the rule does not just stand still.
    if (slope > 3 && std::fabs(turn) < 0.3) least_nn = std::min(least_nn, peak_nn);
  }
  std::printf("at most %.1f nN across, against steep walls at least %.1f nN, of %.0f nN\n", worst_nn,
              least_nn, kLimit);
  EXPECT_LE(worst_nn, AcrossRule::kPart * kLimit + 1e-9);
  EXPECT_GE(least_nn, 0.5 * kLimit);
}

TEST(AcrossRule, GoesBackFromAForceThatIsTooLarge) {
  const AcrossRule rule({kLever, kAcross, kLimit});
  AcrossRule::Since s;
  s.force_x_nn = -180;  // a wall at larger x
  EXPECT_NEAR(rule.back_nm(Vec3::Zero(), s), -20 / kAcross, 1e-12);
  s.force_x_nn = 180;
  EXPECT_NEAR(rule.back_nm(Vec3::Zero(), s), 20 / kAcross, 1e-12);
  s.low_w_nm.x() = -0.05;  // it has come from there: that much is gone back already
  EXPECT_EQ(rule.back_nm(Vec3::Zero(), s), 0);
  s.force_x_nn = 159;
  EXPECT_EQ(rule.back_nm(Vec3::Zero(), s), 0);
}

TEST(AcrossRule, AwayFromAWallGoesWhatMayNotGoOn) {
  const AcrossRule rule({kLever, kAcross, kLimit});
  AcrossRule::Since s;
  s.force_x_nn = -165;
  EXPECT_EQ(rule.allowed(Vec3::Zero(), Vec3(1, 0, 0), s), Vec3(0, 0, 0));
  EXPECT_EQ(rule.allowed(Vec3::Zero(), Vec3(-1, 0, 0), s), Vec3(-0.75 * 325 / kAcross, 0, 0));
  EXPECT_EQ(rule.allowed(Vec3::Zero(), Vec3(-0.1, 0.1, 0), s), Vec3(-0.1, 0, 0)) << "but not along it";
  EXPECT_EQ(rule.lowest_nm(Vec3::Zero(), s), 0) << "nor down";
}

// The lever's own equations instead of the rule's: bodies that push on a rigid tip, each as steep as the slope at
// most, an adhesion that pulls it down, a lever of any height, tilt and direction.
TEST(AlongRule, NoBodiesThatAreNoSteeperPushHarderThanAllowed) {
  Random random(11);
  double worst = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    const double rise = random.uniform(0, 0.15), tilt = random.uniform(0, 0.2);
    const double part = std::tan(tilt + std::atan(2 * rise));
    const double slope = random.uniform(0.05, std::min(3.0, 0.99 / part));
    const AlongRule rule({kAcross, kLimit, slope, part});
    const double side = random.chance(0.5) ? 1 : -1, adhesion_nn = random.uniform(0, 60);
    const auto bodies = 1 + random.below(3);
    Vec3 force(0, 0, -adhesion_nn);
    const double most_nn = std::pow(10, random.uniform(0, 3));
    for (std::uint64_t i = 0; i < bodies; ++i) {
      const double up_nn = random.uniform(0, most_nn);
      const double leans = trial % 2 == 0 ? 1 : random.uniform(-1, 1);
      force += Vec3(0, -side * slope * leans * up_nn, up_nn);
    }
    // By the beam's normal and axis, as the photodiode sees it, calibrated by a force along z.
    const double along = std::cos(tilt) * force.y() - std::sin(tilt) * force.z();
    const double normal = std::sin(tilt) * force.y() + std::cos(tilt) * force.z();
    const double shown_nn = (normal + 2 * rise * along) / (std::cos(tilt) - 2 * rise * std::sin(tilt));
    if (shown_nn > rule.force_down_nn(adhesion_nn)) continue;
    worst = std::max(worst, std::fabs(force.y()) / (AcrossRule::kPart * kLimit));
  }
  std::printf("at most %.3f of what is allowed\n", worst);
  EXPECT_LE(worst, 1 + 1e-9);
  EXPECT_GT(worst, 0.9) << "the rule does not ask for more than it must";
}

TEST(AlongRule, WithoutASlopeTheBaseStaysWhereItCameDownAndMayAlwaysGoBack) {
  const AlongRule rule({kAcross, kLimit, 0, 0.4});
  EXPECT_NEAR(kAcross * rule.way_nm(), 0.4 * kLimit, 1e-9);
  EXPECT_NEAR(rule.allowed_nm(5, 2, 5), 0.2, 1e-12);
  EXPECT_NEAR(rule.allowed_nm(5.2, 2, 5), 0, 1e-12);
  EXPECT_NEAR(rule.allowed_nm(5, -2, 5), -0.2, 1e-12);
  EXPECT_EQ(rule.allowed_nm(9, 2, 5), 0) << "beyond, as when the ground was found to be higher";
  EXPECT_EQ(rule.allowed_nm(9, -2, 5), -2);
  EXPECT_TRUE(std::isinf(rule.force_down_nn(30)));
}

}  // namespace
}  // namespace telenano::afm
