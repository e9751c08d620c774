#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/physics/surface/flat_surface.h"
#include "telenano/nve_server/physics/surface/relative_curvature.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"
#include "tests/source_dir.h"

namespace telenano::physics {
namespace {

constexpr double kRadius = 20;

SplineSurface sampled(int n, double spacing, const std::function<double(double, double)>& height) {
  HeightGrid grid{n, n, spacing, spacing, 0, 0, {}};
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) grid.z_nm.push_back(height(column * spacing, row * spacing));
  }
  return SplineSurface(grid, kRadius);
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
  const SurfaceContact contact = FlatSurface(kRadius).nearest(Vec3(3, 4, 21.5), Search::kGlobal, memory);
  EXPECT_EQ(contact.distance_nm, 21.5);
  EXPECT_EQ(contact.foot_w_nm, Vec3(3, 4, 0));
  EXPECT_EQ(contact.effective_radius_nm, kRadius);
  EXPECT_EQ(contact.radius_gradient, Vec3::Zero());
}

// A plane z = 0.3x − 0.2y + 5: the spline is that plane away from the mirrored ends, whose influence falls by
// 0.268 a sample (0.268^30 = 7e-18 of a slope of 0.3).
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
    EXPECT_LT((contact.foot_w_nm - foot).norm(),
              1e-9);  // Newton's last step, 1e-6 cells, squared, and rounding
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
    // The average over a cell: h²/6·∇²κ of the curvature, ∇²κ = 8/ρ³ at the apex of a paraboloid.
    const double relative = 1 - kRadius / rho;
    EXPECT_NEAR(contact.effective_radius_nm, kRadius / relative,
                1.1 * kRadius * kRadius * 8 / std::abs(rho * rho * rho) / 6 / (relative * relative));
    EXPECT_LT(contact.radius_gradient.norm(), 1e-9);  // by symmetry
    EXPECT_FALSE(contact.radius_clamped);
  }
}

// A pit of radius 15 under a tip of 20.
TEST(NearestPoint, PitNarrowerThanTheTipIsClampedAndSaysSo) {
  const SplineSurface surface = sampled(
      81, 0.5, [](double x, double y) { return ((x - 20) * (x - 20) + (y - 20) * (y - 20)) / (2 * 15.0); });
  FootMemory memory;
  memory.x_nm = memory.y_nm = 20;
  memory.warm = true;
  const SurfaceContact contact = surface.nearest(Vec3(20, 20, 5), Search::kLocal, memory);
  EXPECT_TRUE(contact.radius_clamped);
  EXPECT_NEAR(contact.effective_radius_nm, kRadius / kMinRelativeCurvature, 1e-9);
}

// The field's definition by its oracle: curvatures of the sample shape in closed form at 16 nodes, weighted.
TEST(NearestPoint, RadiusIsThatOfAMeanOverACell) {
  const double a = 1.5, k = 0.1;  // z = a·cos kx: κ₁ = ak²cos kx/(1 + (ak sin kx)²)^1.5, κ₂ = 0
  const double h = 0.5;
  const SplineSurface surface = sampled(400, h, [&](double x, double) { return a * std::cos(k * x); });
  const auto g = [&](double x) {
    const double slope = a * k * std::sin(k * x);
    return std::sqrt(1 + kRadius * a * k * k * std::cos(k * x) / std::pow(1 + slope * slope, 1.5));
  };
  for (int node = 100; node < 300; node += 7) {
    const double x = node * h;
    // Curvature of the spline through the samples: (hk)²/12 of it = 2e-4, at the nodes.
    const double expected = (g(x - h) + 4 * g(x) + g(x + h)) / 6;
    EXPECT_NEAR(surface.relative_curvature(x, 100).value, expected, 1e-4);
    // And the mean is the point's to h²/6 g'' (g'' < 0.01).
    EXPECT_NEAR(surface.relative_curvature(x, 100).value, g(x), 0.25 / 6 * 0.01);
  }
}

