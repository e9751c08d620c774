#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "telenano/common/base/constants.h"
#include "telenano/nve_server/physics/equilibrium/tip_equilibrium.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"

namespace telenano::physics {
namespace {

double log_uniform(std::mt19937_64& random, double low, double high) {
  return low * std::exp(std::uniform_real_distribution<double>(0, std::log(high / low))(random));
}

// Ground of one of five kinds, in units of the tip's radius: waves of all lengths with the amplitudes of a
// rough scan, grooves and pits narrower than the tip, steps, sharp grains.
HeightGrid ground(std::mt19937_64& random, double radius, int kind) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  constexpr int kSamples = 96;
  const double spacing = radius * log_uniform(random, 0.04, 0.4);
  HeightGrid grid{kSamples, kSamples, spacing, spacing, 0, 0, {}};
  const double width = radius * log_uniform(random, 0.15, 2), depth = radius * log_uniform(random, 0.05, 1);
  struct Wave {
    double kx, ky, phase, height;
  };
  std::vector<Wave> waves;
  for (int i = 0; i < 24; ++i) {
    const double length = spacing * log_uniform(random, 2.5, 60);
    const double angle = kPi * uniform(random);
    waves.push_back({2 * kPi / length * std::cos(angle), 2 * kPi / length * std::sin(angle),
                     kPi * uniform(random), 0.01 * length * uniform(random)});
  }
  for (int row = 0; row < kSamples; ++row) {
    for (int column = 0; column < kSamples; ++column) {
      const double x = column * spacing, y = row * spacing;
      double z = 0;
      for (const Wave& w : waves) z += w.height * std::cos(w.kx * x + w.ky * y + w.phase);
      const double u = std::remainder(x + 0.2 * y, 4 * width) / width;
      const double v = std::remainder(y - 0.3 * x, 4 * width) / width;
      if (kind == 1) z -= depth / (1 + 4 * u * u);
      if (kind == 2) z -= depth / ((1 + 4 * u * u) * (1 + 4 * v * v));
      if (kind == 3) z += depth * std::tanh(4 * u);
      if (kind == 4) z += depth * std::exp(-4 * (u * u + v * v));
      grid.z_nm.push_back(z);
    }
  }
  return grid;
}

// z = A sin(px) + B cos(qy), exactly: foot by Newton's method to rounding, curvatures from the derivatives,
// the gradient of R_eff by differences of eighth order (error (h p)⁸ ~ 1e-18).
class Waves final : public Surface {
 public:
  SurfaceContact nearest(const Vec3& c, Search, FootMemory& memory) const noexcept override {
    double x = memory.warm ? memory.x_nm : c.x(), y = memory.warm ? memory.y_nm : c.y();
    Jet j;
    double m11 = 1, m22 = 1, m12 = 0, det = 1;
    for (int i = 0; i < 50; ++i) {
      j = jet(x, y);
      const double r = j.z - c.z();
      const double gx = x - c.x() + r * j.zx, gy = y - c.y() + r * j.zy;
      m11 = 1 + j.zx * j.zx + r * j.zxx;
      m22 = 1 + j.zy * j.zy + r * j.zyy;
      m12 = j.zx * j.zy;
      det = m11 * m22 - m12 * m12;
      const double sx = -(m22 * gx - m12 * gy) / det, sy = -(m11 * gy - m12 * gx) / det;
      x += sx;
      y += sy;
      if (std::abs(sx) + std::abs(sy) < 1e-13) break;
    }
    j = jet(x, y);
    memory = {x, y, true};
    SurfaceContact contact;
    contact.foot_w_nm = Vec3(x, y, j.z);
    contact.normal_w = Vec3(-j.zx, -j.zy, 1).normalized();
    contact.distance_nm = (c - contact.foot_w_nm).dot(contact.normal_w);
    const Vec3 tx(1, 0, j.zx), ty(0, 1, j.zy);
    const Vec3 ux = (m22 * tx - m12 * ty) / det, uy = (m11 * ty - m12 * tx) / det;  // (dx, dy) = (ux, uy)·dc
    contact.normal_turn_per_nm = (Mat3::Identity() - contact.normal_w * contact.normal_w.transpose() -
                                  tx * ux.transpose() - ty * uy.transpose()) /
                                 contact.distance_nm;
    contact.effective_radius_nm = effective_radius(x, y);
    contact.radius_gradient = slope([&](double d) { return effective_radius(x + d, y); }) * ux +
                              slope([&](double d) { return effective_radius(x, y + d); }) * uy;
    return contact;
  }
  double height_nm(double x, double y) const noexcept override { return jet(x, y).z; }
  double lowest_nm() const noexcept override { return -3; }
  double highest_nm() const noexcept override { return 3; }
  bool is_flat() const noexcept override { return false; }

