#include "telenano/nve_server/scene/levelling.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>

#include "telenano/common/base/random.h"

namespace telenano::scene {
namespace {

using physics::HeightGrid;

HeightGrid grid_of(int columns, int rows, const std::function<double(int, int)>& z) {
  HeightGrid grid{columns, rows, 0.7, 1.3, 0.35, 0.65, {}};
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) grid.z_nm.push_back(z(column, row));
  }
  return grid;
}

double greatest(const HeightGrid& grid) {
  double greatest = 0;
  for (const double z : grid.z_nm) greatest = std::max(greatest, std::abs(z));
  return greatest;
}

double greatest_difference(const HeightGrid& a, const HeightGrid& b) {
  double greatest = 0;
  for (std::size_t i = 0; i < a.z_nm.size(); ++i) {
    greatest = std::max(greatest, std::abs(a.z_nm[i] - b.z_nm[i]));
  }
  return greatest;
}

HeightGrid rough(int columns, int rows, std::uint64_t seed) {
  Random random(seed);
  return grid_of(columns, rows, [&](int c, int r) {
    return 3.0 * std::sin(0.3 * c) * std::cos(0.21 * r) + 0.5 * c - 0.2 * r + random.uniform(-1, 1);
  });
}

TEST(Levelling, APlaneVanishes) {
  HeightGrid grid = grid_of(40, 31, [](int c, int r) { return 1e4 + 2.5 * c - 0.7 * r; });
  level_plane(grid);
  EXPECT_LT(greatest(grid), 1e-9);  // 1e-13 of the heights
}

// The plane found otherwise: Householder QR of the whole design matrix in nm.
TEST(Levelling, IsTheLeastSquaresPlane) {
  const HeightGrid before = rough(37, 24, 1);
  Eigen::MatrixXd design(37 * 24, 3);
  Eigen::VectorXd z(37 * 24);
  for (int i = 0; i < 37 * 24; ++i) {
    design.row(i) << 1.0, before.x_first_nm + (i % 37) * before.dx_nm,
        before.y_first_nm + (i / 37) * before.dy_nm;
    z(i) = before.z_nm[static_cast<std::size_t>(i)];
  }
  const Eigen::VectorXd plane = design.colPivHouseholderQr().solve(z);
  const Eigen::VectorXd rest = z - design * plane;
  HeightGrid grid = before;
  level_plane(grid);
  for (int i = 0; i < 37 * 24; ++i) EXPECT_NEAR(grid.z_nm[static_cast<std::size_t>(i)], rest(i), 1e-11);
}

TEST(Levelling, OffsetLinesBecomeOneProfile) {
  Random random(2);
  std::vector<double> offset, profile;
  for (int i = 0; i < 50; ++i) offset.push_back(random.uniform(-100, 100));
  for (int i = 0; i < 50; ++i) profile.push_back(random.uniform(-2, 2));
  HeightGrid grid = grid_of(50, 50, [&](int c, int r) { return profile[c] + offset[r]; });
  level_lines(grid);
  for (int i = 50; i < 2500; ++i) EXPECT_NEAR(grid.z_nm[i], grid.z_nm[i % 50], 1e-11);
  // Tilt and mean are gone, the profile is not.
  double sum = 0, tilt = 0;
  for (int c = 0; c < 50; ++c) {
    sum += grid.z_nm[c];
    tilt += (c - 24.5) * grid.z_nm[c];
  }
  EXPECT_NEAR(sum, 0.0, 1e-9);
  EXPECT_NEAR(tilt, 0.0, 1e-8);
  EXPECT_NEAR((grid.z_nm[2] - grid.z_nm[1]) - (grid.z_nm[1] - grid.z_nm[0]),
              (profile[2] - profile[1]) - (profile[1] - profile[0]), 1e-11);
}

TEST(Levelling, AFlakeLeavesNoBands) {
  HeightGrid grid = grid_of(60, 40, [](int c, int r) {
    const bool flake = c >= 10 && c < 35 && r >= 12 && r < 28;
    return (flake ? 8.0 : 0.0) + 0.3 * r + (r % 3);
  });
  level_lines(grid);
  // The substrate, 40 columns of which 1 in 60 is tilted away by the flake's own share of the tilt.
  const auto z = [&](int c, int r) { return grid.z_nm[static_cast<std::size_t>(r * 60 + c)]; };
  for (int r = 0; r < 40; ++r) {
    for (const int c : {0, 5, 40, 59}) EXPECT_NEAR(z(c, r), z(c, 0), 1e-11) << c << ' ' << r;
    const double height = r >= 12 && r < 28 ? 8.0 : 0.0;
    EXPECT_NEAR(z(20, r) - z(20, 0), height, 1e-11);
  }
}

TEST(Levelling, TwiceIsOnce) {
  for (const auto function : {level_plane, level_lines}) {
    for (const int columns : {2, 33, 40}) {
      HeightGrid once = rough(columns, 29, 3);
      function(once);
      HeightGrid twice = once;
      function(twice);
      EXPECT_LT(greatest_difference(once, twice), 1e-11) << columns;
    }
  }
}

TEST(Levelling, EndsWithTheLowestSampleAtZero) {
  for (const Levelling levelling : {Levelling::kNone, Levelling::kPlane, Levelling::kLines}) {
    HeightGrid grid = rough(20, 20, 4);
    level(grid, levelling);
    EXPECT_EQ(*std::min_element(grid.z_nm.begin(), grid.z_nm.end()), 0.0);
  }
  const HeightGrid before = rough(20, 20, 5);
  HeightGrid none = before;
  level(none, Levelling::kNone);
  EXPECT_NEAR(none.z_nm[7] - none.z_nm[300], before.z_nm[7] - before.z_nm[300], 1e-12);
}

TEST(Levelling, HasNames) {
  EXPECT_EQ(levelling_from_name("none"), Levelling::kNone);
  EXPECT_EQ(levelling_from_name("plane"), Levelling::kPlane);
  EXPECT_EQ(levelling_from_name("lines"), Levelling::kLines);
  EXPECT_FALSE(levelling_from_name("Plane").has_value());
}

}  // namespace
}  // namespace telenano::scene
