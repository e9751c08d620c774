#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "nve_server/physics/flat_surface.h"
#include "nve_server/physics/spline_surface.h"
#include "nve_server/scene/gsf.h"

namespace telenano::physics {
namespace {

SplineSurface sampled(int n, double spacing, const std::function<double(double, double)>& height) {
  HeightGrid grid{n, n, spacing, spacing, 0, 0, {}};
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) grid.z_nm.push_back(height(column * spacing, row * spacing));
  }
  return SplineSurface(grid);
}

// Least distance from the spline itself, by exhaustion: a fine raster, then finer ones around its best point.
double brute_force(const SplineSurface& surface, const Vec3& c, double reach) {
  double best = 1e300, bx = c.x(), by = c.y();
  double half = reach;
  for (int level = 0; level < 8; ++level) {
    const double x0 = bx, y0 = by;
    const int count = level == 0 ? 120 : 20;
    for (int i = -count; i <= count; ++i) {
      for (int j = -count; j <= count; ++j) {
        const double x = x0 + half * i / count, y = y0 + half * j / count;
        const double d = (Vec3(x, y, surface.height_nm(x, y)) - c).norm();
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

TEST(NearestPoint, FlatIsClosedForm) {
  FootMemory memory;
  const SurfaceContact contact = FlatSurface().nearest(Vec3(3, 4, 21.5), Search::kGlobal, memory);
  EXPECT_EQ(contact.distance_nm, 21.5);
  EXPECT_EQ(contact.foot_w_nm, Vec3(3, 4, 0));
  EXPECT_EQ(effective_radius(20, contact).radius_nm, 20.0);
}

// A plane z = 0.3x − 0.2y + 5: the spline is that plane away from the mirrored ends, whose influence falls by 0.268 a sample
// (0.268^30 = 7e-18 of a slope of 0.3).
TEST(NearestPoint, TiltedPlaneIsClosedForm) {
  const SplineSurface surface = sampled(101, 1.0, [](double x, double y) { return 0.3 * x - 0.2 * y + 5; });
  const Vec3 n = Vec3(-0.3, 0.2, 1).normalized();
  FootMemory memory;
  for (double t = 0; t < 6; t += 0.37) {
    const Vec3 foot(50 + std::sin(t), 50 - t, 0.3 * (50 + std::sin(t)) - 0.2 * (50 - t) + 5);
    const Vec3 c = foot + (12 + t) * n;
    const SurfaceContact contact = surface.nearest(c, Search::kGlobal, memory);
    EXPECT_NEAR(contact.distance_nm, 12 + t, 1e-11);
    EXPECT_LT((contact.normal_w - n).norm(), 1e-11);
    EXPECT_LT((contact.foot_w_nm - foot).norm(), 1e-9);  // Newton's last step, 1e-6 cells, squared, and rounding
    EXPECT_NEAR(contact.curvature_1_per_nm, 0, 1e-11);
    EXPECT_LT(contact.normal_turn_per_nm.norm(), 1e-10);
    EXPECT_TRUE(contact.converged);
  }
}

// Summit and pit of a paraboloid z = ±(x² + y²)/(2ρ): curvature ±1/ρ, effective radius (1/R ± 1/ρ)⁻¹.
TEST(NearestPoint, ParaboloidHasItsCurvature) {
  for (const double rho : {-60.0, 35.0}) {  // a summit, a pit
    const SplineSurface surface = sampled(81, 1.0, [rho](double x, double y) {
      return ((x - 40) * (x - 40) + (y - 40) * (y - 40)) / (2 * rho);
    });
    FootMemory memory;
    const SurfaceContact contact = surface.nearest(Vec3(40, 40, 20), Search::kGlobal, memory);
    EXPECT_NEAR(contact.distance_nm, 20, 1e-10);
    EXPECT_NEAR(contact.curvature_1_per_nm, -1 / rho, 1e-9);
    EXPECT_NEAR(contact.curvature_2_per_nm, -1 / rho, 1e-9);
    EXPECT_NEAR(effective_radius(20, contact).radius_nm, 1 / (1 / 20.0 - 1 / rho), 1e-6);
    EXPECT_FALSE(effective_radius(20, contact).clamped);
  }
  SurfaceContact narrow;  // a pit of radius 15 under a tip of 20: clamped, and said so
  narrow.curvature_1_per_nm = narrow.curvature_2_per_nm = -1 / 15.0;
  EXPECT_TRUE(effective_radius(20, narrow).clamped);
  EXPECT_NEAR(effective_radius(20, narrow).radius_nm, 200.0, 1e-9);
}

TEST(NearestPoint, TurnOfTheNormalAgreesWithFiniteDifferences) {
  const SplineSurface surface =
      sampled(61, 2.0, [](double x, double y) { return 3 * std::sin(0.11 * x) * std::cos(0.13 * y); });
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(30, 90);
  const double h = 1e-4;
  for (int i = 0; i < 50; ++i) {
    const Vec3 c(place(random), place(random), 18);
    FootMemory memory;
    const SurfaceContact contact = surface.nearest(c, Search::kGlobal, memory);
    for (int axis = 0; axis < 3; ++axis) {
      FootMemory from = memory;
      const Vec3 d = h * Vec3::Unit(axis);
      const Vec3 up = surface.nearest(c + d, Search::kLocal, from).normal_w;
      const Vec3 down = surface.nearest(c - d, Search::kLocal, from).normal_w;
      // Central difference: h² and rounding of the foot, 1e-10/1e-4; a third derivative that jumps adds first order in h.
      EXPECT_LT((contact.normal_turn_per_nm.col(axis) - (up - down) / (2 * h)).norm(), 2e-5);
    }
  }
}

// Corrugation with several feet in reach of the sphere: the global search must find the least.
TEST(NearestPoint, AgreesWithBruteForceOnACorrugation) {
  const SplineSurface surface =
      sampled(121, 1.0, [](double x, double y) { return 4 * std::sin(0.35 * x) + 2 * std::cos(0.5 * y) + 6; });
  std::mt19937 random(8);
  std::uniform_real_distribution<double> place(40, 80), height(14, 45);
  for (int i = 0; i < 40; ++i) {
    const Vec3 c(place(random), place(random), height(random));
    FootMemory memory;  // cold
    const double found = surface.nearest(c, Search::kGlobal, memory).distance_nm;
    EXPECT_NEAR(found, brute_force(surface, c, 30), 1e-6);  // brute force resolves 30·0.03·0.15^6/20 nm, squared
  }
}

// On the real scan, cold, warm and after leaps of up to 1 µm: never farther than any of the samples.
TEST(NearestPoint, IsTheNearestOnTheRealScanHoweverFarItLeaps) {
  const scene::Scan scan = scene::read_gsf(std::string(TELENANO_SOURCE_DIR) + "/deploy/data/wsxm_600nm.gsf");
  const SplineSurface surface(scan.grid);
  const SampleTops tops(scan.grid);
  std::mt19937 random(9);
  std::uniform_real_distribution<double> place(20, 580), height(15.5, 60);
  FootMemory memory;
  int compared = 0, overlooked = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vec3 c(place(random), place(random), surface.height_nm(place(random), place(random)) + height(random));
    if (c.z() < surface.height_nm(c.x(), c.y()) + 12) continue;
    const SurfaceContact contact = surface.nearest(c, Search::kGlobal, memory);
    EXPECT_TRUE(contact.converged);
    double nearest_sample = 1e300;
    for (int row = 0; row < 256; ++row) {
      for (int column = 0; column < 256; ++column) {
        const Vec3 p(scan.grid.x_first_nm + column * scan.grid.dx_nm, scan.grid.y_first_nm + row * scan.grid.dy_nm,
                     scan.grid.z_nm[row * 256 + column]);
        nearest_sample = std::min(nearest_sample, (p - c).squaredNorm());
      }
    }
    nearest_sample = std::sqrt(nearest_sample);
    EXPECT_LE(contact.distance_nm, nearest_sample + 1e-9);
    // And the branch and bound finds just that sample.
    EXPECT_NEAR(tops.nearest(c, 1e6, 1e6, nullptr, 0).distance_nm, nearest_sample, 1e-12);
    if (i % 5 == 0) {
      // A summit between samples may be overlooked in favour of another foot that is hardly farther: rarely and by less
      // than a tenth of a nanometre (spacing 2.3 nm), see nearest_point.cpp.
      const double least = brute_force(surface, c, 60);
      EXPECT_NEAR(contact.distance_nm, least, 0.1);
      ++compared;
      if (contact.distance_nm > least + 1e-5) ++overlooked;
    }
  }
  EXPECT_LE(overlooked * 50, compared) << overlooked << " of " << compared;
}

}  // namespace
}  // namespace telenano::physics
