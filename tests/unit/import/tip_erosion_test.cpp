// The oracles are the definitions of dilation, erosion and contact, by every pair of pixels, and the ground
// that a simulated scan was made of.
#include "telenano/nve_server/import/tip_erosion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace telenano::import {
namespace {

using surface::HeightGrid;

HeightGrid random_ground(int columns, int rows, double dx_nm, double dy_nm, std::uint64_t seed) {
  HeightGrid grid;
  grid.columns = columns;
  grid.rows = rows;
  grid.dx_nm = dx_nm;
  grid.dy_nm = dy_nm;
  grid.z_nm.resize(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> height(0.0, 1.0);
  for (double& z : grid.z_nm) {
    const double u = height(random);
    z = 2.0 * height(random) + (u > 0.97 ? 12.0 * height(random) : 0.0);
  }
  return grid;
}

double tip(const HeightGrid& grid, std::size_t a, std::size_t b, double radius_nm) {
  const auto columns = static_cast<std::size_t>(grid.columns);
  const double x = (static_cast<double>(a % columns) - static_cast<double>(b % columns)) * grid.dx_nm;
  const double y = (static_cast<double>(a / columns) - static_cast<double>(b / columns)) * grid.dy_nm;
  return (x * x + y * y) / (2.0 * radius_nm);
}

std::vector<double> dilate_by_pairs(const HeightGrid& grid, const std::vector<double>& z, double radius_nm) {
  std::vector<double> out(z.size(), -INFINITY);
  for (std::size_t p = 0; p < z.size(); ++p) {
    for (std::size_t x = 0; x < z.size(); ++x) out[p] = std::max(out[p], z[x] - tip(grid, x, p, radius_nm));
  }
  return out;
}

// Rounding of heights of 14 nm in the sums, some of them in another order.
constexpr double kRounding_nm = 1e-12;

TEST(TipErosion, IsTheDefinitionByPairs) {
  for (const double radius_nm : {1.0, 3.0, 20.0, 500.0}) {
    for (const auto& [columns, rows, dx, dy] :
         {std::tuple{23, 17, 1.0, 1.0}, {16, 29, 0.8, 2.1}, {2, 2, 1.0, 1.0}}) {
      const HeightGrid grid =
          random_ground(columns, rows, dx, dy, static_cast<std::uint64_t>(columns + rows));
      const std::vector<double> dilated = dilate(grid, radius_nm);
      const std::vector<double> expected = dilate_by_pairs(grid, grid.z_nm, radius_nm);
      const Erosion eroded = erode(grid, radius_nm);
      for (std::size_t i = 0; i < dilated.size(); ++i) {
        EXPECT_NEAR(dilated[i], expected[i], kRounding_nm) << i << " R " << radius_nm;
        double lowest = INFINITY;
        for (std::size_t p = 0; p < dilated.size(); ++p)
          lowest = std::min(lowest, grid.z_nm[p] + tip(grid, i, p, radius_nm));
        EXPECT_NEAR(eroded.z_nm[i], lowest, kRounding_nm) << i << " R " << radius_nm;
      }
    }
  }
}

TEST(TipErosion, DilatedAgainGivesTheScanBack) {
  for (const double radius_nm : {2.0, 10.0, 80.0}) {
    HeightGrid ground = random_ground(64, 48, 1.0, 1.3, 5);
    HeightGrid scan = ground;
    scan.z_nm = dilate(ground, radius_nm);
    const Erosion eroded = erode(scan, radius_nm);
    HeightGrid found = scan;
    found.z_nm = eroded.z_nm;
    const std::vector<double> again = dilate(found, radius_nm);
    for (std::size_t i = 0; i < again.size(); ++i) {
      EXPECT_NEAR(again[i], scan.z_nm[i], kRounding_nm) << i;
      EXPECT_GE(eroded.z_nm[i], ground.z_nm[i] - kRounding_nm) << i;  // the highest ground that fits
      EXPECT_LE(eroded.z_nm[i], scan.z_nm[i] + kRounding_nm) << i;
    }
    EXPECT_LT(eroded.misfit_max_nm, kRounding_nm);
  }
}

TEST(TipErosion, WhatASharpTipMeasuredIsToldAsMisfit) {
  // A spike of one pixel, 5 nm: a tip of 50 nm would have seen 5 − d²/100 a pixel aside. All but the spike's
  // foot goes.
  HeightGrid scan = random_ground(33, 33, 1.0, 1.0, 1);
  std::fill(scan.z_nm.begin(), scan.z_nm.end(), 0.0);
  scan.z_nm[16 * 33 + 16] = 5.0;
  const Erosion eroded = erode(scan, 50.0);
  // The spike is eroded to 1/2R beside it: the next pixel's 0 plus one pixel of the paraboloid.
  EXPECT_NEAR(eroded.z_nm[16 * 33 + 16], 1.0 / 100.0, kRounding_nm);
  EXPECT_NEAR(eroded.misfit_max_nm, 5.0 - 1.0 / 100.0, kRounding_nm);
  EXPECT_NEAR(eroded.misfit_rms_nm, (5.0 - 1.0 / 100.0) / 33.0, 1e-9);
}

TEST(TipErosion, ASpikesImageIsTheTip) {
  HeightGrid ground = random_ground(41, 41, 0.5, 0.5, 1);
  std::fill(ground.z_nm.begin(), ground.z_nm.end(), 0.0);
  const std::size_t middle = 20 * 41 + 20;
  ground.z_nm[middle] = 4.0;
  HeightGrid scan = ground;
  scan.z_nm = dilate(ground, 5.0);
  for (int d = 0; d <= 20; ++d) {
    const double u = 0.5 * d;
    EXPECT_NEAR(scan.z_nm[middle + static_cast<std::size_t>(d)], std::max(0.0, 4.0 - u * u / 10.0),
                kRounding_nm)
        << d;
  }
  EXPECT_NEAR(erode(scan, 5.0).z_nm[middle], 4.0, kRounding_nm);
}

TEST(TipErosion, CertainIsWhatOnePixelAloneTouches) {
  // Villarrubia's count by pairs. Contacts are to rounding: heights that no tie makes equal are apart by far
  // more.
  const double radius_nm = 2.0;
  HeightGrid ground = random_ground(30, 26, 1.0, 1.2, 9);
  HeightGrid scan = ground;
  scan.z_nm = dilate(ground, radius_nm);
  const Erosion eroded = erode(scan, radius_nm);
  const auto [low, high] = std::minmax_element(scan.z_nm.begin(), scan.z_nm.end());
  const double reach = std::sqrt(2.0 * radius_nm * (*high - *low));
  std::vector<bool> expected(scan.z_nm.size(), false);
  for (std::size_t p = 0; p < scan.z_nm.size(); ++p) {
    const double column = static_cast<double>(p % 30), row = static_cast<double>(p / 30);
    if (std::min(column, 29 - column) * 1.0 < reach || std::min(row, 25 - row) * 1.2 < reach) continue;
    std::size_t contacts = 0, where = 0;
    for (std::size_t x = 0; x < scan.z_nm.size(); ++x) {
      if (std::abs(eroded.z_nm[x] - scan.z_nm[p] - tip(scan, x, p, radius_nm)) > (*high - *low) / 65536.0)
        continue;
      ++contacts;
      where = x;
    }
    if (contacts == 1) expected[where] = true;
  }
  EXPECT_EQ(eroded.certain, expected);
  EXPECT_EQ(eroded.certain_count,
            static_cast<std::size_t>(std::count(expected.begin(), expected.end(), true)));
  EXPECT_GT(eroded.certain_count, 5u);
}

TEST(TipErosion, CertainPlacesAreTheGroundsAlsoNearTheRim) {
  // The scan is cut out of a larger one: what stands beyond its rim has shaped it.
  const double radius_nm = 2.0;
  const int margin = 20, columns = 70, rows = 60;
  const HeightGrid larger = random_ground(columns + 2 * margin, rows + 2 * margin, 1.0, 1.0, 21);
  const std::vector<double> image = dilate(larger, radius_nm);
  HeightGrid scan = larger;
  scan.columns = columns;
  scan.rows = rows;
  scan.z_nm.clear();
  std::vector<double> ground;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const auto i = static_cast<std::size_t>((row + margin) * larger.columns + column + margin);
      scan.z_nm.push_back(image[i]);
      ground.push_back(larger.z_nm[i]);
    }
  }
  const Erosion eroded = erode(scan, radius_nm);
  std::size_t higher = 0;
  for (std::size_t i = 0; i < ground.size(); ++i) {
    if (eroded.certain[i]) {
      EXPECT_NEAR(eroded.z_nm[i], ground[i], 1e-9) << i % columns << ", " << i / columns;
    }
    if (eroded.z_nm[i] > ground[i] + 1e-9) ++higher;
  }
  EXPECT_GT(eroded.certain_count, 100u);
  EXPECT_GT(higher, 1000u);  // and there is ground that no tip of this radius reaches
}

