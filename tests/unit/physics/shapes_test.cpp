#include <gtest/gtest.h>

#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/surface/plane_surface.h"
#include "telenano/nve_server/physics/surface/sampled_shapes.h"
#include "telenano/nve_server/physics/surface/sphere_surface.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"

namespace telenano::physics {
namespace {

TEST(PlaneSurface, HasItsHeights) {
  const PlaneSurface plane({2.0, 0.75, 0.0, 100.0});
  EXPECT_EQ(plane.height_nm(4, 7), 5.0);
  EXPECT_FALSE(plane.is_flat());
  EXPECT_EQ(plane.lowest_nm(), -73.0);
  EXPECT_EQ(plane.highest_nm(), 77.0);
}

TEST(SphereSurface, IsACapOnAPlate) {
  const SphereSurface cap({5, -3, 30, 12});
  EXPECT_NEAR(cap.height_nm(5, -3), 12, 1e-14);
  const double crease = std::sqrt(12.0 * (60 - 12));
  EXPECT_NEAR(cap.height_nm(5 + 0.5 * crease, -3), std::sqrt(900 - 0.25 * crease * crease) - 18, 1e-13);
  EXPECT_EQ(cap.height_nm(5, -3 + 1.0001 * crease), 0.0);
  EXPECT_EQ(cap.highest_nm(), 12);
}

TEST(SampledShapes, SinusoidHasItsHeightsAndCurvature) {
  const GratingShape shape{GratingProfile::kSinusoid, 3, -2, kPi / 6, 8, 64, 0};
  const SampledArea area{-100, -90, 200, 180, 2.0};
  const SplineSurface surface(sample_grating(area, shape));
  const double k = 2 * kPi / 64;
  for (double x = -60; x < 60; x += 3.3) {
    for (double y = -60; y < 60; y += 4.1) {
      const double s = (x - 3) * std::cos(kPi / 6) + (y + 2) * std::sin(kPi / 6);
      // (kh)⁴/384 = 4e-6 of the amplitude, and the mirrored ends' slope, 0.268^15 = 3e-9 of some nm.
      EXPECT_NEAR(surface.height_nm(x, y), 4 * (1 - std::cos(k * s)), 4 * 8e-6);
    }
  }
  // In a groove's middle the curvature is 4k², wrong by (kh)²/12 = 0.3 %.
  const HeightJet middle = surface.jet(3, -2);
  EXPECT_NEAR(middle.zxx + middle.zyy, 4 * k * k, 0.004 * 4 * k * k);
}

TEST(SampledShapes, StepHasItsEdge) {
  const StepShape shape{10, 0, 0, 6, 8};
  const SplineSurface surface(sample_step({-50, -20, 120, 40, 0.5}, shape));
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
  EXPECT_THROW(PlaneSurface({0, 20, 0, 100}), UserError);
  EXPECT_THROW(PlaneSurface({0, kNan, 0, 100}), UserError);
  EXPECT_THROW(PlaneSurface({0, 0, 0, 0}), UserError);
  EXPECT_THROW(SphereSurface({0, 0, 10, 11}), UserError);
  EXPECT_THROW(SphereSurface({0, 0, -1, 1}), UserError);
  EXPECT_THROW(SphereSurface({0, kNan, 10, 1}), UserError);
  const SampledArea area{0, 0, 100, 100, 1};
  EXPECT_THROW(sample_level({0, 0, 1e5, 1e5, 1}, 0), UserError);
  EXPECT_THROW(sample_level({0, 0, 100, 100, 0}, 0), UserError);
  EXPECT_THROW(sample_step(area, {0, 0, 0, 5, 7}), UserError);
  EXPECT_NO_THROW(sample_step(area, {0, 0, 0, 5, 8}));
  EXPECT_THROW(sample_grating(area, {GratingProfile::kSinusoid, 0, 0, 0, 5, 15, 0}), UserError);
  EXPECT_THROW(sample_grating(area, {GratingProfile::kTrapezoid, 0, 0, 0, 5, 30, 16}), UserError);
  EXPECT_THROW(SplineSurface(HeightGrid{2, 2, 1, 1, 0, 0, {0, 0, 0, kNan}}), UserError);
  EXPECT_THROW(SplineSurface(HeightGrid{1, 2, 1, 1, 0, 0, {0, 0}}), UserError);
  EXPECT_THROW(SplineSurface(HeightGrid{2, 2, 1, 1, 0, 0, {0, 0, 0}}), UserError);
  EXPECT_THROW(SplineSurface(HeightGrid{2, 2, 0, 1, 0, 0, {0, 0, 0, 0}}), UserError);
}

}  // namespace
}  // namespace telenano::physics