// What a potential of distance and radius needs: ∇distance = normal, ∇R_eff = radius_gradient.
TEST(NearestPoint, GradientsAgreeWithFiniteDifferences) {
  const SplineSurface surface = sampled(61, 2.0, [](double x, double y) {
    return 3 * std::sin(0.11 * x) * std::cos(0.13 * y) + 0.002 * x * y;
  });
  std::mt19937 random(17);
  std::uniform_real_distribution<double> place(30, 90);
  const double h = 1e-4;
  double steepest = 0;
  for (int i = 0; i < 200; ++i) {
    Vec3 c(place(random), place(random), 0);
    c.z() = surface.height_nm(c.x(), c.y()) + (i % 2 == 0 ? 19 : 24);
    FootMemory memory;
    const SurfaceContact contact = surface.nearest(c, Search::kGlobal, memory);
    for (int axis = 0; axis < 3; ++axis) {
      FootMemory from = memory;
      const Vec3 d = h * Vec3::Unit(axis);
      const SurfaceContact up = surface.nearest(c + d, Search::kLocal, from);
      const SurfaceContact down = surface.nearest(c - d, Search::kLocal, from);
      // h²/6 of the third derivative (1e-2 1/nm²) and rounding 2e-14/1e-4.
      EXPECT_NEAR((up.distance_nm - down.distance_nm) / (2 * h), contact.normal_w(axis), 2e-9);
      // The foot is known to 1e-10 nm, the radius so to 1e-9; second derivative of R (some 1/nm) jumps not,
      // its third does: h²·10.
      EXPECT_NEAR((up.effective_radius_nm - down.effective_radius_nm) / (2 * h),
                  contact.radius_gradient(axis), 1e-5 * (1 + contact.radius_gradient.norm()));
    }
    EXPECT_LT(std::abs(contact.radius_gradient.dot(contact.normal_w)),
              1e-12 * (1 + contact.radius_gradient.norm()));
    steepest = std::max(steepest, contact.radius_gradient.norm());
  }
  EXPECT_GT(steepest, 0.1);  // there was something to see
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
      // Central difference: h² and rounding of the foot, 1e-10/1e-4; a third derivative that jumps adds first
      // order in h.
      EXPECT_LT((contact.normal_turn_per_nm.col(axis) - (up - down) / (2 * h)).norm(), 2e-5);
    }
  }
}

// Corrugation with several feet in reach of the sphere: the global search must find the least.
TEST(NearestPoint, AgreesWithBruteForceOnACorrugation) {
  const SplineSurface surface = sampled(
      121, 1.0, [](double x, double y) { return 4 * std::sin(0.35 * x) + 2 * std::cos(0.5 * y) + 6; });
  std::mt19937 random(8);
  std::uniform_real_distribution<double> place(40, 80), height(14, 45);
  for (int i = 0; i < 40; ++i) {
    const Vec3 c(place(random), place(random), height(random));
    FootMemory memory;  // cold
    const double found = surface.nearest(c, Search::kGlobal, memory).distance_nm;
    EXPECT_NEAR(found, brute_force(surface, c, 30),
                1e-6);  // brute force resolves 30·0.03·0.15^6/20 nm, squared
  }
}

