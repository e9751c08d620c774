#include "telenano/nve_server/physics/surface/spline_surface.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "telenano/nve_server/physics/surface/bicubic_spline.h"

namespace telenano::physics {
namespace {

HeightGrid random_grid(int columns, int rows, unsigned seed) {
  HeightGrid grid{columns, rows, 2.0, 1.5, 1.0, -3.0, {}};
  std::mt19937 random(seed);
  for (int i = 0; i < columns * rows; ++i) grid.z_nm.push_back(static_cast<double>(random() % 10000) * 1e-3);
  return grid;
}

TEST(SplineSurface, PassesThroughItsSamples) {
  const HeightGrid grid = random_grid(7, 5, 1);
  const SplineSurface surface(grid);
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      // Rounding of some 30 operations on heights of 10 nm.
      EXPECT_NEAR(surface.height_nm(1.0 + 2.0 * column, -3.0 + 1.5 * row), grid.z_nm[row * 7 + column],
                  1e-12);
    }
  }
}

// Cubic B-spline from its definition by truncated powers.
double bspline(double x) {
  const double a = std::abs(x);
  if (a >= 2) return 0;
  if (a >= 1) return (2 - a) * (2 - a) * (2 - a) / 6;
  return 2.0 / 3 - a * a + a * a * a / 2;
}

// The same spline by another way: one dense system over all coefficients, mirrored ones folded in, solved by
// LU.
TEST(SplineSurface, AgreesWithADenseSolve) {
  for (const auto& [columns, rows] : {std::pair{6, 5}, {2, 2}, {2, 7}}) {
    const HeightGrid grid = random_grid(columns, rows, 2);
    const int n = columns * rows;
    const auto fold = [](int i, int count) { return i < 0 ? -i : (i >= count ? 2 * count - 2 - i : i); };
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, n);
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        for (int dr = -1; dr <= 1; ++dr) {
          for (int dc = -1; dc <= 1; ++dc) {
            a(row * columns + column, fold(row + dr, rows) * columns + fold(column + dc, columns)) +=
                bspline(dr) * bspline(dc);
          }
        }
      }
    }
    const Eigen::VectorXd c = a.fullPivLu().solve(Eigen::Map<const Eigen::VectorXd>(grid.z_nm.data(), n));
    const SplineSurface surface(grid);
    for (double u = 0; u <= columns - 1; u += 0.173) {
      for (double v = 0; v <= rows - 1; v += 0.219) {
        double z = 0;
        for (int i = -1; i <= rows; ++i) {
          for (int j = -1; j <= columns; ++j) {
            z += c(fold(i, rows) * columns + fold(j, columns)) * bspline(v - i) * bspline(u - j);
          }
        }
        EXPECT_NEAR(surface.height_nm(1.0 + 2.0 * u, -3.0 + 1.5 * v), z, 1e-11);
      }
    }
  }
}

TEST(SplineSurface, DerivativesAgreeWithFiniteDifferences) {
  const SplineSurface surface(random_grid(9, 8, 3));
  const double h = 1e-4;
  std::mt19937 random(4);
  std::uniform_real_distribution<double> across(1.5, 16.5), along(-2.5, 7.0);
  for (int i = 0; i < 200; ++i) {
    const double x = across(random), y = along(random);
    const HeightJet j = surface.jet(x, y);
    const auto difference = [&](double dx, double dy) {
      const HeightJet a = surface.jet(x - dx, y - dy), b = surface.jet(x + dx, y + dy);
      return HeightJet{(b.z - a.z) / (2 * h), (b.zx - a.zx) / (2 * h), (b.zy - a.zy) / (2 * h), 0, 0, 0};
    };
    const HeightJet in_x = difference(h, 0), in_y = difference(0, h);
    // Central differences: h²/6 × third derivative (up to 30 nm/nm³ here) = 5e-8, rounding 1e-15·10/1e-4 =
    // 1e-10; first order in h (×30) where a cell border, with its jump of the third derivative, lies between.
    EXPECT_NEAR(j.zx, in_x.z, 1e-6);
    EXPECT_NEAR(j.zy, in_y.z, 1e-6);
    EXPECT_NEAR(j.zxx, in_x.zx, 5e-3);
    EXPECT_NEAR(j.zxy, in_x.zy, 5e-3);
    EXPECT_NEAR(j.zxy, in_y.zx, 5e-3);
    EXPECT_NEAR(j.zyy, in_y.zy, 5e-3);
  }
}