  static constexpr double kTip = 20;

 private:
  struct Jet {
    double z, zx, zy, zxx, zyy;
  };
  static Jet jet(double x, double y) noexcept {
    constexpr double p = 0.1, q = 0.08, a = 1.5, b = 1.2;
    return {a * std::sin(p * x) + b * std::cos(q * y), a * p * std::cos(p * x), -b * q * std::sin(q * y),
            -a * p * p * std::sin(p * x), -b * q * q * std::cos(q * y)};
  }
  static double effective_radius(double x, double y) noexcept {
    const Jet j = jet(x, y);
    const double w2 = 1 + j.zx * j.zx + j.zy * j.zy;
    const double mean = -0.5 * ((1 + j.zy * j.zy) * j.zxx + (1 + j.zx * j.zx) * j.zyy) / (w2 * std::sqrt(w2));
    const double gauss = j.zxx * j.zyy / (w2 * w2);
    return kTip / std::sqrt(1 + 2 * kTip * mean + kTip * kTip * gauss);
  }
  template <class F>
  static double slope(const F& f) {
    constexpr double h = 0.05;
    return (4.0 / 5 * (f(h) - f(-h)) - 1.0 / 5 * (f(2 * h) - f(-2 * h)) + 4.0 / 105 * (f(3 * h) - f(-3 * h)) -
            1.0 / 280 * (f(4 * h) - f(-4 * h))) /
           h;
  }
};

struct Loop {
  Vec3 centre, first, second, third;
  Vec3 at(double t) const {
    return centre + std::sin(t) * first + (std::cos(t) - 1) * second + std::sin(2 * t) * third;
  }
  Vec3 rate(double t) const {
    return std::cos(t) * first - std::sin(t) * second + 2 * std::cos(2 * t) * third;
  }
};

Loop random_loop(std::mt19937_64& random) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto any = [&](double size, double height) {
    return Vec3(size * uniform(random), size * uniform(random), height * uniform(random));
  };
  return {Vec3(40 * uniform(random), 40 * uniform(random), -9), any(6, 0.7), any(6, 0.7), any(3, 0.3)};
}

// Smooth ground, one branch: the force is a gradient, and the work of the free end round any closed path is
// none. The trapezium rule converges faster than any power for a periodic integrand. What is left is the step
// at which the balance is taken for found, and the law's own error.
TEST(EquilibriumProperty, NoWorkRoundAClosedPath) {
  std::mt19937_64 random(11);
  const TipSampleLaw law({20.0, 0.4, 0.165, true});
  Compliance c = Vec3(0.05, 0.06, 0.075).asDiagonal();
  c(1, 2) = c(2, 1) = 0.02;
  double worst = 0, worst_without = 0;
  for (int path = 0; path < 20; ++path) {
    const Loop loop = random_loop(random);
    for (const bool with : {true, false}) {
      const TipEquilibrium equilibrium(std::make_shared<Waves>(), law, Waves::kTip, {{}, with});
      TipState state;
      for (double z = 20; z > 0; z -= 0.5) equilibrium.advance(loop.at(0) + Vec3(0, 0, z), c, state);
      constexpr int kSteps = 1500;
      double work = 0, size = 0;
      for (int i = 0; i < kSteps; ++i) {
        const double t = 2 * kPi * i / kSteps;
        const TipSolution s = equilibrium.advance(loop.at(t), c, state);
        ASSERT_EQ(s.status, SolveStatus::kOk);
        ASSERT_EQ(s.branch, Branch::kContact);
        ASSERT_EQ(s.feet, 1);
        work += s.force_w_nn.dot(loop.rate(t));
        size += std::abs(s.force_w_nn.dot(loop.rate(t)));
      }
      double& most = with ? worst : worst_without;
      most = std::max(most, std::abs(work) / size);
    }
  }
  EXPECT_LT(worst, 1e-10);         // seen: 7e-12
  EXPECT_GT(worst_without, 1e-4);  // it is the radius' part that makes it so
}

