// The oracle is what was put into a synthetic scan: a plane, gaps in a harmonic field, spikes.
#include "telenano/nve_server/import/clean_scan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

#include "telenano/nve_server/scene/levelling.h"

namespace telenano::import {
namespace {

using surface::HeightGrid;

HeightGrid grid_of(int columns, int rows, double dx_nm, double dy_nm) {
  HeightGrid grid;
  grid.columns = columns;
  grid.rows = rows;
  grid.dx_nm = dx_nm;
  grid.dy_nm = dy_nm;
  grid.z_nm.assign(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows), 0.0);
  return grid;
}
std::size_t at(const HeightGrid& grid, int column, int row) {
  return static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) +
         static_cast<std::size_t>(column);
}
template <class Height>
void add(HeightGrid& grid, const Height& height) {
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column)
      grid.z_nm[at(grid, column, row)] += height(column, row);
  }
}
// Flakes of 5 nm to one side, 35 % of the scan.
double flakes(int column, int row) {
  return column > 66 && (row / 16) % 4 != 3 ? 5.0 : 0.0;
}

TEST(FitPlane, FindsThePlaneUnderFlakesThatTiltLeastSquares) {
  constexpr int kColumns = 128, kRows = 96;
  constexpr double kDx = 2.0, kDy = 3.0, kSigma = 0.2, kSlopeX = 0.013, kSlopeY = -0.021;
  HeightGrid grid = grid_of(kColumns, kRows, kDx, kDy);
  std::mt19937_64 random(7);
  std::normal_distribution<double> noise(0.0, kSigma);
  add(grid, [&](int c, int r) {
    return 300.0 + kSlopeX * c * kDx + kSlopeY * r * kDy + flakes(c, r) + noise(random);
  });
  const Plane plane = fit_plane(grid);
  EXPECT_TRUE(plane.converged);
  // Standard errors of least squares over the bare substrate, its columns 0 to 66 for the slope along x: Σx²
  // of n equally spaced columns is n³/12. Five of them, and a quarter more for the biweight's 95 % and for
  // what it gives to outliers close by.
  const double se_x = kSigma / (kDx * std::sqrt(kRows * std::pow(67, 3) / 12.0));
  const double se_y = kSigma / (kDy * std::sqrt(67 * std::pow(kRows, 3) / 12.0));
  EXPECT_NEAR(plane.slope_x, kSlopeX, 6.25 * se_x);
  EXPECT_NEAR(plane.slope_y, kSlopeY, 6.25 * se_y);

  // What this is for: the plain least-squares plane is off by a hundred times that.
  HeightGrid plain = grid;
  scene::level_plane(plain);
  const double slope_left = (grid.z_nm[at(grid, 0, 0)] - plain.z_nm[at(grid, 0, 0)] -
                             (grid.z_nm[at(grid, 127, 0)] - plain.z_nm[at(grid, 127, 0)])) /
                            (-127 * kDx);
  EXPECT_GT(std::abs(slope_left - kSlopeX), 100 * se_x);

  const double middle = 0.25 * (grid.z_nm[at(grid, 63, 47)] + grid.z_nm[at(grid, 64, 47)] +
                                grid.z_nm[at(grid, 63, 48)] + grid.z_nm[at(grid, 64, 48)]);
  HeightGrid level = grid;
  subtract(level, plane);
  EXPECT_NEAR(0.25 * (level.z_nm[at(grid, 63, 47)] + level.z_nm[at(grid, 64, 47)] +
                      level.z_nm[at(grid, 63, 48)] + level.z_nm[at(grid, 64, 48)]),
              middle, 1e-9);
  EXPECT_NEAR(
      level.z_nm[at(grid, 10, 5)],
      grid.z_nm[at(grid, 10, 5)] - plane.slope_x * (10 - 63.5) * kDx - plane.slope_y * (5 - 47.5) * kDy,
      1e-9);
}