// C² across cell borders, and C¹ across the rim.
TEST(SplineSurface, IsSmoothAcrossBorders) {
  const SplineSurface surface(random_grid(9, 8, 5));
  const double e = 1e-9;
  for (int i = 1; i < 8; ++i) {
    const double x = 1.0 + 2.0 * i, y = 0.77;
    const HeightJet a = surface.jet(x - e, y), b = surface.jet(x + e, y);
    EXPECT_NEAR(a.z, b.z, 1e-7);
    EXPECT_NEAR(a.zx, b.zx, 1e-7);
    EXPECT_NEAR(a.zxx, b.zxx, 1e-6);  // 2e-9 nm × third derivative of up to 30
    EXPECT_NEAR(a.zyy, b.zyy, 1e-6);
  }
  for (const double x : {surface.x_first_nm(), surface.x_last_nm()}) {
    const HeightJet a = surface.jet(x - e, 0.77), b = surface.jet(x + e, 0.77);
    EXPECT_NEAR(a.z, b.z, 1e-7);
    EXPECT_NEAR(a.zx, b.zx, 1e-6);
    EXPECT_NEAR(a.zx, 0.0, 1e-6);
  }
  EXPECT_EQ(surface.height_nm(-100, 2.0), surface.height_nm(surface.x_first_nm(), 2.0));
  EXPECT_FALSE(surface.inside(-100, 2.0));
  EXPECT_TRUE(surface.inside(5, 2.0));
}

// Fourth order: halving the spacing divides the error by 16 (inside, where the mirrored ends are not felt).
TEST(SplineSurface, ConvergesWithTheFourthPower) {
  const auto error = [](int n) {
    HeightGrid grid{n, n, 64.0 / (n - 1), 64.0 / (n - 1), 0, 0, {}};
    for (int row = 0; row < n; ++row) {
      for (int column = 0; column < n; ++column) {
        grid.z_nm.push_back(std::sin(0.3 * column * grid.dx_nm) * std::cos(0.2 * row * grid.dy_nm));
      }
    }
    const SplineSurface surface(grid);
    double worst = 0;
    for (double x = 20; x < 44; x += 0.37) {
      for (double y = 20; y < 44; y += 0.41) {
        worst = std::max(worst, std::abs(surface.height_nm(x, y) - std::sin(0.3 * x) * std::cos(0.2 * y)));
      }
    }
    return worst;
  };
  EXPECT_NEAR(std::log2(error(65) / error(129)), 4.0, 0.25);
}

// Rows at once against one after the other, at rims too, where coefficients are mirrored: same bits and digest.
TEST(BicubicSpline, RowsAtOnceAreWhatOneByOneIs) {
  constexpr int kColumns = 11, kRows = 9;
  std::mt19937 random(5);
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      for (const int count : {1, 3, kColumns - column}) {
        if (column + count > kColumns) continue;
        BicubicSpline at_once = BicubicSpline::interpolating(random_grid(kColumns, kRows, 3));
        BicubicSpline one_by_one = at_once;
        double level[kColumns];
        for (int i = 0; i < count; ++i) {
          level[i] = i % 4 == 1 ? 0.0 : static_cast<double>(random() % 1000 + 1) * 1e-3;
          if (level[i] > 0)
            one_by_one.set_coefficient(column + i, row,
                                       one_by_one.coefficient(column + i, row) + 0.3 * level[i]);
        }
        at_once.raise(column, row, count, level, 0.3);
        EXPECT_EQ(at_once.changes_digest(), one_by_one.changes_digest());
        double fall[kColumns];
        for (int i = 0; i < count; ++i) {
          fall[i] = 0.1 + 0.2 * level[i];
          if (level[i] > 0)
            one_by_one.set_coefficient(column + i, row, one_by_one.coefficient(column + i, row) - fall[i]);
        }
        at_once.lower(column, row, count, level, fall);
        EXPECT_EQ(at_once.changes_digest(), one_by_one.changes_digest());
        NodeRows nodes(at_once, 0, kColumns, 0);
        for (int r = 0; r < kRows; ++r, nodes.next()) {
          double value[kColumns];
          nodes.values(0, kColumns, value);
          for (int c = 0; c < kColumns; ++c) {
            EXPECT_EQ(at_once.coefficient(c, r), one_by_one.coefficient(c, r));
            EXPECT_EQ(value[c], one_by_one.node_value(c, r)) << "mirrored coefficients as well";
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace telenano::physics