// Any path, friction included: the work of the free end is stored or dissipated, to the path's own
// discretisation, which falls with the step (sixteen times shorter: 16 at first order, 256 at second).
TEST(EquilibriumProperty, WorkIsStoredOrDissipated) {
  std::mt19937_64 random(12);
  const TipSampleLaw law({20.0, 0.4, 0.165, true});
  const Compliance c = Vec3(0.05, 0.06, 0.075).asDiagonal();
  for (int path = 0; path < 6; ++path) {
    Loop loop = random_loop(random);
    if (path % 2 == 1) loop.third.z() = 12;  // in and out of contact
    EquilibriumOptions options{{}, true};
    if (path % 3 != 0) options.friction = FrictionParameters{0.2, 8.0, 0.1, 1.0};
    double error[2] = {0, 0};
    bool jumped = false;
    for (const int fine : {0, 1}) {
      const TipEquilibrium equilibrium(std::make_shared<Waves>(), law, Waves::kTip, options);
      TipState state;
      for (double z = 20; z > 0; z -= 0.5) equilibrium.advance(loop.at(0) + Vec3(0, 0, z), c, state);
      const int steps = fine == 0 ? 3000 : 48000;
      TipSolution s = equilibrium.advance(loop.at(0), c, state);
      const auto stored = [&] {
        return s.potential_aj + s.friction_stored_aj + 0.5 * s.force_w_nn.dot(c * s.force_w_nn);
      };
      const double before = stored();
      double work = 0, lost = 0, size = 0;
      for (int i = 1; i <= steps; ++i) {
        const Vec3 from = state.free_end_w_nm, force = s.force_w_nn, to = loop.at(2.2 * kPi * i / steps);
        s = equilibrium.advance(to, c, state);
        ASSERT_EQ(s.status, SolveStatus::kOk);
        ASSERT_GE(s.friction_dissipated_aj, 0);
        ASSERT_GE(s.dissipated_aj, 0);
        const double part = -0.5 * (force + s.force_w_nn).dot(to - from);
        work += part;
        size += std::abs(part);
        lost += s.dissipated_aj + s.friction_dissipated_aj;
        jumped = jumped || s.jumps > 0;
      }
      error[fine] = std::abs(work - lost - (stored() - before)) / size;
    }
    EXPECT_LT(error[0], 1e-2) << path;
    // A jump on turning ground is booked as one along the normal: what the tip then slides is not.
    if (!jumped) {
      EXPECT_LT(error[1], 1e-9 + error[0] / 6) << path;
    }
  }
}

// Whatever the tip, the ground, the springs and the step: a balance is found, or the tip is on its way to
// one, finite, within the iterations of a step; otherwise the state is left as it was.
struct Found {
  int steps = 0;
  int failed = 0;
  int under_way = 0;        // no balance in this step, the tip slides
  int stuck = 0;            // of these: or stays
  int most_iterations = 0;  // but for the first balance
};

