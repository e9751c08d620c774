#include "nve_server/physics/scan_fields.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "common/base/error.h"
#include "nve_server/physics/dilation.h"
#include "tests/support/field_checks.h"

namespace telenano::physics {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kRadius = 20;

double degrees(double d) {
  return d * kPi / 180;
}

template <class Height>
HeightGrid sampled(int count, double spacing, Height height) {
  HeightGrid grid{count, count, spacing, spacing, 0.0, 0.0, {}};
  for (int j = 0; j < count; ++j) {
    for (int i = 0; i < count; ++i) grid.z_nm.push_back(height(i * spacing, j * spacing));
  }
  return grid;
}

double relief_of(const HeightGrid& grid) {
  const auto [low, high] = std::minmax_element(grid.z_nm.begin(), grid.z_nm.end());
  return 1.3 * (*high - *low);
}

HeightGrid random_grid(unsigned seed, int count = 24) {
  std::mt19937 random(seed);
  return sampled(count, 2.0, [&](double, double) { return static_cast<double>(random() % 10000) * 3e-4; });
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

// Two lanes or four: to the last bit, spheres and paraboloids. (On a processor without AVX two and two.)
TEST(Dilation, TheSameBitsInWhateverRegisters) {
  const HeightGrid grid = random_grid(6, 40);
  const BicubicSpline height = BicubicSpline::interpolating(grid);
  for (const double t : {0.09, 0.5, 3.0}) {
    const DilationLattice lattice = dilation_lattice(height, 2.0, 0.6 * std::sqrt(kRadius * t));
    const auto two = Dilation(height, lattice, kRadius, t, relief_of(grid), Lanes::kTwo).make_all();
    const auto widest = Dilation(height, lattice, kRadius, t, relief_of(grid)).make_all();
    ASSERT_EQ(two.size(), widest.size());
    for (std::size_t k = 0; k < two.size(); ++k) {
      ASSERT_EQ(two[k].height_nm, widest[k].height_nm) << t;
      ASSERT_EQ(two[k].log_radius, widest[k].log_radius) << t;
      ASSERT_EQ(two[k].cosine, widest[k].cosine) << t;
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

// Every plane that all levels agree on stays exact under the blend, at any distance. 15°, where the levels
// that are not themselves exact to the last digit (t = 0.7 at R/28) are within 5e-8.
TEST(ScanFields, PlaneIsExactAtAnyDistance) {
  const double slope = std::tan(degrees(15)), cosine = std::cos(degrees(15));
  const HeightGrid grid = sampled(64, 2.34, [&](double x, double y) { return slope * (0.6 * x + 0.8 * y); });
  const ScanFields fields(grid, kRadius, softening_rule(kRadius, 0.4, 52.5, 0.165));
  for (const double v : {-3.0, -0.5, 0.1, 0.8, 4.0}) {
    ContactJet jet;
    const double x = 71.3, y = 74.9;
    const double touch = slope * (0.6 * x + 0.8 * y) + kRadius * (1 / cosine - 1);
    fields.contact_at({x, y, touch + v}, jet);
    EXPECT_NEAR(jet.overlap_nm, -v * cosine, 2e-7);
    EXPECT_NEAR(jet.log_radius, std::log(kRadius), 2e-7);
    EXPECT_NEAR(jet.overlap_grad.z(), -cosine, 2e-7);
    EXPECT_NEAR(jet.overlap_grad.x(), 0.6 * slope * cosine, 2e-7);
    EXPECT_LE(jet.overlap_hess_per_nm.cwiseAbs().maxCoeff(), 2e-6);
  }
}

// The first and second derivatives against differences of the values and of the gradient. The step of 1e-5 nm
// leaves 1e-10/2e-5 of rounding (of some 10 nm) and h²/6 of the next derivative; the Hessian of a cell meets
// that of the next one within 1e-5 of it by a third derivative of some 10/nm² or so, hence relative to its
// size.
TEST(ScanFields, DerivativesAgreeWithDifferences) {
  const HeightGrid grid = random_grid(3);
  const double layer = 0.41;  // made for itself; 0.7 is blended
  const ScanFields fields(grid, kRadius, softening_rule(kRadius, 0.4, 52.5, 0.165), {layer});
  const SofteningRule other{0.35, 5.0, 0.0, 0.6, 0.0};
  std::mt19937 random(4);
  const auto between = [&](double a, double b) {
    return a + (b - a) * 1e-6 * static_cast<double>(random() % 1000000);
  };
  const double h = 1e-5;
  for (int n = 0; n < 2000; ++n) {
    const double x = between(-20, 66), y = between(-20, 66);
    const double away = n % 3 == 0 ? between(-3, 0) : (n % 3 == 1 ? between(0, 2) : between(2, 30));
    const Vec3 at(x, y, fields.touch_height_nm(x, y) + away);
    const auto jet_at = [&](const Vec3& apex) {
      ContactJet jet;
      switch (n % 5) {
        case 0:
          fields.at_softening(apex, 0.7, jet);
          break;
        case 1:
          fields.at_softening(apex, layer, jet);
          break;
        case 2:
          fields.growing_at(apex, other, jet);
          break;
        default:
          fields.contact_at(apex, jet);
      }
      return jet;
    };
    support::expect_derivatives(jet_at, at, h, 1e-7, 2e-5);
    if (HasFatalFailure()) return;
    double overlap = 0, log_radius = 0;
    for (const double softening : {0.7, layer}) {
      ContactJet jet;
      fields.at_softening(at, softening, jet);
      fields.values_at_softening(at, softening, overlap, log_radius);
      ASSERT_NEAR(overlap, jet.overlap_nm, 1e-13 * (1 + std::abs(overlap)));
      ASSERT_NEAR(log_radius, jet.log_radius, 1e-13);
    }
  }
}

// A layer is the dilation at just its softening: at the finest, the fields at touch themselves; and it is
// that of a direct sum at any other (Dilation's tests), so between two levels it lies near their blend.
TEST(ScanFields, ALayerIsTheDilationAtItsSoftening) {
  const HeightGrid grid = random_grid(6);
  const SofteningRule rule = softening_rule(kRadius, 0.4, 52.5, 0.165);
  const ScanFields fields(grid, kRadius, rule, {rule.finest_nm, 0.41});
  const ScanFields without(grid, kRadius, rule);
  double worst = 0;
  for (int n = 0; n < 200; ++n) {
    const Vec3 at(1.0 + 0.21 * n, 40 - 0.17 * n, 3.0);
    ContactJet layer, level;
    fields.at_softening(at, rule.finest_nm, layer);
    without.at_softening(at, rule.finest_nm, level);
    EXPECT_NEAR(layer.overlap_nm, level.overlap_nm, 1e-12);
    EXPECT_NEAR(layer.log_radius, level.log_radius, 1e-12);
    fields.at_softening(at, 0.41, layer);
    without.at_softening(at, 0.41, level);
    worst = std::max(worst, std::abs(layer.overlap_nm - level.overlap_nm));
  }
  EXPECT_GT(worst, 0);
  // The blend takes levels from 0.18 to 0.73 nm, and |dH/dt| is about 1 on this ground.
  EXPECT_LT(worst, 0.55);
  EXPECT_GT(fields.bytes(), without.bytes());
  EXPECT_EQ(fields.hash(), without.hash());  // of the levels
  EXPECT_THROW(ScanFields(grid, kRadius, rule, {0.0}), UserError);
}

// Beyond the rim the mirror image: the same numbers, slopes across the rim turned about, and no step in the
// force.
TEST(ScanFields, MirrorsTheScanAtItsRim) {
  const HeightGrid grid = random_grid(5);
  const ScanFields fields(grid, kRadius, softening_rule(kRadius, 0.4, 52.5, 0.165));
  const double last = 46;
  for (const double out : {0.0, 0.4, 7.0, 40.0}) {
    ContactJet in, beyond;
    fields.contact_at({last - out, 13, 3}, in);
    fields.contact_at({last + out, 13, 3}, beyond);
    EXPECT_NEAR(beyond.overlap_nm, in.overlap_nm, 1e-12);
    EXPECT_NEAR(beyond.overlap_grad.x(), -in.overlap_grad.x(), 1e-12);
    EXPECT_NEAR(beyond.overlap_hess_per_nm(0, 1), -in.overlap_hess_per_nm(0, 1), 1e-11);
    fields.contact_at({out, 13, 3}, in);
    fields.contact_at({-out, 13, 3}, beyond);
    EXPECT_NEAR(beyond.log_radius, in.log_radius, 1e-12);
    EXPECT_NEAR(beyond.log_radius_grad_per_nm.x(), -in.log_radius_grad_per_nm.x(), 1e-12);
  }
  ContactJet jet;  // no number asked for, none out of bounds read
  fields.contact_at({NAN, 1e300, 0}, jet);
}

// Pressed, the overlap grows with depth everywhere, and a Hertzian contact is stable everywhere; two real
// grounds.
TEST(ScanFields, GrowingNeverTurnsTheOverlapBack) {
  struct Piece {
    const char* name;
    int column, row;
  };
  for (const Piece& one : {Piece{"wsxm_600nm.gsf", 60, 110},
                           {"wsxm_600nm.gsf", 190, 170},
                           {"nanoscope_peakforce_1um.gsf", 0, 370},
                           {"nanoscope_peakforce_1um.gsf", 200, 200}}) {
    SCOPED_TRACE(one.name);
    const HeightGrid grid = support::piece_of(one.name, one.column, one.row, 64);
    const ScanFields fields(grid, kRadius, softening_rule(kRadius, 0.4, 52.5, 0.165));
    const double extent = 63 * grid.dx_nm;
    double least_rate = 1, least_stiffness = 1;
    for (int i = 0; i < 90; ++i) {
      for (int j = 0; j < 90; ++j) {
        const double x = extent * (i + 0.37) / 90, y = extent * (j + 0.61) / 90;
        const double touch = fields.touch_height_nm(x, y);
        for (double depth = 0.02; depth < 4; depth *= 1.2) {
          ContactJet jet;
          fields.contact_at({x, y, touch - depth}, jet);
          ASSERT_GT(jet.overlap_nm, 0);
          least_rate = std::min(least_rate, -jet.overlap_grad.z());
          // U = (8/15) √R_eff δ^(5/2), over its ∂²U/∂δ² = 2 √R_eff √δ.
          const double d = jet.overlap_nm, dz = jet.overlap_grad.z(), rz = jet.log_radius_grad_per_nm.z();
          const double by_delta = 2.0 / 3 * d, by_rho = 2.0 / 15 * d * d;
          least_stiffness = std::min(least_stiffness, dz * dz + by_delta * dz * rz + 0.5 * by_rho * rz * rz +
                                                          by_delta * jet.overlap_hess_per_nm(2, 2) +
                                                          by_rho * jet.log_radius_hess_per_nm2(2, 2));
        }
      }
    }
    EXPECT_GE(least_rate, ScanFields::kLeastRate);
    EXPECT_GT(least_stiffness, 0);
  }
}

// The same on ground that has been ploughed, craters, walls and rims: marks lower all levels alike but for
// grids that are too coarse for them.
TEST(ScanFields, GrowingDoesNotTurnTheOverlapBackInMarks) {
  const HeightGrid grid = support::piece_of("wsxm_600nm.gsf", 60, 110, 64);
  const ScanFields ground(grid, kRadius, softening_rule(kRadius, 0.4, 52.5, 0.165));
  ScanFields fields = ScanFields::for_marks(ground);
  // As ploughed: a* = √(R D/2) for a depth D of 3 nm.
  for (double x = 40; x < 100; x += 0.3) {
    fields.press({x, 60 + 0.2 * x, 0.085, 7.5, 0.008, 0.1, 6000, 1.0});
  }
  double least_rate = 1, deepest = 0;
  for (int i = 0; i < 80; ++i) {
    for (int j = 0; j < 60; ++j) {
      const double x = 30 + i, y = 60 + j;
      const double touch = fields.touch_height_nm(x, y);
      deepest = std::max(deepest, ground.touch_height_nm(x, y) - touch);
      for (double depth = 0.02; depth < 4; depth *= 1.3) {
        ContactJet jet;
        fields.contact_at({x, y, touch - depth}, jet);
        ASSERT_GT(jet.overlap_nm, 0);
        least_rate = std::min(least_rate, -jet.overlap_grad.z());
      }
    }
  }
  std::printf("deepest %.2f nm, least rate %.3f\n", deepest, least_rate);
  EXPECT_GT(deepest, 2.0);
  EXPECT_GE(least_rate, ScanFields::kLeastRate);
}

// Van der Waals at a distance, U = −A R_eff/(6 d), against the direct proximity sum −A/(12π) Σ dA/d² over the
// tip's elements, d their vertical gap, put right for the mean slope (on a plane of cosine c the sum with the
// tip's area is c² of the exact one). Beyond 0.95 R the tip goes on as a paraboloid of the same area a
// height, so that a level plane has Derjaguin's A R/(6 d) at any d. Bounds: what is asked for on real ground;
// a pairwise sum over the sphere's volume is less by (2R/(2R + d))².
TEST(ScanFields, VanDerWaalsAtADistanceAgreesWithTheProximitySum) {
  struct Piece {
    const char* name;
    int column, row;
    double nearest_median;  // at 1 nm
  };
  // The first piece is mostly edges of flakes.
  for (const Piece& one :
       {Piece{"wsxm_600nm.gsf", 60, 110, 0.10}, {"nanoscope_peakforce_1um.gsf", 200, 200, 0.06}}) {
    const HeightGrid grid = support::piece_of(one.name, one.column, one.row, 64);
    const BicubicSpline height = BicubicSpline::interpolating(grid);
    const ScanFields fields(grid, kRadius, softening_rule(kRadius, 0.4, 52.5, 0.165));
    const double extent = 63 * grid.dx_nm;
    const auto mirrored = [](double u, double last) {
      u = std::abs(u);
      return u > last ? 2 * last - u : u;
    };
    for (const double gap : {1.0, 4.0, 16.0}) {
      std::vector<double> errors;
      for (int place = 0; place < 49; ++place) {
        const double x = 40 + 11.3 * (place % 7), y = 40 + 11.3 * (place / 7);
        const Vec3 apex(x, y, fields.touch_height_nm(x, y) + gap);
        // Fine elements near the axis, coarse ones beyond, and a level plane at the mean height after that.
        double sum = 0, mean = 0, count = 0;
        const double by_x = (fields.touch_height_nm(x + 2, y) - fields.touch_height_nm(x - 2, y)) / 4;
        const double by_y = (fields.touch_height_nm(x, y + 2) - fields.touch_height_nm(x, y - 2)) / 4;
        const double slope = std::sqrt(1 + by_x * by_x + by_y * by_y);  // 1/c
        const double rim2 = 0.9 * kRadius * kRadius, at_rim = kRadius * (1 - std::sqrt(0.1));
        const auto add = [&](double h, double from, double to) {
          const int n = static_cast<int>(to / h);
          for (int i = -n; i < n; ++i) {
            for (int j = -n; j < n; ++j) {
              const double dx = h * (i + 0.5), dy = h * (j + 0.5);
              if (std::max(std::abs(dx), std::abs(dy)) < from) continue;
              const double ground = height.jet(mirrored(x + dx, extent), mirrored(y + dy, extent)).z;
              const double r2 = dx * dx + dy * dy, q = std::sqrt(std::max(kRadius * kRadius - r2, 0.0));
              const bool on_sphere = r2 < rim2;
              const double up = on_sphere ? kRadius - q : at_rim + (r2 - rim2) / (2 * kRadius);
              const double d = apex.z() + up - ground;
              sum += h * h / (d * d) * (on_sphere ? kRadius / q * slope : 1) * slope;
              mean += ground;
              ++count;
            }
          }
        };
        add(0.4, 0, 16);
        add(1.6, 16, 96);
        const double edge = 96 * 2 / std::sqrt(kPi);  // of a disc as large as the square
        sum += 2 * kPi * kRadius / (apex.z() - mean / count + at_rim + (edge * edge - rim2) / (2 * kRadius));
        ContactJet jet;
        fields.contact_at(apex, jet);
        const double found = std::exp(jet.log_radius) / (6 * -jet.overlap_nm);
        errors.push_back(std::abs(found / (sum / (12 * kPi)) - 1));
      }
      std::sort(errors.begin(), errors.end());
      std::printf("%s, gap %4.0f nm: median %.1f %%, p90 %.1f %%; pairwise %.2f of it\n", one.name, gap,
                  100 * errors[24], 100 * errors[44], std::pow(2 * kRadius / (2 * kRadius + gap), 2));
      EXPECT_LE(errors[24], gap == 1 ? one.nearest_median : 0.06) << gap;
      EXPECT_LE(errors[44], 0.3) << gap;
    }
  }
}

// The same coefficients on every x86-64. CMake runs it a second time with glibc's code without fused
// multiply-add.
TEST(ScanFields, SameBitsEverywhere) {
  const ScanFields fields(random_grid(7, 16), kRadius, softening_rule(kRadius, 0.4, 52.5, 0.165));
  EXPECT_EQ(fields.hash(), 566685692452517784u);
}

// A mark: exact at its apex at every softening, seen from every height, nothing far from it, and nothing at
// all in the ground that it was made from.
TEST(ScanFields, AMarkLowersTheGroundExactlyAtItsApex) {
  const HeightGrid grid = random_grid(9, 40);
  const ScanFields ground(grid, kRadius, softening_rule(kRadius, 0.4, 52.5, 0.165));
  ScanFields marked = ScanFields::for_marks(ground);
  EXPECT_EQ(marked.own_bytes(), 0u);
  std::mt19937 random(11);
  const auto between = [&](double a, double b) {
    return a + (b - a) * 1e-6 * static_cast<double>(random() % 1000000);
  };
  for (int n = 0; n < 60; ++n) {
    FieldMark mark;
    mark.x_nm = between(0, 78);
    mark.y_nm = between(0, 78);
    mark.depth_nm = between(0, 0.5);
    mark.radius_nm = between(0.5, 12);
    mark.log_radius_rise = between(0, 0.3);
    mark.strain = n % 2 == 0 ? 0.1 : 0.0;
    mark.pile_up = n % 3 == 0 ? 1.0 : 0.0;
    const Vec3 apex(mark.x_nm, mark.y_nm, marked.touch_height_nm(mark.x_nm, mark.y_nm));
    std::vector<ContactJet> before, after;
    const double heights[] = {-1.5, -0.3, 0.2, 3.0};
    for (const double z : heights) {
      ContactJet jet;
      marked.contact_at(apex + Vec3(0, 0, z + mark.depth_nm), jet);
      before.push_back(jet);
      marked.at_softening(apex + Vec3(0, 0, z + mark.depth_nm), 1.3, jet);
      before.push_back(jet);
    }
    marked.press(mark);
    for (const double z : heights) {
      ContactJet jet;
      marked.contact_at(apex + Vec3(0, 0, z), jet);
      after.push_back(jet);
      marked.at_softening(apex + Vec3(0, 0, z), 1.3, jet);
      after.push_back(jet);
    }
    for (std::size_t k = 0; k < before.size(); ++k) {
      // Rounding of 16 weights, heights of some nm; slopes over nodes of 1 nm.
      ASSERT_NEAR(after[k].overlap_nm, before[k].overlap_nm, 1e-12);
      ASSERT_NEAR(after[k].log_radius, before[k].log_radius + mark.log_radius_rise, 1e-12);
      ASSERT_LE((after[k].overlap_grad - before[k].overlap_grad).norm(), 1e-10) << n << " " << k;
    }
  }
  EXPECT_GT(marked.own_bytes(), 0u);
  EXPECT_EQ(ground.hash(), ScanFields(grid, kRadius, softening_rule(kRadius, 0.4, 52.5, 0.165)).hash());
  ContactJet a, b;
  ground.contact_at({30, 30, 2}, a);
  ScanFields::for_marks(ground).contact_at({30, 30, 2}, b);
  EXPECT_EQ(a.overlap_nm, b.overlap_nm);
  EXPECT_EQ(a.log_radius_hess_per_nm2, b.log_radius_hess_per_nm2);
}

// One mark changes nothing beyond twice its rim and some nodes; every stencil there reads tiles as they were
// made, and beside the rim tiles of both kinds: values and slopes go on across the borders of tiles.
TEST(ScanFields, AMarkIsLocalAndLeavesNoSeam) {
  const HeightGrid grid = random_grid(10, 60);
  const ScanFields ground(grid, kRadius, softening_rule(kRadius, 0.4, 52.5, 0.165));
  ScanFields marked = ScanFields::for_marks(ground);
  FieldMark mark{59.3, 61.7, 0.6, 6, 0.2, 0.1, 1e9, 1.0};
  marked.press(mark);
  double least = 0, most = 0;
  ContactJet last;
  bool first = true;
  for (double x = 2; x < 116; x += 0.01) {
    ContactJet was, is;
    const Vec3 apex(x, 61.2, 3.0);
    ground.contact_at(apex, was);
    marked.contact_at(apex, is);
    if (std::abs(x - mark.x_nm) > 45) {  // coarse grids: nodes of 7 nm
      ASSERT_EQ(is.overlap_nm, was.overlap_nm) << x;
      ASSERT_EQ(is.log_radius, was.log_radius) << x;
    }
    least = std::min(least, is.overlap_nm - was.overlap_nm);
    most = std::max(most, is.overlap_nm - was.overlap_nm);
    if (!first) {
      ASSERT_NEAR(is.overlap_nm - last.overlap_nm, 0.005 * (is.overlap_grad.x() + last.overlap_grad.x()),
                  2e-5);
    }
    last = is;
    first = false;
  }
  EXPECT_LT(least, -0.5);
  EXPECT_GT(most, 0.05);  // the rim
  for (const FieldMark& none :
       {FieldMark{NAN, 2, 1, 3}, FieldMark{2, 2, -1, 3}, FieldMark{2, 2, 1, INFINITY}}) {
    const std::size_t bytes = marked.own_bytes();
    ContactJet before, after;
    marked.contact_at({3, 3, 1}, before);
    marked.press(none);
    marked.contact_at({3, 3, 1}, after);
    EXPECT_EQ(before.overlap_nm, after.overlap_nm);
    EXPECT_EQ(marked.own_bytes(), bytes);
  }
}

}  // namespace
}  // namespace telenano::physics