TEST(FitPlane, APlaneWithoutNoiseIsExact) {
  for (const auto& [columns, rows] : {std::pair{2, 2}, {2, 9}, {9, 2}, {31, 7}}) {
    HeightGrid grid = grid_of(columns, rows, 0.7, 1.9);
    add(grid, [&](int c, int r) { return -40.0 + 0.31 * c * 0.7 - 0.17 * r * 1.9; });
    const Plane plane = fit_plane(grid);
    // Rounding of heights of 40 nm over a nanometre.
    EXPECT_NEAR(plane.slope_x, 0.31, 1e-12) << columns << " x " << rows;
    EXPECT_NEAR(plane.slope_y, -0.17, 1e-12) << columns << " x " << rows;
  }
  EXPECT_TRUE(fit_plane(grid_of(5, 5, 1, 1)).converged);  // and a scan without any height
}

TEST(Spikes, ThoseOfOneAndTwoPixelsGoAndNothingElse) {
  // Of 14 nm: more than twice a flake beside them, which would else pass for more of the same.
  HeightGrid grid = grid_of(160, 120, 1.0, 1.0);
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise(0.0, 0.1);
  add(grid, [&](int c, int r) {
    return 4.0 * std::sin(c / 20.0) * std::cos(r / 30.0) + flakes(c, r) + (r == 60 && c < 40 ? 3.0 : 0.0) +
           noise(random);
  });
  EXPECT_NEAR(pixel_noise_nm(grid), 0.1, 0.01);
  const HeightGrid clean = grid;
  std::set<std::size_t> spikes;
  for (int i = 0; i < 60; ++i) {
    const int column = 3 + (i * 29) % 150, row = 2 + (i * 17) % 114;
    if (std::abs(row - 60) < 6 || !spikes.insert(at(grid, column, row)).second) continue;
    grid.z_nm[at(grid, column, row)] += i % 2 == 0 ? 14.0 : -14.0;
    if (i % 5 == 0 && spikes.insert(at(grid, column + 1, row)).second)
      grid.z_nm[at(grid, column + 1, row)] += i % 2 == 0 ? 14.0 : -14.0;
  }
  // In a corner and on a rim, too.
  for (const auto& [column, row] : {std::pair{0, 0}, {159, 70}}) {
    spikes.insert(at(grid, column, row));
    grid.z_nm[at(grid, column, row)] += 14.0;
  }
  HeightGrid done = grid;
  EXPECT_EQ(count_spikes(grid, 10.0), spikes.size());
  EXPECT_EQ(remove_spikes(done, 10.0), spikes.size());
  for (std::size_t i = 0; i < grid.z_nm.size(); ++i) {
    // The median of 24 pixels: the waves' slope of 0.2 over two pixels, noise, and at a flake's corner the
    // flake.
    if (spikes.contains(i)) {
      EXPECT_LT(std::abs(done.z_nm[i] - clean.z_nm[i]), 5.6) << i;
    } else {
      EXPECT_EQ(done.z_nm[i], clean.z_nm[i]) << i;
    }
  }
  EXPECT_EQ(count_spikes(clean, 10.0), 0u);
}

TEST(Spikes, AStepsCornerAndARidgesEndAreNone) {
  HeightGrid grid = grid_of(40, 40, 1.0, 1.0);
  add(grid, [](int c, int r) { return (c >= 20 && r >= 20 ? 10.0 : 0.0) + (r == 8 && c > 10 ? 4.0 : 0.0); });
  EXPECT_EQ(count_spikes(grid, 3.0), 0u);
  grid.z_nm[at(grid, 5, 30)] = 3.0;
  EXPECT_EQ(remove_spikes(grid, 3.0), 1u);
  EXPECT_EQ(grid.z_nm[at(grid, 5, 30)], 0.0);
  HeightGrid flat = grid_of(8, 8, 1.0, 1.0);
  EXPECT_EQ(remove_spikes(flat, 3.0), 0u);
}