Found search_everywhere(bool friction) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> normal;
  Found found;
  int &steps = found.steps, &failed = found.failed, pressed = 0, corners = 0;
  for (int world = 0; world < 150; ++world) {
    const double radius = log_uniform(random, 1, 1e4);
    const HeightGrid grid = ground(random, radius, world % 5);
    const auto surface = std::make_shared<SplineSurface>(grid, radius);
    TipSampleParameters material;
    material.contact_modulus_gpa = log_uniform(random, 1e-3, 1e3) * 4 / 3;
    // Overlaps beyond half the radius, where adhesion alone sinks the tip in, have no half-space theory.
    const double stickiest = 0.05 * material.contact_modulus_gpa * radius;
    material.work_of_adhesion_n_m = std::min(log_uniform(random, 1e-3, 1), stickiest);
    EquilibriumOptions options;
    if (friction) {
      options.friction =
          FrictionParameters{0.01 * material.contact_modulus_gpa, 0.2 * material.contact_modulus_gpa, 0.0,
                             world % 2 == 1 ? 1.0 : 0.7};
    }
    const TipEquilibrium equilibrium(surface, TipSampleLaw(material), radius, options);
    const double coupling = log_uniform(random, 1e-3, 1e6);
    const double probe = log_uniform(random, 1e-2, 1e3);
    const Compliance c = Mat3::Identity() / coupling + Mat3(Vec3(0, 0, 1 / probe).asDiagonal());
    // Pressed by what dents the sample by some hundredth of the radius, in a spring of this compliance.
    const double dent = radius * log_uniform(random, 1e-4, 0.05);
    const double load = material.contact_modulus_gpa * std::sqrt(radius * dent) * dent;
    const double deepest = std::min(2000.0, dent + c(2, 2) * load);
    const double side = 95 * grid.dx_nm;
    Vec3 end(0.5 * side, 0.5 * side, surface->highest_nm() + radius);
    TipState state;
    for (int step = 0; step < 300; ++step) {
      Vec3 move(normal(random), normal(random), 0.3 * normal(random));
      move *= log_uniform(random, 0.1, step % 10 == 0 ? 1000 : 20) / move.norm();
      end += move;
      end.x() = std::clamp(end.x(), 0.2 * side, 0.8 * side);
      end.y() = std::clamp(end.y(), 0.2 * side, 0.8 * side);
      const double ground_z = surface->height_nm(end.x(), end.y());
      end.z() = std::clamp(end.z(), ground_z - deepest, ground_z + 2 * dent + 5);
      const TipState before = state;
      const TipSolution s = equilibrium.advance(end, c, state);
      ++steps;
      found.under_way += s.under_way;
      found.stuck += s.stuck;
      if (step > 0) found.most_iterations = std::max(found.most_iterations, s.iterations);
      if (s.status != SolveStatus::kOk) {
        ++failed;
        EXPECT_EQ(state.apex_w_nm, before.apex_w_nm);
        EXPECT_EQ(state.foot_count, before.foot_count);
        continue;
      }
      if (s.stuck && step % 2 == 0) {  // and stays, at no cost, until the end moves
        const TipSolution still = equilibrium.advance(end, c, state);
        EXPECT_TRUE(still.stuck);
        EXPECT_EQ(still.iterations, 0);
        EXPECT_EQ(still.apex_w_nm, s.apex_w_nm);
        EXPECT_EQ(still.potential_aj, s.potential_aj);
      }
      EXPECT_TRUE(is_finite(s.apex_w_nm) && is_finite(s.force_w_nn) && std::isfinite(s.potential_aj));
      EXPECT_GE(s.friction_dissipated_aj, 0);
      EXPECT_LT((s.apex_w_nm - end - c * s.force_w_nn).norm(), 1e-9 * (1 + (end - s.apex_w_nm).norm()));
      if (s.normal_force_nn > 0) ++pressed;
      if (s.feet > 1) ++corners;
    }
  }
  EXPECT_GT(pressed, steps / 4);
  EXPECT_GT(corners, steps / 300);
  EXPECT_LE(found.most_iterations, 54 + 15);  // a step's limit, passed by what its last attempt takes
  ::testing::Test::RecordProperty("under_way", found.under_way);
  ::testing::Test::RecordProperty("stuck", found.stuck);
  return found;
}

// No step without an end. Under way, seen 1.0 % (0.05 % stuck): leaps of up to a micrometre on springs softer
// than 0.01 N/m end in mid-slide, and in corners whose feet differ much in radius there may be no balance.
TEST(EquilibriumProperty, EndsEveryStep) {
  const Found found = search_everywhere(false);
  EXPECT_EQ(found.failed, 0);
  EXPECT_LT(found.under_way, 0.015 * found.steps);
  EXPECT_GT(found.stuck, 0);
  EXPECT_LT(found.stuck, 0.003 * found.steps);
}

// Seen 6.8 % and 1.1 %: stick–slip at a kinetic ratio of 0.7 in half of these worlds.
TEST(EquilibriumProperty, EndsEveryStepWithFriction) {
  const Found found = search_everywhere(true);
  EXPECT_EQ(found.failed, 0);
  EXPECT_LT(found.under_way, 0.08 * found.steps);
  EXPECT_LT(found.stuck, 0.015 * found.steps);
}

}  // namespace
}  // namespace telenano::physics
