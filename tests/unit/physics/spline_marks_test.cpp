#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <random>
#include <thread>
#include <tuple>

#include "telenano/nve_server/physics/surface/crater.h"
#include "telenano/nve_server/physics/surface/heap_rows.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"
#include "tests/support/alloc_guard.h"

namespace telenano::physics {
namespace {

constexpr double kRadius = 20;

HeightGrid random_grid(int columns, int rows, double dx, double dy, unsigned seed) {
  HeightGrid grid{columns, rows, dx, dy, 1.0, -3.0, {}};
  std::mt19937 random(seed);
  for (int i = 0; i < columns * rows; ++i) grid.z_nm.push_back(static_cast<double>(random() % 1000) * 1e-3);
  return grid;
}

// Levels by rows are those of the plain formula to the bit, both times, in heaps that have room (the first one) and
// in such as have none: more rows than are kept, more columns than a block, columns beyond those known before.
TEST(HeapRows, AreThePlainLevelsBothTimes) {
  for (const auto& [width, height, known] :
       {std::tuple{40, 40, 40}, {100, 100, 100}, {300, 37, 300}, {90, 90, 50}}) {
    const double radius = 0.24 * std::max(width, height);
    const double x = 0.5 * width + 0.17, y = 0.5 * height - 0.31;
    const auto xi_of = [&](int column) { return (column - x) / radius; };
    ColumnPlaces places(0, known - 1, xi_of);
    HeapRows rows;
    int above = 0, seen = 0;
    for (const bool again : {false, true}) {
      if (again) rows.again();
      for (int j = 0; j < height; ++j) {
        const double eta = (j - y) / radius;
        for (int from = 0; from < width; from += HeapRows::kBlock) {
          const int count = std::min(HeapRows::kBlock, width - from);
          const double* const level = rows.levels(from, count, eta, places);
          for (int i = 0; i < count; ++i) {
            ASSERT_EQ(level[i], heap_level(xi_of(from + i), eta)) << from + i << ' ' << j << ' ' << again;
            above += level[i] > 0.0;
            ++seen;
          }
        }
      }
    }
    EXPECT_EQ(seen, 2 * width * height);
    EXPECT_GT(above, width * height / 10);
  }
}

// What press() promises, for marks anywhere, on the rim and at corners too, on grids down to 2×2.
TEST(SplineMarks, AreExactAtTheirFootAndLocal) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(0, 1);
  for (const auto& [columns, rows, dx, dy] :
       {std::tuple{24, 17, 2.34, 2.34}, {9, 30, 1.0, 1.7}, {5, 4, 1.0, 1.0}, {2, 2, 3.0, 1.0}}) {
    for (int i = 0; i < 150; ++i) {
      SplineSurface surface(random_grid(columns, rows, dx, dy, 10 + static_cast<unsigned>(i)));
      const SplineSurface before(surface);
      const double cell = std::max(dx, dy);
      Mark mark{surface.x_first_nm() + unit(random) * (columns - 1) * dx,
                surface.y_first_nm() + unit(random) * (rows - 1) * dy, 3 * unit(random), 12 * unit(random)};
      if (i % 5 == 0) mark.x_nm = i % 2 == 0 ? surface.x_first_nm() : surface.x_last_nm();
      if (i % 3 == 0) mark.y_nm = i % 2 == 0 ? surface.y_last_nm() : surface.y_first_nm();
      if (i % 7 == 0) mark.x_nm = surface.x_first_nm() + dx;  // just on a node
      surface.press(mark);
      const HeightJet was = before.jet(mark.x_nm, mark.y_nm), is = surface.jet(mark.x_nm, mark.y_nm);
      // Rounding of heights of 1 to 4 nm through some hundred operations.
      EXPECT_NEAR(was.z - is.z, mark.depth_nm, 1e-13);
      EXPECT_NEAR(is.zx, was.zx, 1e-13);
      EXPECT_NEAR(is.zy, was.zy, 1e-13);
      const double reach = std::max(mark.radius_nm, 2 * cell) + 2 * cell;
      for (double x = surface.x_first_nm() - 1; x < surface.x_last_nm() + 1; x += 0.61 * dx) {
        for (double y = surface.y_first_nm() - 1; y < surface.y_last_nm() + 1; y += 0.57 * dy) {
          if (std::abs(x - mark.x_nm) <= reach && std::abs(y - mark.y_nm) <= reach) continue;
          ASSERT_EQ(surface.height_nm(x, y), before.height_nm(x, y));
        }
      }
    }
  }
}

// Everything that is kept besides the coefficients follows: an interpolating spline made afresh of the nodes'
// heights is the same field, since there is only one.
TEST(SplineMarks, SurfaceMadeAfreshOfTheHeightsIsTheSame) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> across(1, 60), along(-3, 50), unit(0, 1);
  SplineSurface surface(random_grid(40, 36, 1.5, 1.5, 3));
  for (int i = 0; i < 300; ++i) {
    surface.press({across(random), along(random), 0.3 * unit(random), 8 * unit(random)});
  }
  const SplineSurface fresh(surface.heights());
  // 0.3 nm × 300 marks pile up to some 10 nm; rounding of each is 1e-16 of it, and the solve's.
  for (double x = 1; x < 59; x += 0.73) {
    for (double y = -3; y < 49; y += 0.71) {
      ASSERT_NEAR(surface.height_nm(x, y), fresh.height_nm(x, y), 1e-11);
    }
  }
  EXPECT_EQ(surface.lowest_nm(), fresh.lowest_nm());
}

