#include "telenano/nve_server/physics/surface/dilation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "tests/support/sampled_ground.h"

namespace telenano::physics {
namespace {

using support::degrees;
using support::random_grid;
using support::sampled;

constexpr double kPi = 3.14159265358979323846;
constexpr double kRadius = 20;

double relief_of(const HeightGrid& grid) {
  const auto [low, high] = std::minmax_element(grid.z_nm.begin(), grid.z_nm.end());
  return 1.3 * (*high - *low);
}

struct Middle {
  DilatedNode node;
  double x, y;
};

/// The node nearest the middle of the scan, made as its tile is.
Middle middle_of(const HeightGrid& grid, double t) {
  const BicubicSpline height = BicubicSpline::interpolating(grid);
  const DilationLattice lattice =
      dilation_lattice(height, std::sqrt(kRadius * t) / 1.2, 0.5 * std::sqrt(kRadius * t));
  const Dilation dilation(height, lattice, kRadius, t, relief_of(grid));
  const int i = lattice.columns / 2, j = lattice.rows / 2;
  const int tile = Dilation::kTile;
  std::vector<DilatedNode> nodes;
  dilation.make_tile(i / tile, j / tile, nodes);
  const int stride = std::min(tile, lattice.columns - i / tile * tile);
  return {nodes[static_cast<std::size_t>(j % tile * stride + i % tile)], i * lattice.node_dx_nm,
          j * lattice.node_dy_nm};
}

// S = 2πR t c e^{H/t}, H = R(1/c − 1), on every plane. What the sums may be off by: e^−25 of terms left out
// (1e-9 with its area), the midpoint rule 2 exp(−2π² c³/0.25) (below 1e-11 up to 45°), and the end of the
// sphere, which the gap at its rim R(1 − cos(78.5° − θ))/c over t keeps below 1e-10 for these softenings.
TEST(Dilation, PlanesAreExact) {
  struct Case {
    double angle, t;
  };
  for (const Case& one : {Case{0, 0.09},
                          {0, 0.36},
                          {15, 0.09},
                          {15, 0.36},
                          {30, 0.09},
                          {30, 0.18},
                          {45, 0.09},
                          // paraboloid: put right by its own moment
                          {0, 1.5},
                          {15, 1.5},
                          {30, 1.5},
                          {45, 1.5}}) {
    SCOPED_TRACE(std::to_string(one.angle) + " degrees, t = " + std::to_string(one.t));
    const double slope = std::tan(degrees(one.angle)), cosine = std::cos(degrees(one.angle));
    const auto plane = [&](double x, double y) { return slope * (0.8 * x - 0.6 * y); };
    const Middle middle = middle_of(sampled(56, 2.34, plane), one.t);
    EXPECT_NEAR(middle.node.height_nm, plane(middle.x, middle.y) + kRadius * (1 / cosine - 1), 1e-9);
    EXPECT_NEAR(std::exp(middle.node.log_radius) / kRadius, 1.0, 1e-9);
    EXPECT_NEAR(middle.node.cosine, cosine, 1e-8);
  }
}

// A ball of radius r under the tip at angle θ: the dilated ground is a ball of radius R + r. H and R_eff are
// those of Laplace's method with the next order left out, O(t²/R_eff) and O(t/R_eff).
TEST(Dilation, BallsConvexAndConcave) {
  const double t = 0.09;
  for (const double r : {kRadius, -3 * kRadius}) {
    for (const double angle : {0.0, 20.0, 40.0}) {
      SCOPED_TRACE(std::to_string(r) + " nm, " + std::to_string(angle) + " degrees");
      const double x0 = 20, out = (kRadius + r) * std::sin(degrees(angle));
      const auto ball = [&](double x, double y) {
        const double dx = x - (x0 - out), dy = y - x0;
        const double q2 = r * r - dx * dx - dy * dy;
        const double z = q2 > 0 ? std::sqrt(q2) - std::abs(r) : -std::abs(r);
        return r > 0 ? z : -z;
      };
      const HeightGrid grid = sampled(101, 0.4, ball);
      const Middle middle = middle_of(grid, t);
      const double dx = middle.x - (x0 - out), dy = middle.y - x0;
      const double reach = kRadius + r;
      const double up = std::sqrt(reach * reach - dx * dx - dy * dy);
      const double height = r > 0 ? up - reach : -up - reach;
      const double effective = kRadius * r / (kRadius + r);
      EXPECT_NEAR(middle.node.height_nm, height, t * t / effective);
      EXPECT_NEAR(std::exp(middle.node.log_radius) / effective, 1.0, 2.5 * t / effective);
      EXPECT_NEAR(middle.node.cosine, up / std::abs(reach), 2 * t / effective);
    }
  }
}

// Two planes at 30° and a tip between them: two feet of the same height, twice the radius of one. The line
// where they meet is 36 softenings away, and the spline's ringing there has died out over 20 samples.
TEST(Dilation, TwoEqualFeetHaveTwiceTheRadius) {
  const double slope = std::tan(degrees(30)), cosine = std::cos(degrees(30));
  const HeightGrid grid = sampled(161, 0.5, [&](double x, double) { return slope * std::abs(x - 40); });
  const Middle middle = middle_of(grid, 0.0855);
  ASSERT_NEAR(middle.x, 40, 1e-9);
  EXPECT_NEAR(middle.node.height_nm, kRadius * (1 / cosine - 1), 1e-8);
  EXPECT_NEAR(std::exp(middle.node.log_radius) / (2 * kRadius), 1.0, 1e-7);
  EXPECT_NEAR(middle.node.cosine, cosine, 1e-8);
}

struct Direct {
  double height, log_radius, cosine;
};

/// The same sums by another rule: polar coordinates round the apex, long double, heights from a formula.
template <class Height>
Direct direct_sum(Height height, double x, double y, double t, double cone_cosine) {
  const auto psi = [&](long double r, long double& weight, long double& nz) {
    const long double rim = kRadius * std::sqrt(1.0L - static_cast<long double>(cone_cosine) * cone_cosine);
    if (r < rim) {
      const long double q = std::sqrt(static_cast<long double>(kRadius) * kRadius - r * r);
      weight = kRadius / q;
      nz = q / kRadius;
      return q - kRadius;
    }
    weight = 1 / static_cast<long double>(cone_cosine);
    nz = cone_cosine;
    return kRadius * (cone_cosine - 1.0L) - (r - rim) * rim / (kRadius * cone_cosine);
  };
  long double largest = -1e9L;
  const int rings = 1600, spokes = 240;
  const long double dr = 16.0L / rings;
  for (int pass = 0; pass < 2; ++pass) {
    long double s = 0, f = 0, n = 0, nf = 0;
    for (int ring = 0; ring < rings; ++ring) {
      const long double r = (ring + 0.5L) * dr;
      long double weight, nz;
      const long double down = psi(r, weight, nz);
      for (int spoke = 0; spoke < spokes; ++spoke) {
        const long double a = 2 * static_cast<long double>(kPi) * spoke / spokes;
        const long double phi =
            height(x + static_cast<double>(r * std::cos(a)), y + static_cast<double>(r * std::sin(a))) + down;
        if (pass == 0) {
          largest = std::max(largest, phi);
          continue;
        }
        if (phi < largest - 45 * t) continue;
        const long double p = std::exp((phi - largest) / t) * weight * r;
        s += p;
        f += p * (phi - largest);
        n += p * nz;
        nf += p * nz * (phi - largest);
      }
    }
    if (pass == 0) continue;
    const long double above = f / s + t;
    const long double cosine = n / s + (nf / s - n / s * f / s) / t;
    const long double area = dr * 2 * static_cast<long double>(kPi) / spokes;
    return {static_cast<double>(above + largest),
            static_cast<double>(std::log(s * area / (2 * static_cast<long double>(kPi) * t * cosine)) -
                                above / t),
            static_cast<double>(cosine)};
  }
  return {};
}

// Waves that are even about both rims, so that their formula goes on as the mirrored scan does. The height
// spline is off by (kh)⁴/384 of their amplitude: 3e-6 nm, 3e-5 of e^{h/t}, and the polar rule by less.
TEST(Dilation, AgreesWithADirectSumInPolarCoordinatesInsideAndAtTheRim) {
  const auto waves = [](double x, double y) {
    return 0.6 * std::cos(2 * kPi * x / 12) * std::cos(2 * kPi * y / 18) + 0.4 * std::cos(2 * kPi * x / 36);
  };
  const HeightGrid grid = sampled(91, 0.4, waves);
  const BicubicSpline height = BicubicSpline::interpolating(grid);
  for (const double t : {0.09, 0.36}) {
    const DilationLattice lattice = dilation_lattice(height, 3.0, 0.4 * std::sqrt(kRadius * t));
    const std::vector<DilatedNode> nodes = Dilation(height, lattice, kRadius, t, relief_of(grid)).make_all();
    for (const auto& [i, j] : {std::pair{0, 0}, {0, 5}, {3, 4}, {6, 7}, {12, 12}}) {
      SCOPED_TRACE(std::to_string(t) + " at " + std::to_string(i) + ", " + std::to_string(j));
      const Direct direct = direct_sum(waves, i * lattice.node_dx_nm, j * lattice.node_dy_nm, t, kConeCosine);
      const DilatedNode& node = nodes[static_cast<std::size_t>(j * lattice.columns + i)];
      EXPECT_NEAR(node.height_nm, direct.height, 2e-5);
      // c is at most 1; S e^{−H/t} is R_eff c.
      EXPECT_NEAR(node.log_radius + std::log(node.cosine), direct.log_radius + std::log(direct.cosine), 2e-4);
      EXPECT_NEAR(node.cosine, std::min(1.0, direct.cosine), 2e-5);
    }
  }
}

// A relief of thousands of softenings has no room in one double's range: the answer is that of the same
// ground without the far peak.
TEST(Dilation, ReliefOfThousandsOfSoftenings) {
  const auto cliff = [](double x, double) { return x > 100 ? 400.0 * (x - 100) / 20.0 : 0.0; };
  const HeightGrid grid = sampled(61, 2.0, cliff);
  const BicubicSpline height = BicubicSpline::interpolating(grid);
  const DilationLattice lattice = dilation_lattice(height, 2.0, 0.7);
  const std::vector<DilatedNode> nodes = Dilation(height, lattice, kRadius, 0.09, relief_of(grid)).make_all();
  const DilatedNode& far = nodes[static_cast<std::size_t>(20 * lattice.columns + 8)];
  EXPECT_NEAR(far.height_nm, 0, 1e-9);
  EXPECT_NEAR(std::exp(far.log_radius) / kRadius, 1, 1e-9);
  for (const DilatedNode& node : nodes) {
    ASSERT_TRUE(std::isfinite(node.height_nm) && std::isfinite(node.log_radius) && node.cosine <= 1);
  }
}

/// Any law that attracts: the rise depends on its form alone.
RetractionKernel kernel_of_some_law() {
  return {[](double gap, double log_radius) {
            const double range = 0.1 + 0.02 * (log_radius - std::log(kRadius));
            return -std::exp(-0.5 * (gap - 0.1) * (gap - 0.1) / (range * range)) + (gap < 0 ? -3 * gap : 0.0);
          },
          kRadius};
}

// Two lanes or four: to the last bit, spheres and paraboloids. (On a processor without AVX two and two.)
TEST(Dilation, TheSameBitsInWhateverRegisters) {
  const HeightGrid grid = random_grid(6, 40);
  const BicubicSpline height = BicubicSpline::interpolating(grid);
  for (const double t : {0.09, 0.5, 3.0}) {
    const DilationLattice lattice = dilation_lattice(height, 2.0, 0.6 * std::sqrt(kRadius * t));
    const RetractionKernel kernel = kernel_of_some_law();
    const auto made = [&](Lanes lanes) {
      return Dilation(height, lattice, kRadius, t, relief_of(grid), lanes, &kernel).make_all();
    };
    const auto two = made(Lanes::kTwo);
    const auto widest = made(widest_lanes());
    ASSERT_EQ(two.size(), widest.size());
    for (std::size_t k = 0; k < two.size(); ++k) {
      ASSERT_EQ(two[k].height_nm, widest[k].height_nm) << t;
      ASSERT_EQ(two[k].log_radius, widest[k].log_radius) << t;
      ASSERT_EQ(two[k].cosine, widest[k].cosine) << t;
    }
  }
}

// ρ of a plane is ln R also by its pull-off. The areas come from sub-samples on a lattice: what that leaves is
// some 1e-3, and H and c are not touched.
TEST(Dilation, PullOffOfAPlaneIsThatOfTheTip) {
  const RetractionKernel kernel = kernel_of_some_law();
  ASSERT_TRUE(kernel.active());
  for (const double degrees : {0.0, 10.0, 20.0, 30.0}) {
    const double slope = std::tan(degrees * kPi / 180);
    const HeightGrid grid = sampled(61, 1.0, [&](double x, double y) { return slope * (0.8 * x + 0.6 * y); });
    const BicubicSpline height = BicubicSpline::interpolating(grid);
    const DilationLattice lattice = dilation_lattice(height, 1.1, 0.65 * std::sqrt(kRadius * 0.09));
    const Dilation plain(height, lattice, kRadius, 0.09, relief_of(grid));
    const Dilation with(height, lattice, kRadius, 0.09, relief_of(grid), widest_lanes(), &kernel);
    std::vector<DilatedNode> one, two;
    plain.make_rectangle(24, 24, 6, 6, one);
    with.make_rectangle(24, 24, 6, 6, two);
    for (std::size_t k = 0; k < one.size(); ++k) {
      EXPECT_NEAR(two[k].log_radius, std::log(kRadius), 5e-3) << degrees;
      EXPECT_EQ(two[k].height_nm, one[k].height_nm);
      EXPECT_EQ(two[k].cosine, one[k].cosine);
    }
  }
}

// Two flanks of 15 degrees whose feet are apart, one lower by `below`: the radius of the pull-off is twice the tip's
// where they are level and falls to the tip's where the lower one is out of reach. Grids round the crease off, and of
// level feet each has a part of the wedge between them: 5 %.
TEST(Dilation, PullOffFallsFromTwoFeetToOne) {
  const RetractionKernel kernel = kernel_of_some_law();
  const double slope = std::tan(15 * kPi / 180);
  double last = 2.1;
  for (const double below : {0.0, 0.05, 0.1, 0.2, 0.4, 3.0}) {
    const HeightGrid grid = sampled(241, 0.25, [&](double x, double) {
      return x > 30 ? slope * (x - 30) : slope * (30 - x) - std::min(below, slope * (30 - x));
    });
    const BicubicSpline height = BicubicSpline::interpolating(grid);
    const DilationLattice lattice = dilation_lattice(height, 1.0, 0.65 * std::sqrt(kRadius * 0.09));
    std::vector<DilatedNode> node;
    Dilation(height, lattice, kRadius, 0.09, relief_of(grid), widest_lanes(), &kernel)
        .make_rectangle(30, 30, 1, 1, node);
    const double radii = std::exp(node[0].log_radius) / kRadius;
    EXPECT_LT(radii, last) << below;
    if (below == 0.0) {
      EXPECT_NEAR(radii, 2.0, 0.1);
    }
    last = radii;
  }
  EXPECT_NEAR(last, 1.0, 0.01);
}

// Beside a wall of twice the radius the ball of 20 nm does not reach what is further away than 22 nm (the cone
// below its rim: 40 nm at 4.9 nm a nm), and stands on level ground, H = 0, R_eff = R. The paraboloid meets the
// wall 35 nm away, which is 15 to 25 nm of H. What is left: the exponential tail of wall and rim, e^−(gap/t), and
// up to t where both kernels are mixed.
TEST(Dilation, AWallThatTheBallDoesNotReachIsNotThere) {
  for (const double away : {25.0, 28.0, 31.0, 34.0}) {
    for (const double t : {1.2, 1.44, 2.88, 5.0}) {
      SCOPED_TRACE("wall " + std::to_string(away) + " nm away, t = " + std::to_string(t));
      constexpr double kHeight = 40, kEdge = 1.5, kMiddle = 80;
      const auto ground = [&](double x, double) {
        const double u = std::clamp((x - kMiddle - away) / kEdge + 0.5, 0.0, 1.0);
        return kHeight * u * u * (3 - 2 * u);
      };
      const Middle middle = middle_of(sampled(321, 0.5, ground), t);
      ASSERT_LT(std::fabs(middle.x - kMiddle), 3.5);
      // The wall is that much nearer: the reach of the hard ball stays below 22 nm.
      if (away - (middle.x - kMiddle) < 22.5) continue;
      EXPECT_LT(middle.node.height_nm, 1.0 * t);
      EXPECT_GT(middle.node.height_nm, -0.1 * t);
      EXPECT_GT(middle.node.cosine, 0.8);
      EXPECT_NEAR(middle.node.log_radius, std::log(kRadius), 0.5);
    }
  }
}

TEST(Dilation, RefusesWhatIsNoTip) {
  const HeightGrid grid = random_grid(1);
  const SofteningRule rule;
  EXPECT_THROW(ScanFields(grid, 0.0, rule), UserError);
  EXPECT_THROW(ScanFields(grid, NAN, rule), UserError);
  HeightGrid bad = grid;
  bad.z_nm[7] = NAN;
  EXPECT_THROW(ScanFields(bad, kRadius, rule), UserError);
  bad = grid;
  bad.z_nm.pop_back();
  EXPECT_THROW(ScanFields(bad, kRadius, rule), UserError);
  SofteningRule turned;
  turned.coarsest_nm = 0.01;
  EXPECT_THROW(ScanFields(grid, kRadius, turned), UserError);
}

}  // namespace
}  // namespace telenano::physics
