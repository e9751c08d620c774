// Tip and particle on a ground that is one potential for each of them.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <random>

#include "telenano/nve_server/physics/particle/particle_equilibrium.h"
#include "telenano/nve_server/physics/surface/flat_surface.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "telenano/nve_server/physics/surface/shape_fields.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"
#include "tests/support/alloc_guard.h"
#include "tests/support/contact_paths.h"

namespace telenano::physics {
namespace {

using telenano::testing::material_of;

constexpr double kTip = 10;
constexpr double kParticle = 12;
constexpr double kPi_ = 3.14159265358979323846;
constexpr double kSide = 80;    // nm, of the ground
constexpr double kPeriod = 40;  // one pit in its middle, at (40, 40)
const Compliance kSprings = Vec3(0.05, 0.05, 0.075).asDiagonal();

HeightGrid egg_box() {
  HeightGrid grid{41, 41, 2, 2, 0, 0, {}};
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      const double x = 2 * kPi_ * 2 * column / kPeriod, y = 2 * kPi_ * 2 * row / kPeriod;
      grid.z_nm.push_back(-0.5 * (std::cos(x) + std::cos(y)));
    }
  }
  return grid;
}

std::shared_ptr<const TipPotential> potential(std::shared_ptr<const ContactFields> fields,
                                              const TipSampleParameters& law, double radius) {
  return std::make_shared<TipPotential>(std::move(fields),
                                        std::make_shared<BranchPotential>(TipSampleLaw(law, radius), radius));
}

std::shared_ptr<const TipPotential> on_grid(const HeightGrid& grid, const TipSampleParameters& law,
                                            double radius) {
  const SofteningRule rule = softening_rule(radius, law.work_of_adhesion_n_m, 0.75 * law.contact_modulus_gpa,
                                            law.equilibrium_distance_nm);
  return potential(std::make_shared<ScanFields>(grid, radius, rule), law, radius);
}

// λ = 1 between all; no friction, hardly any drag.
ParticleParameters smooth() {
  ParticleParameters p;
  p.tip_radius_nm = kTip;
  p.particle_radius_nm = kParticle;
  p.particle_sample = material_of(1.0, false);
  p.tip_particle = p.particle_sample;
  p.tip_sample = p.particle_sample;
  p.drag_n_s_m = 1e-12;
  return p;
}

struct EggBox {
  ParticleParameters parameters = smooth();
  std::shared_ptr<const TipPotential> tip, particle;
  std::shared_ptr<const Surface> surface;
  EggBox() {
    const HeightGrid grid = egg_box();
    tip = on_grid(grid, parameters.tip_sample, kTip);
    particle = on_grid(grid, parameters.particle_sample, kParticle);
    surface = std::make_shared<SplineSurface>(grid);
  }
  ParticleEquilibrium scene() const { return {surface, parameters, {tip, particle}}; }
};
const EggBox& egg() {
  static const EggBox made;
  return made;
}

double energy_at(const Vec3& centre) {
  PotentialBranch inside;
  inside.inside = true;
  CurveHint hint;
  PotentialSample at;
  if (egg().particle->sample(centre - Vec3(0, 0, kParticle), inside, hint, at) != BranchEnd::kNone)
    return std::numeric_limits<double>::quiet_NaN();
  return at.energy_aj;
}

// Let go 3 nm beside the pit, without friction, it comes to rest in a local minimum of the energy, told by
// the energy alone: no place within a nanometre has less, the slope by central differences is nothing and
// the curvature positive. By the symmetry of the ground that is the middle of the pit, whose ground bends up
// most.
TEST(ParticleGround, ComesToRestInALocalMinimum) {
  const ParticleEquilibrium scene = egg().scene();
  ParticleState state = scene.place(42.5, 38.5);
  ParticleSolution s;
  for (int i = 0; i < 20; ++i) {
    s = scene.advance(Vec3(15, 15, 40), kSprings, 1.0, state);
    ASSERT_EQ(s.status, SolveStatus::kOk) << i;
  }
  const Vec3 rest = state.particle_centre_w_nm;
  EXPECT_TRUE(s.on_surface);
  // Fields of a symmetric grid are symmetric to rounding; a curvature of 0.1 N/m and a balance to 1e-9 of
  // 10 nN make 1e-7 nm.
  EXPECT_NEAR(rest.x(), 40, 1e-5);
  EXPECT_NEAR(rest.y(), 40, 1e-5);
  // Energies of 10 aJ are known to 1e-14: over 2e-3 nm a slope to 1e-10 nN, a curvature to 1e-6 N/m; what the
  // law's own bend adds to the slope is below 1e-4 N/m² × (1e-3 nm)², 1e-7 nN.
  const double h = 1e-3;
  const double middle = energy_at(rest);
  Mat3 bend;
  for (int i = 0; i < 3; ++i) {
    const Vec3 a = h * Vec3::Unit(i);
    EXPECT_NEAR((energy_at(rest + a) - energy_at(rest - a)) / (2 * h), 0, 2e-4) << i;
    for (int k = 0; k < 3; ++k) {
      const Vec3 b = h * Vec3::Unit(k);
      bend(i, k) = (energy_at(rest + a + b) - energy_at(rest + a - b) - energy_at(rest - a + b) +
                    energy_at(rest - a - b)) /
                   (4 * h * h);
    }
  }
  EXPECT_GT(Eigen::SelfAdjointEigenSolver<Mat3>(bend).eigenvalues().minCoeff(), 1e-3);
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1, 1);
  int looked = 0;
  for (int i = 0; i < 2000; ++i) {
    const double there = energy_at(rest + Vec3(unit(random), unit(random), unit(random)));
    if (!std::isfinite(there)) continue;  // torn off, or no state of the contact
    ++looked;
    ASSERT_GT(there, middle);
  }
  EXPECT_GT(looked, 500);
}