// On the real scan, cold, warm and after leaps of up to 1 µm: never farther than any of the samples.
TEST(NearestPoint, IsTheNearestOnTheRealScanHoweverFarItLeaps) {
  const surface::Scan scan =
      surface::read_gsf(std::string(TELENANO_SOURCE_DIR) + "/deploy/data/wsxm_600nm.gsf");
  const SplineSurface surface(scan.grid, kRadius);
  const SampleTops tops(scan.grid);
  std::mt19937 random(9);
  std::uniform_real_distribution<double> place(20, 580), height(15.5, 60);
  FootMemory memory;
  int compared = 0, overlooked = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vec3 c(place(random), place(random),
                 surface.height_nm(place(random), place(random)) + height(random));
    if (c.z() < surface.height_nm(c.x(), c.y()) + 12) continue;
    const SurfaceContact contact = surface.nearest(c, Search::kGlobal, memory);
    EXPECT_TRUE(contact.converged);
    double nearest_sample = 1e300;
    for (int row = 0; row < 256; ++row) {
      for (int column = 0; column < 256; ++column) {
        const Vec3 p(scan.grid.x_first_nm + column * scan.grid.dx_nm,
                     scan.grid.y_first_nm + row * scan.grid.dy_nm, scan.grid.z_nm[row * 256 + column]);
        nearest_sample = std::min(nearest_sample, (p - c).squaredNorm());
      }
    }
    nearest_sample = std::sqrt(nearest_sample);
    EXPECT_LE(contact.distance_nm, nearest_sample + 1e-9);
    // And the branch and bound finds just that sample.
    SampleTops::Near near;
    tops.near(c, nearest_sample + 0.01, nearest_sample + 0.01, {}, near);
    double found = 1e300;
    for (int k = 0; k < near.count; ++k) found = std::min(found, std::sqrt(near.samples[k].distance_sq));
    EXPECT_NEAR(found, nearest_sample, 1e-12);
    if (i % 5 == 0) {
      // A summit between samples may be overlooked in favour of another foot that is hardly farther: rarely
      // and by less than a tenth of a nanometre (spacing 2.3 nm), see nearest_point.cpp.
      const double least = brute_force(surface, c, 60);
      EXPECT_NEAR(contact.distance_nm, least, 0.1);
      ++compared;
      if (contact.distance_nm > least + 1e-5) ++overlooked;
    }
  }
  EXPECT_LE(overlooked * 100, compared) << overlooked << " of " << compared;
}

// On the real scan: from anywhere to anywhere, also beyond the rim, in leaps of a micrometre, the answer is
// that of a search from nothing: what was remembered does not count, and nothing is passed through.
TEST(NearestPoint, LeapsOfAMicrometreLeaveNoTrace) {
  const surface::Scan scan =
      surface::read_gsf(std::string(TELENANO_SOURCE_DIR) + "/deploy/data/wsxm_600nm.gsf");
  const SplineSurface surface(scan.grid, kRadius);
  std::mt19937 random(19);
  std::uniform_real_distribution<double> turn(0, 2 * std::acos(-1.0)), height(0, 1);
  FootMemory memory;
  Vec3 c(300, 300, surface.highest_nm() + 40);
  int outside = 0, differ = 0;
  for (int i = 0; i < 3000; ++i) {
    const double angle = turn(random);
    Vec3 next = c + 1000 * Vec3(std::cos(angle), std::sin(angle), 0);
    // About the scan: the rim and 200 nm beyond it.
    for (int axis = 0; axis < 2; ++axis) {
      while (next(axis) < -200) next(axis) += 1000;
      while (next(axis) > 800) next(axis) -= 1000;
    }
    next.z() = surface.highest_nm() + kRadius - 8 + 30 * height(random);
    c = next;
    const SurfaceContact contact = surface.nearest(c, Search::kGlobal, memory);
    FootMemory cold;
    const SurfaceContact afresh = surface.nearest(c, Search::kGlobal, cold);
    EXPECT_TRUE(contact.converged && afresh.converged) << c.transpose();
    EXPECT_LE(contact.distance_nm, c.z() - surface.height_nm(c.x(), c.y()) + 1e-9);
    // Two summits between samples that are hardly different may be taken one for the other
    // (nearest_point.cpp).
    EXPECT_NEAR(contact.distance_nm, afresh.distance_nm, 0.1) << c.transpose();
    if (std::abs(contact.distance_nm - afresh.distance_nm) > 1e-8) ++differ;
    const Vec3& foot = contact.foot_w_nm;
    EXPECT_EQ(contact.outside, !surface.inside(foot.x(), foot.y()));
    if (contact.outside) {
      ++outside;
      // The rim's height goes on across it: no slope that way, and the radius does not change along it.
      if (foot.x() < surface.x_first_nm() || foot.x() > surface.x_last_nm()) {
        EXPECT_NEAR(contact.normal_w.x(), 0, 1e-12);
        EXPECT_NEAR(contact.radius_gradient.x(), 0, 1e-12);
        EXPECT_NEAR(foot.x(), c.x(), 1e-7);
      }
    }
  }
  EXPECT_GT(outside, 300);
  EXPECT_LE(differ * 50, 3000);
}

}  // namespace
}  // namespace telenano::physics
