#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/surface/plane_surface.h"
#include "telenano/nve_server/physics/surface/sampled_shapes.h"
#include "telenano/nve_server/physics/surface/sphere_surface.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"

namespace telenano::physics {
namespace {

constexpr double kRadius = 20;

// Least distance to a height field by exhaustion, finer and finer around the best point so far.
double brute_force(const std::function<double(double, double)>& height, const Vec3& c, double reach) {
  double best = 1e300, bx = c.x(), by = c.y(), half = reach;
  for (int level = 0; level < 9; ++level) {
    const double x0 = bx, y0 = by;
    const int count = level == 0 ? 150 : 20;
    for (int i = -count; i <= count; ++i) {
      for (int j = -count; j <= count; ++j) {
        const double x = x0 + half * i / count, y = y0 + half * j / count;
        const double d = (Vec3(x, y, height(x, y)) - c).norm();
        if (d < best) {
          best = d;
          bx = x;
          by = y;
        }
      }
    }
    half *= level == 0 ? 0.03 : 0.15;
  }
  return best;
}

TEST(PlaneSurface, IsClosedForm) {
  const PlaneSurface plane({2.0, 0.75, 0.0, 100.0}, kRadius);  // n = (−0.6, 0, 0.8)
  FootMemory memory;
  const SurfaceContact contact = plane.nearest(Vec3(1, 7, 12.75), Search::kGlobal, memory);
  EXPECT_NEAR(contact.distance_nm, 8.0, 1e-14);
  EXPECT_LT((contact.normal_w - Vec3(-0.6, 0, 0.8)).norm(), 1e-15);
  EXPECT_LT((contact.foot_w_nm - Vec3(5.8, 7, 6.35)).norm(), 1e-14);
  EXPECT_EQ(contact.effective_radius_nm, kRadius);
  EXPECT_EQ(contact.normal_turn_per_nm, Mat3::Zero());
  EXPECT_FALSE(contact.outside);
  EXPECT_TRUE(plane.nearest(Vec3(0, 101, 12), Search::kGlobal, memory).outside);
  EXPECT_FALSE(plane.is_flat());
  EXPECT_EQ(plane.lowest_nm(), -73.0);
  EXPECT_EQ(plane.highest_nm(), 77.0);
}

TEST(SphereSurface, AgreesWithBruteForce) {
  for (const double height : {30.0, 12.0}) {
    const SphereSurface sphere({5, -3, 30, height}, kRadius);
    std::mt19937 random(1);
    std::uniform_real_distribution<double> place(-70, 70), up(10, 60);
    for (int i = 0; i < 40; ++i) {
      const Vec3 c(place(random), place(random), up(random));
      if (c.z() < sphere.height_nm(c.x(), c.y())) continue;
      FootMemory memory;
      const SurfaceContact contact = sphere.nearest(c, Search::kGlobal, memory);
      // Brute force resolves 60·0.03·0.15^7/20 = 2e-7 nm along a cliff at the particle's equator.
      EXPECT_NEAR(contact.distance_nm,
                  brute_force([&](double x, double y) { return sphere.height_nm(x, y); }, c, 60), 1e-6);
      EXPECT_NEAR((c - contact.foot_w_nm - contact.distance_nm * contact.normal_w).norm(), 0, 1e-13);
    }
  }
}

TEST(SphereSurface, GradientsAndRadius) {
  const SphereSurface sphere({0, 0, 30, 30}, kRadius);
  FootMemory memory;
  const Vec3 c(12, -9, 48);
  const SurfaceContact contact = sphere.nearest(c, Search::kGlobal, memory);
  EXPECT_DOUBLE_EQ(contact.effective_radius_nm, 12.0);  // 20·30/50
  const double h = 1e-4;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3 d = h * Vec3::Unit(axis);
    const SurfaceContact a = sphere.nearest(c + d, Search::kGlobal, memory);
    const SurfaceContact b = sphere.nearest(c - d, Search::kGlobal, memory);
    // Central differences: h²/6 of a third derivative of 1/50², rounding 1e-14/1e-4.
    EXPECT_NEAR((a.distance_nm - b.distance_nm) / (2 * h), contact.normal_w(axis), 1e-9);
    EXPECT_LT(((a.normal_w - b.normal_w) / (2 * h) - contact.normal_turn_per_nm.col(axis)).norm(), 1e-9);
  }
}

// In the corner between particle and plate, each search keeps to its side.
TEST(SphereSurface, LocalSearchKeepsItsSideOfTheCrease) {
  const SphereSurface sphere({0, 0, 30, 20}, kRadius);
  // A centre as far from the one as from the other: c_z = |c − m| − ρ, m_z = −10, at c_z = 19.5.
  const double x = std::sqrt(49.5 * 49.5 - 29.5 * 29.5);
  FootMemory on_ball, on_plane;
  sphere.nearest(Vec3(x - 1, 0, 19.5), Search::kGlobal, on_ball);
  sphere.nearest(Vec3(x + 1, 0, 19.5), Search::kGlobal, on_plane);
  for (const double shift : {-0.4, 0.4}) {
    const Vec3 c(x + shift, 0, 19.5);
    FootMemory a = on_ball, b = on_plane, global = on_ball;
    EXPECT_GT(sphere.nearest(c, Search::kLocal, a).foot_w_nm.z(), 1.0);
    EXPECT_EQ(sphere.nearest(c, Search::kLocal, b).foot_w_nm.z(), 0.0);
    EXPECT_EQ(sphere.nearest(c, Search::kGlobal, global).foot_w_nm.z() > 1.0, shift < 0);
  }
  // Far outside, the ball has no foot above the plate that could be followed.
  FootMemory followed = on_ball;
  EXPECT_EQ(sphere.nearest(Vec3(500, 0, -8), Search::kLocal, followed).foot_w_nm.z(), 0.0);
}

TEST(SampledShapes, SinusoidHasItsHeightsAndCurvature) {
  const GratingShape shape{GratingProfile::kSinusoid, 3, -2, kPi / 6, 8, 64, 0};
  const SampledArea area{-100, -90, 200, 180, 2.0};
  const SplineSurface surface(sample_grating(area, shape), kRadius);
  const double k = 2 * kPi / 64;
  for (double x = -60; x < 60; x += 3.3) {
    for (double y = -60; y < 60; y += 4.1) {
      const double s = (x - 3) * std::cos(kPi / 6) + (y + 2) * std::sin(kPi / 6);
      // (kh)⁴/384 = 4e-6 of the amplitude, and the mirrored ends' slope, 0.268^15 = 3e-9 of some nm.
      EXPECT_NEAR(surface.height_nm(x, y), 4 * (1 - std::cos(k * s)), 4 * 8e-6);
    }
  }
  // In a groove's middle: κ = (4k², 0) downwards, (kh)²/12 = 0.3 % and the mean over a cell's as much.
  FootMemory memory;
  const SurfaceContact contact = surface.nearest(Vec3(3, -2, 19), Search::kGlobal, memory);
  EXPECT_NEAR(contact.distance_nm, 19, 1e-3);
  EXPECT_NEAR(contact.effective_radius_nm, kRadius / std::sqrt(1 - kRadius * 4 * k * k), 0.03 * kRadius);
}

TEST(SampledShapes, StepHasItsEdge) {
  const StepShape shape{10, 0, 0, 6, 8};
  const SplineSurface surface(sample_step({-50, -20, 120, 40, 0.5}, shape), kRadius);
  EXPECT_NEAR(surface.height_nm(0, 0), 0, 1e-5);
  EXPECT_NEAR(surface.height_nm(20, 0), 6, 1e-5);
  EXPECT_NEAR(surface.height_nm(10, 0), 3, 1e-12);              // by symmetry
  EXPECT_NEAR(surface.jet(10, 0).zx, 1.875 * 6 / 8, 1e-4);      // steepest
  EXPECT_NEAR(surface.height_nm(8, 0), 6 * 0.103515625, 1e-4);  // t = ¼
  for (double x = -40; x < 60; x += 0.37) {
    EXPECT_GE(surface.height_nm(x, 5), -1e-3);  // no overshoot to speak of: (h/width)³
    EXPECT_LE(surface.height_nm(x, 5), 6 + 1e-3);
  }
}

TEST(SampledShapes, TrapezoidIsAsWideOnTopAsBelow) {
  const GratingShape shape{GratingProfile::kTrapezoid, 0, 0, kPi / 2, 5, 40, 8};
  const HeightGrid grid = sample_grating({-10, -80, 20, 160, 1.0}, shape);
  const auto at = [&](double y) { return grid.z_nm[static_cast<std::size_t>((y + 80) * 21 + 10)]; };
  EXPECT_EQ(at(0), 0.0);
  EXPECT_EQ(at(5), 0.0);
  EXPECT_NEAR(at(10), 2.5, 1e-12);
  EXPECT_EQ(at(15), 5.0);
  EXPECT_EQ(at(20), 5.0);
  EXPECT_NEAR(at(30), 2.5, 1e-12);
  EXPECT_NEAR(at(-50), 2.5, 1e-12);
  EXPECT_EQ(at(-40), 0.0);
  EXPECT_EQ(at(60), 5.0);
}

TEST(SampledShapes, GridCoversTheArea) {
  const HeightGrid grid = sample_level({-3, 4, 10, 7, 0.3}, 1.5);
  EXPECT_EQ(grid.columns, 35);  // 33.3 spacings: 34 of a little less
  EXPECT_EQ(grid.rows, 25);
  EXPECT_NEAR(grid.x_first_nm + (grid.columns - 1) * grid.dx_nm, 7, 1e-12);
  EXPECT_NEAR(grid.y_first_nm + (grid.rows - 1) * grid.dy_nm, 11, 1e-12);
  EXPECT_LE(grid.dx_nm, 0.3);
  EXPECT_EQ(grid.z_nm, std::vector<double>(35 * 25, 1.5));
}

TEST(Shapes, MistakesAreNamed) {
  const double kNan = std::nan("");
  EXPECT_THROW(PlaneSurface({0, 20, 0, 100}, kRadius), UserError);
  EXPECT_THROW(PlaneSurface({0, kNan, 0, 100}, kRadius), UserError);
  EXPECT_THROW(PlaneSurface({0, 0, 0, 0}, kRadius), UserError);
  EXPECT_THROW(PlaneSurface({0, 0, 0, 1}, 0), UserError);
  EXPECT_THROW(SphereSurface({0, 0, 10, 11}, kRadius), UserError);
  EXPECT_THROW(SphereSurface({0, 0, -1, 1}, kRadius), UserError);
  EXPECT_THROW(SphereSurface({0, kNan, 10, 1}, kRadius), UserError);
  const SampledArea area{0, 0, 100, 100, 1};
  EXPECT_THROW(sample_level({0, 0, 1e5, 1e5, 1}, 0), UserError);
  EXPECT_THROW(sample_level({0, 0, 100, 100, 0}, 0), UserError);
  EXPECT_THROW(sample_step(area, {0, 0, 0, 5, 7}), UserError);
  EXPECT_NO_THROW(sample_step(area, {0, 0, 0, 5, 8}));
  EXPECT_THROW(sample_grating(area, {GratingProfile::kSinusoid, 0, 0, 0, 5, 15, 0}), UserError);
  EXPECT_THROW(sample_grating(area, {GratingProfile::kTrapezoid, 0, 0, 0, 5, 30, 16}), UserError);
  EXPECT_THROW(SplineSurface(HeightGrid{2, 2, 1, 1, 0, 0, {0, 0, 0, kNan}}, kRadius), UserError);
  EXPECT_THROW(SplineSurface(HeightGrid{1, 2, 1, 1, 0, 0, {0, 0}}, kRadius), UserError);
  EXPECT_THROW(SplineSurface(HeightGrid{2, 2, 1, 1, 0, 0, {0, 0, 0}}, kRadius), UserError);
  EXPECT_THROW(SplineSurface(HeightGrid{2, 2, 0, 1, 0, 0, {0, 0, 0, 0}}, kRadius), UserError);
  EXPECT_THROW(SplineSurface(HeightGrid{2, 2, 1, 1, 0, 0, {0, 0, 0, 0}}, -1), UserError);
}

}  // namespace
}  // namespace telenano::physics