// Increments under a sphere going in leave its impression: the levels, each of the contact's radius a =
// √(2Rδ) at its depth, add up to δ − r²/2R.
TEST(SplineMarks, IncrementsAddUpToTheIndenter) {
  const double h = 0.5, depth = 2.0;
  SplineSurface surface(HeightGrid{81, 81, h, h, 0, 0, std::vector<double>(6561, 0.0)});
  const int steps = 400;
  for (int i = 1; i <= steps; ++i) {
    const double now = depth * (i - 0.5) / steps;
    surface.press({20.13, 19.91, depth / steps, std::sqrt(2 * kRadius * now) / 0.76});
  }
  EXPECT_NEAR(surface.height_nm(20.13, 19.91), -depth, 1e-11);
  // φ falls from 1 to 0 over the outer half of the radius (its half at 0.736 of it): a few per cent of depth.
  for (double r = 0; r < 12; r += 0.5) {
    const double sphere = std::min(0.0, r * r / (2 * kRadius) - depth);
    EXPECT_NEAR(surface.height_nm(20.13 + r, 19.91), sphere, 0.12 * depth) << r;
  }
}

TEST(SplineMarks, UnusableMarksChangeNothing) {
  SplineSurface surface(random_grid(12, 12, 1, 1, 7));
  const SplineSurface before(surface);
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  for (const Mark& mark : {Mark{kNan, 2, 1, 3},
                           {5, kInf, 1, 3},
                           {5, 2, kNan, 3},
                           {5, 2, -1, 3},
                           {5, 2, 1, -3},
                           {5, 2, 1, kInf},
                           {5, 2, 1, 3, kNan},
                           {5, 2, 1, 3, -1}}) {
    surface.press(mark);
  }
  EXPECT_EQ(surface.heights().z_nm, before.heights().z_nm);
  EXPECT_EQ(surface.view()->version(), 0u);
  // Beyond the rim: at the rim, where the continuation gets its height from.
  surface.press({-50, 2, 1, 3});
  EXPECT_NEAR(before.height_nm(-50, 2) - surface.height_nm(-50, 2), 1, 1e-13);
}

TEST(SplineMarks, CopiesGoTheirOwnWay) {
  SplineSurface surface(random_grid(12, 12, 1, 1, 8));
  SplineSurface copy(surface);
  const std::vector<double> before = surface.heights().z_nm;
  copy.press({5, 2, 1, 3});
  EXPECT_EQ(surface.heights().z_nm, before);
  EXPECT_NE(copy.heights().z_nm, before);
  EXPECT_EQ(surface.view()->version(), 0u);
  EXPECT_EQ(copy.view()->version(), 1u);
  const HeightGrid heights = copy.heights();
  for (int row = 0; row < 12; ++row) {
    for (int column = 0; column < 12; ++column) {
      EXPECT_EQ(copy.view()->height_nm(column, row), static_cast<float>(heights.z_nm[row * 12 + column]));
    }
  }
}

// A viewer on another thread: after a version it sees heights at least as new.
TEST(SplineMarks, ViewerSeesAtLeastTheVersionItRead) {
  SplineSurface surface(HeightGrid{16, 16, 1, 1, 0, 0, std::vector<double>(256, 0.0)});
  const std::shared_ptr<const surface::HeightView> view = surface.view();
  constexpr int kMarks = 2000;
  std::atomic<bool> failed{false};
  std::thread reader([&] {
    std::uint64_t version = 0;
    while (version < kMarks) {
      version = view->version();
      // Every mark lowers (8, 8) by 1/16: exact in float.
      if (view->height_nm(8, 8) > -0.0625f * static_cast<float>(version) + 1e-3f) failed = true;
    }
  });
  for (int i = 0; i < kMarks; ++i) surface.press({8, 8, 0.0625, 3});
  reader.join();
  EXPECT_FALSE(failed);
}

TEST(SplineMarks, TakeNothingFromTheHeap) {
  SplineSurface surface(random_grid(40, 36, 1.5, 1.5, 9));
  if (!support::AllocGuard::active()) GTEST_SKIP() << "allocations are not counted in this build";
  const support::AllocGuard guard;
  for (int i = 0; i < 100; ++i) {
    surface.press({20.0 + 0.1 * i, 20, 0.01, 6, 0.5});
  }
  EXPECT_EQ(guard.allocations(), 0u);
}

}  // namespace
}  // namespace telenano::physics