struct Lap {
  double left_over = 0;  // work less what is stored and lost, of the turnover
  double lost = 0;       // of the turnover
  double iterations = 0;
  double turnover_aj = 0;
};

// The free end on a circle, x = middle + Σ a cos θ: the trapezium over equal steps of θ is that of a periodic
// function, as exact as the forces are smooth.
Lap lap_of(int steps, const Vec3& middle, const Vec3& along, const Vec3& across) {
  const ParticleEquilibrium scene = egg().scene();
  ParticleState state = scene.place(40, 40);
  const auto go = [&](const Vec3& end) {
    const ParticleSolution s = scene.advance(end, kSprings, 1.0, state);
    EXPECT_EQ(s.status, SolveStatus::kOk);
    return s;
  };
  const double top = state.particle_centre_w_nm.z() + kParticle;
  // Into contact from above, no lower: under pressure a ball that nothing rubs rolls away from under the tip.
  for (double z = 3; z > 0.05; z -= 0.1) go(Vec3(40, 40, top + z));
  const auto at = [&](double part) {
    const double theta = 2 * kPi_ * part;
    return Vec3(Vec3(40, 40, top) + middle + std::cos(theta) * along + std::sin(theta) * across);
  };
  const Vec3 first = at(0);
  const Vec3 from = Vec3(40, 40, top + 0.1);
  for (int i = 1; i <= 20; ++i) go(Vec3(from + (first - from) * i / 20));
  for (int i = 1; i <= steps; ++i) go(at(1.0 * i / steps));  // a lap to forget how it came
  Lap lap;
  ParticleSolution before = go(first);
  const double stored =
      before.tip.potential_aj + 0.5 * before.tip.force_w_nn.dot(kSprings * before.tip.force_w_nn);
  double work = 0, lost = 0;
  int iterations = 0, torn = 0;
  for (int i = 1; i <= steps; ++i) {
    const Vec3 move = at(1.0 * i / steps) - at(1.0 * (i - 1) / steps);
    const ParticleSolution s = go(at(1.0 * i / steps));
    const double w = -0.5 * (before.tip.force_w_nn + s.tip.force_w_nn).dot(move);
    work += w;
    lap.turnover_aj += std::fabs(w);
    lost += s.dissipated_aj;
    iterations += s.iterations;
    before = s;
    torn += !s.held_by_tip || !s.on_surface;
  }
  const double after =
      before.tip.potential_aj + 0.5 * before.tip.force_w_nn.dot(kSprings * before.tip.force_w_nn);
  EXPECT_EQ(torn, 0);
  lap.left_over = std::fabs(work - (after - stored) - lost) / lap.turnover_aj;
  lap.lost = lost / lap.turnover_aj;
  lap.iterations = 1.0 * iterations / steps;
  return lap;
}

// Round a closed path with the ball between tip and ground, both contacts pulled, nothing is left
// over of the work and next to nothing lost: by an integral over the forces that the library tells, which
// knows nothing of its energies.
TEST(ParticleGround, AClosedPathOfThePairLeavesNothingOver) {
  double last = 1;
  for (const int steps : {50, 200, 800}) {
    const Lap lap = lap_of(steps, Vec3(0, 0, 0.12), Vec3(0.4, 0.2, 0), Vec3(0, 0.1, 0.1));
    std::printf("%4d steps: left over %.3g of the turnover (%.3g aJ), lost %.3g; %.2f iterations a step\n",
                steps, lap.left_over, lap.turnover_aj, lap.lost, lap.iterations);
    EXPECT_LT(lap.left_over, 0.5 * last) << steps;
    last = std::max(lap.left_over, 1e-11);  // the balance's own tolerance, 1e-9 of the forces a step
    EXPECT_LT(lap.lost, 1e-6) << steps;
    EXPECT_LT(lap.iterations, 5.0) << steps;
    if (steps == 800) {
      EXPECT_LT(lap.left_over, 1e-8);
    }
  }
}

TEST(ParticleGround, StepsTakeNothingFromTheHeap) {
  const ParticleEquilibrium scene = egg().scene();
  ParticleState state = scene.place(40, 40);
  scene.advance(Vec3(20, 40, 3), kSprings, 1e-3, state);
  const support::AllocGuard guard;
  for (int i = 0; i < 100; ++i) scene.advance(Vec3(20 + 0.2 * i, 40, 3), kSprings, 1e-3, state);
  EXPECT_EQ(guard.allocations(), 0u);
  if (!support::AllocGuard::active()) GTEST_SKIP() << "allocations are not counted in this build";
}

}  // namespace
}  // namespace telenano::physics
