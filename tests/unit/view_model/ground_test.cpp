#include "telenano/master/view_model/ground.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace telenano::view_model {
namespace {

surface::HeightGrid grid_of(int side, double step_nm, double (*height)(double, double)) {
  surface::HeightGrid grid;
  grid.columns = grid.rows = side;
  grid.dx_nm = grid.dy_nm = step_nm;
  grid.x_first_nm = 5;
  grid.y_first_nm = -3;
  for (int row = 0; row < side; ++row)
    for (int column = 0; column < side; ++column)
      grid.z_nm.push_back(height(grid.x_first_nm + column * step_nm, grid.y_first_nm + row * step_nm));
  return grid;
}

double wavy(double x, double y) {
  return 3 * std::sin(x / 20) + 2 * std::cos(y / 15);
}
double parabola(double x, double y) {
  return 0.01 * x * x - 0.02 * y * y + 0.03 * x * y + x - 2 * y + 7;
}

TEST(Ground, IsTheScanAtItsPixels) {
  const Ground ground(grid_of(40, 2.5, wavy));
  for (int i = 0; i < 40; ++i) {
    const double x = 5 + 2.5 * i;
    const double y = -3 + 2.5 * (39 - i);
    EXPECT_NEAR(ground.height_w_nm(x, y), wavy(x, y), 1e-12);
  }
}

// Catmull-Rom has the central differences as slopes: it repeats polynomials of second degree exactly, away
// from the rim.
TEST(Ground, RepeatsAParabolaBetweenPixels) {
  const Ground ground(grid_of(30, 2, parabola));
  for (double x = 10; x < 55; x += 0.73) {
    const double y = 0.8 * x - 2;
    EXPECT_NEAR(ground.height_w_nm(x, y), parabola(x, y), 1e-9);  // rounding of numbers of about 1e2
  }
}

TEST(Ground, NormalIsTheOneOfTheFormula) {
  const Ground ground(grid_of(30, 2, parabola));
  const double x = 31.3;
  const double y = 22.2;
  const Vec3 expected = Vec3(-(0.02 * x + 0.03 * y + 1), -(-0.04 * y + 0.03 * x - 2), 1).normalized();
  EXPECT_LT((ground.normal_w(x, y, 0.1) - expected).norm(),
            1e-9);  // central differences: exact for a parabola
}

TEST(Ground, BeyondTheRimItIsAsAtTheRimAndNeverWild) {
  const Ground ground(grid_of(20, 2, wavy));
  EXPECT_DOUBLE_EQ(ground.height_w_nm(-1e6, 7), ground.height_w_nm(5, 7));
  EXPECT_DOUBLE_EQ(ground.height_w_nm(1e9, 1e9), ground.height_w_nm(5 + 38, -3 + 38));
  EXPECT_TRUE(std::isfinite(ground.height_w_nm(std::numeric_limits<double>::quiet_NaN(), 0)));
  EXPECT_TRUE(std::isfinite(ground.height_w_nm(0, std::numeric_limits<double>::infinity())));
}

TEST(Ground, TextureHoldsHeightsAndSlopes) {
  const Ground ground(grid_of(64, 1, parabola));
  const int side = ground.texture_side();
  ASSERT_EQ(side, 64);
  const std::vector<float> texels = ground.height_texture(side);
  ASSERT_EQ(texels.size(), 3u * 64 * 64);
  for (const int i : {1, 17, 40, 62}) {
    const int j = 63 - i;
    const double x = 5 + i;
    const double y = -3 + j;
    const std::size_t at = 3 * (static_cast<std::size_t>(j) * 64 + static_cast<std::size_t>(i));
    EXPECT_NEAR(texels[at], parabola(x, y), 1e-4);  // floats of about 1e2
    EXPECT_NEAR(texels[at + 1], 0.02 * x + 0.03 * y + 1, 1e-5);
    EXPECT_NEAR(texels[at + 2], -0.04 * y + 0.03 * x - 2, 1e-5);
  }
}

TEST(Ground, APlaneIsFlatAndHasRoomEvenWithoutAWorkspace) {
  const Ground ground(3.5, Vec3::Zero(), Vec3::Zero());
  EXPECT_FALSE(ground.is_scan());
  EXPECT_EQ(ground.height_w_nm(12, 34), 3.5);
  EXPECT_GE(ground.width_nm(), 100);
  EXPECT_EQ(ground.overview_exaggeration(), 1);
  EXPECT_EQ(ground.colour_height(3.5), 0.5);
}

TEST(Ground, ReliefIsDrawnAboutAnEighthOfTheWidth) {
  surface::HeightGrid grid = grid_of(60, 10, [](double, double) { return 0.0; });
  grid.z_nm[100] = 14;
  EXPECT_EQ(Ground(grid).overview_exaggeration(), 5);  // 0.12 · 590/14 = 5.06
  grid.z_nm[100] = 500;
  EXPECT_EQ(Ground(grid).overview_exaggeration(), 1);
  grid.z_nm[100] = 0.01;
  EXPECT_EQ(Ground(grid).overview_exaggeration(), 20);
}

}  // namespace
}  // namespace telenano::view_model