TEST(Gaps, AHarmonicFieldComesBack) {
  // x² − y² + xy: the discrete Laplacian on any spacing is that of the quadric, 2 − 2 = 0.
  for (const double dy : {1.0, 2.5}) {
    HeightGrid grid = grid_of(60, 50, 1.0, dy);
    add(grid, [&](int c, int r) {
      const double x = c - 20.0, y = (r - 30.0) * dy;
      return 0.05 * (x * x - y * y) + 0.02 * x * y + 3.0;
    });
    const HeightGrid whole = grid;
    const auto [low, high] = std::minmax_element(whole.z_nm.begin(), whole.z_nm.end());
    std::vector<bool> gap(grid.z_nm.size(), false);
    for (int row = 10; row < 30; ++row) {
      for (int column = 12; column < 33; ++column) gap[at(grid, column, row)] = true;
    }
    gap[at(grid, 50, 40)] = true;
    for (std::size_t i = 0; i < gap.size(); ++i) {
      if (gap[i]) grid.z_nm[i] = std::nan("");
    }
    ASSERT_TRUE(fill_gaps(grid, gap));
    for (std::size_t i = 0; i < gap.size(); ++i) {
      // The sweeps end at changes of 1e-7 of the range; what is then left of an error is some hundred of
      // these.
      EXPECT_NEAR(grid.z_nm[i], whole.z_nm[i], gap[i] ? 1e-4 * (*high - *low) : 0.0) << i << " " << dy;
    }
  }
}

TEST(Gaps, AtTheRimAndEverywhere) {
  HeightGrid grid = grid_of(20, 10, 1.0, 1.0);
  add(grid, [](int c, int) { return c < 5 ? 7.0 : 0.0; });
  std::vector<bool> gap(grid.z_nm.size(), false);
  for (int row = 0; row < 10; ++row) {
    for (int column = 5; column < 20; ++column) gap[at(grid, column, row)] = true;
  }
  ASSERT_TRUE(fill_gaps(grid, gap));  // what surrounds it is level: so is all
  for (const double z : grid.z_nm) EXPECT_EQ(z, 7.0);
  EXPECT_FALSE(fill_gaps(grid, std::vector<bool>(gap.size(), true)));
  EXPECT_TRUE(fill_gaps(grid, std::vector<bool>(gap.size(), false)));
}

TEST(CleanScan, PlaneLinesAndSpikesTogetherAreGivenBack) {
  // Flakes over less than half of a line, as the median between lines needs it.
  HeightGrid ground = grid_of(200, 150, 1.0, 1.0);
  add(ground, [](int c, int r) {
    return (c < 120 ? flakes(c, r) : 0.0) + 0.3 * std::sin(c / 9.0) * std::sin(r / 7.0);
  });
  HeightGrid scan = ground;
  std::mt19937_64 random(11);
  std::normal_distribution<double> noise(0.0, 0.05);
  std::normal_distribution<double> line(0.0, 2.0);
  std::vector<double> offset(150);
  for (double& z : offset) z = line(random);
  add(scan, [&](int c, int r) {
    return 0.02 * c - 0.03 * r + offset[static_cast<std::size_t>(r)] + noise(random);
  });
  for (int i = 0; i < 40; ++i) scan.z_nm[at(scan, (i * 37) % 200, (i * 53) % 150)] += 15.0;
  EXPECT_GE(remove_spikes(scan, 20.0), 38u);
  scene::level_lines(scan);
  subtract(scan, fit_plane(scan));
  double mean = 0;
  for (std::size_t i = 0; i < scan.z_nm.size(); ++i) mean += scan.z_nm[i] - ground.z_nm[i];
  mean /= static_cast<double>(scan.z_nm.size());
  double sum = 0;
  for (std::size_t i = 0; i < scan.z_nm.size(); ++i) {
    const double off = scan.z_nm[i] - ground.z_nm[i] - mean;
    sum += off * off;
  }
  // Noise of 0.05; the medians' random walk, 1.25·√2·0.05/√200 a line, over 150 lines 0.08 at its end, of
  // which the plane takes most; the ground's own ripple, whose median between lines is not zero. Offsets were
  // 2, the plane 6.
  EXPECT_LT(std::sqrt(sum / static_cast<double>(scan.z_nm.size())), 0.15);
}

}  // namespace
}  // namespace telenano::import