TEST(TipErosion, TheBluntestTipIsTheOneThatMeasured) {
  // Spikes of one pixel on a plain: their images are the tip. The oracle is the radius put in.
  for (const double radius_nm : {4.0, 15.0, 60.0}) {
    for (const double noise_nm : {0.0, 0.05}) {
      HeightGrid ground = random_ground(160, 140, 1.0, 1.2, 3);
      std::fill(ground.z_nm.begin(), ground.z_nm.end(), 0.0);
      for (std::size_t i = 11 * 160 + 20; i < ground.z_nm.size(); i += 19 * 160 + 37) ground.z_nm[i] = 10.0;
      HeightGrid scan = ground;
      scan.z_nm = dilate(ground, radius_nm);
      std::mt19937_64 random(5);
      std::normal_distribution<double> noise(0.0, 1.0);
      for (double& z : scan.z_nm) z += noise_nm * noise(random);
      const double found = bluntest_radius_nm(scan, 6.0 * noise_nm + 1e-9);
      // Never sharper than the tip was, but for the 1 % of the search. Blunter by what the tolerance hides of
      // 10 nm: at 4 nm the pixels' 1.0 nm, and 0.3 nm of noise.
      EXPECT_GE(found, 0.985 * radius_nm) << noise_nm;
      EXPECT_LE(found, 1.25 * radius_nm) << noise_nm;
    }
  }
  HeightGrid flat = random_ground(8, 8, 1.0, 1.0, 3);
  std::fill(flat.z_nm.begin(), flat.z_nm.end(), 2.0);
  EXPECT_EQ(bluntest_radius_nm(flat, 1e-9), 1e4);  // tells nothing
}

}  // namespace
}  // namespace telenano::import
