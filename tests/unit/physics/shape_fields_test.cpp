#include "telenano/nve_server/physics/surface/shape_fields.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/surface/softening_table.h"
#include "tests/support/field_checks.h"

namespace telenano::physics {
namespace {

constexpr double kRadius = 20;
const SofteningRule kRule = softening_rule(kRadius, 0.4, 52.5, 0.165);

// A sphere of radius R with its apex at p: its middle is R above, its distance from the plane along the
// normal.
TEST(PlaneFields, AreTheDistanceOfTheSphere) {
  const PlaneFields fields({1.5, 0.7, -0.4, 500}, kRadius);
  const Vec3 apex(3, -2, 8);
  ContactJet jet;
  fields.contact_at(apex, jet);
  const Vec3 normal = Vec3(-0.7, 0.4, 1).normalized();
  const double distance = normal.dot(apex + Vec3(0, 0, kRadius) - Vec3(0, 0, 1.5));
  EXPECT_NEAR(jet.overlap_nm, kRadius - distance, 1e-13 * kRadius);
  EXPECT_LE((jet.overlap_grad + normal).norm(), 1e-15);
  EXPECT_NEAR(jet.log_radius, std::log(kRadius), 1e-15);
  EXPECT_EQ(jet.overlap_hess_per_nm, Mat3::Zero().eval());
  EXPECT_THROW(PlaneFields({0, 11, 0, 500}, kRadius), UserError);
}

TEST(SphereFields, OneFootIsExact) {
  const double r = 30;
  const SphereFields fields(
      {
          5,
          -4,
          r,
          r,
      },
      kRadius, kRule);
  for (const double depth : {-0.2, 0.3, 1.0}) {
    ContactJet jet;
    // On the ball at 20°, along its normal; the plate is 27 nm below, some 40 softenings.
    const Vec3 normal = Vec3(0.342, 0, 0.94).normalized();
    const Vec3 apex = Vec3(5, -4, 0) + (kRadius + r - depth) * normal - Vec3(0, 0, kRadius);
    fields.contact_at(apex, jet);
    EXPECT_NEAR(jet.overlap_nm, depth, 1e-12);
    EXPECT_LE((jet.overlap_grad + normal).norm(), 1e-12);
    EXPECT_NEAR(std::exp(jet.log_radius), kRadius * r / (kRadius + r), 1e-11);
    // Far from the ball, the plate.
    fields.contact_at({205, 0, -depth}, jet);
    EXPECT_NEAR(jet.overlap_nm, depth, 1e-12);
    EXPECT_NEAR(std::exp(jet.log_radius), kRadius, 1e-12);
  }
  EXPECT_THROW(SphereFields({0, 0, 10, 11}, kRadius, kRule), UserError);
}

// Where the tip leans on both, the radii add.
TEST(SphereFields, TwoFeetAtTheCreaseAdd) {
  const double r = 30;
  const SphereFields fields({0, 0, r, r}, kRadius, kRule);
  const double x = std::sqrt((kRadius + r) * (kRadius + r) - kRadius * kRadius);  // touches both at z = 0
  ContactJet jet;
  fields.contact_at({x, 0, 0}, jet);
  EXPECT_NEAR(jet.overlap_nm, 0, 1e-12);
  EXPECT_NEAR(std::exp(jet.log_radius), kRadius + kRadius * r / (kRadius + r), 1e-10);
}

TEST(SphereFields, DerivativesAgreeWithDifferences) {
  const SphereFields fields({0, 0, 30, 22}, kRadius, kRule);
  std::mt19937 random(1);
  const auto between = [&](double a, double b) {
    return a + (b - a) * 1e-6 * static_cast<double>(random() % 1000000);
  };
  const double h = 1e-5;
  for (int n = 0; n < 4000; ++n) {
    const double out = between(0, 60), turn = between(0, 6.28);
    const double ball = out < 50 ? std::sqrt(2500 - out * out) - kRadius - 8 : 0;
    const Vec3 at(out * std::cos(turn), out * std::sin(turn), std::max(0.0, ball) + between(-3, 8));
    const auto jet_at = [&](const Vec3& apex) {
      ContactJet jet;
      if (n % 4 == 0) {
        fields.at_softening(apex, 0.8, jet);
      } else if (n % 4 == 1) {
        fields.growing_at(apex, {0.35, 5.0, 0.0, 0.6, 0.0}, jet);
      } else {
        fields.contact_at(apex, jet);
      }
      return jet;
    };
    // h² of a third derivative of up to t^−2, and rounding of 1e-15·60/h.
    support::expect_derivatives(jet_at, at, h, 3e-8, 2e-6);
    if (HasFatalFailure()) return;
  }
}

// t0 of the three materials that the rule was fitted through, and where it must stay below R/4.
TEST(Softening, RuleOfTheFinest) {
  EXPECT_NEAR(softening_rule(20, 0.4, 1e9, 0.165).finest_nm, 0.36 * 0.165, 1e-6);
  EXPECT_NEAR(softening_rule(20, 0.4, 52.5, 0.165).finest_nm, 0.55 * 0.165, 0.04 * 0.165);
  const double soft = softening_rule(20, 0.23, 2.35, 0.165).finest_nm;
  EXPECT_GT(soft, 0.33);
  EXPECT_LT(soft, 0.5);
  EXPECT_LT(softening_rule(20, 0.05, 1e-4, 0.165).finest_nm, 2.5);
  EXPECT_LT(softening_rule(2, 0.4, 0.3, 0.165).finest_nm, 0.25);
}

TEST(Softening, GrowsWithTheDistanceFromTouch) {
  const double t0 = kRule.finest_nm;
  for (const double v : {-0.0495, 0.0, 0.1, 0.33}) EXPECT_EQ(softening_level(kRule, v).level, 0.0);
  // Long before the end at R/4 = 5 nm, t² = t0² + (α s)².
  const double xi = 1.0, s = xi * xi * xi / (xi * xi + 0.01);
  EXPECT_NEAR(t0 * std::exp2(softening_level(kRule, -1.0495).level), std::hypot(t0, 0.6 * s), 1e-3);
  EXPECT_NEAR(t0 * std::exp2(softening_level(kRule, 1.33).level), std::hypot(t0, 0.6 * s), 1e-3);
  EXPECT_NEAR(t0 * std::exp2(softening_level(kRule, 1e6).level), 5.0, 1e-9);
  const double h = 1e-5;
  for (double v = -40; v < 60; v += 0.0973) {
    const SofteningLevel here = softening_level(kRule, v), up = softening_level(kRule, v + h),
                         down = softening_level(kRule, v - h);
    EXPECT_NEAR((up.level - down.level) / (2 * h), here.slope_per_nm, 1e-7) << v;
    EXPECT_NEAR((up.slope_per_nm - down.slope_per_nm) / (2 * h), here.bend_per_nm2, 1e-5) << v;
  }
}

// The table that scans read it from: within its stated errors of the rule, C² over the ends of its cells, and
// its slope and bend those of its level.
TEST(SofteningTable, IsTheRuleAndC2) {
  const struct { double radius, error; } tips[] = {{1, 1e-6}, {5, 1e-8}, {20, 1e-8}, {100, 1e-8}};
  for (const auto& tip : tips) {
    const SofteningRule rule = softening_rule(tip.radius, 0.4, 52.5, 0.165);
    const SofteningTable table(rule);
    for (int k = 0; k < 40000; ++k) {
      const double v = (k % 2 == 0 ? -1 : 1) * 100.0 * std::pow(k / 40000.0, 3);
      const SofteningLevel is = table.level(v), rule_has = softening_level(rule, v);
      ASSERT_NEAR(is.level, rule_has.level, tip.error) << v;
      ASSERT_GE(is.level, 0.0);
      ASSERT_NEAR(is.slope_per_nm, rule_has.slope_per_nm, 1e3 * tip.error) << v;
    }
    for (const double xi : {0.0, 1.0 / 128, 0.5, 1.0, 1.0625, 9.0, 9.5, 73.0}) {
      for (const double v : {-xi - rule.pressed_onset_nm, xi + rule.dead_zone_nm}) {
        const SofteningLevel low = table.level(v - 1e-9), high = table.level(v + 1e-9);
        EXPECT_NEAR(low.level, high.level, 1e-8);
        EXPECT_NEAR(low.slope_per_nm, high.slope_per_nm, 1e-6);
        EXPECT_NEAR(low.bend_per_nm2, high.bend_per_nm2, 1e-4) << v;
      }
    }
    for (const double v : {-6.3, -0.77, -0.2, 0.6, 2.2, 30.1}) {
      const double h = 1e-5;
      const SofteningLevel here = table.level(v), up = table.level(v + h), down = table.level(v - h);
      EXPECT_NEAR((up.level - down.level) / (2 * h), here.slope_per_nm, 1e-7);
      EXPECT_NEAR((up.slope_per_nm - down.slope_per_nm) / (2 * h), here.bend_per_nm2, 1e-5);
    }
  }
}

// What all levels agree on is kept; value and slope go on without a step where the three change; t0·2^level
// is the softening that is meant (a linear run of levels comes out as itself).
TEST(Softening, BlendKeepsConstantsAndLines) {
  const int count = 7;
  const auto of_line = [&](const double(&w)[3], int first) {
    return w[0] * first + w[1] * (first + 1) + w[2] * (first + 2);
  };
  for (double e = 0; e < 5.99; e += 0.0137) {
    const LevelBlend blend = blend_levels(e, count);
    ASSERT_GE(blend.first, 0);
    ASSERT_LE(blend.first + 2, count - 1);
    EXPECT_NEAR(blend.weight[0] + blend.weight[1] + blend.weight[2], 1, 1e-15);
    EXPECT_NEAR(blend.slope[0] + blend.slope[1] + blend.slope[2], 0, 1e-15);
    EXPECT_NEAR(blend.bend[0] + blend.bend[1] + blend.bend[2], 0, 1e-15);
    if (e < 5.5) {
      EXPECT_NEAR(of_line(blend.weight, blend.first), e, 1e-14);
      if (e > 0) {
        EXPECT_NEAR(of_line(blend.slope, blend.first), 1, 1e-14);
      }
    }
    for (const double weight : blend.weight) EXPECT_GE(weight, 0);
  }
  const auto all = [&](double e, int level, bool slope) {
    const LevelBlend blend = blend_levels(e, count);
    const int k = level - blend.first;
    return k >= 0 && k < 3 ? (slope ? blend.slope[k] : blend.weight[k]) : 0.0;
  };
  for (const double knot : {0.5, 1.5, 2.5, 3.5, 4.5, 5.5}) {
    for (int level = 0; level < count; ++level) {
      EXPECT_NEAR(all(knot - 1e-12, level, false), all(knot + 1e-12, level, false), 1e-11);
      EXPECT_NEAR(all(knot - 1e-12, level, true), all(knot + 1e-12, level, true), 1e-11);
    }
  }
}

}  // namespace
}  // namespace telenano::physics
