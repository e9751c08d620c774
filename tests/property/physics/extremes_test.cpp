// The whole range that a scene may ask for, and steps that no hand makes: the force is a number, the branch is
// the right one, the balance holds, energy is not made.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "common/base/random.h"
#include "nve_server/physics/tip_sample_law.h"
#include "nve_server/slave/nve_slave.h"
#include "tests/support/md_walk.h"

namespace telenano::physics {
namespace {

double log_uniform(Random& random, double low, double high) {
  return low * std::exp(random.uniform() * std::log(high / low));
}

/// A material and tip, and Maugis' scales of it by his own formulas.
struct Sample {
  TipSampleParameters parameters;
  double radius_nm = 0;
  double lambda = 0, overlap_nm = 0, force_nn = 0;

  Sample(double e_gpa, double w, double r, bool van_der_waals) : radius_nm(r) {
    parameters.contact_modulus_gpa = 4.0 / 3.0 * e_gpa;
    parameters.work_of_adhesion_n_m = w;
    parameters.van_der_waals = van_der_waals;
    const double k = parameters.contact_modulus_gpa;
    const double sigma0 = 16 / (9 * std::sqrt(3.0)) * w / parameters.equilibrium_distance_nm;
    overlap_nm = std::cbrt(M_PI * M_PI * w * w * r / (k * k));
    force_nn = M_PI * w * r;
    lambda = 2 * sigma0 * std::cbrt(r / (M_PI * w * k * k));
  }
};

Sample random_sample(Random& random, bool van_der_waals) {
  const double e = log_uniform(random, 1e-3, 1e3);
  const double w = log_uniform(random, 1e-3, 1);
  return Sample(e, w, log_uniform(random, 1, 1e4), van_der_waals);
}

/// What the next step's branch is, from where the last one left the tip and the ends of the two segments.
class Memory {
 public:
  explicit Memory(const oracle::MdWalk& walk) : walk_(walk) {}
  /// False if z lies so near to an end that rounding decides.
  bool move_to(long double z, long double rounding) {
    const long double end = inside_ ? walk_.leaves_inside() : walk_.leaves_outside();
    if (std::fabs(z - end) <= rounding) return false;
    inside_ = inside_ ? z > end : z > end;
    return true;
  }
  bool inside() const { return inside_; }
  void believe(bool inside) { inside_ = inside; }

 private:
  const oracle::MdWalk& walk_;
  bool inside_ = false;
};

bool is_inside(Branch branch) {
  return branch == Branch::kContact || branch == Branch::kNonContact;
}

struct Spread {
  int materials;
  int steps;
  int force_every;  ///< the oracle's bisection takes 30 us
};

void walk_at_random(std::uint64_t seed, const Spread& spread) {
  Random random(seed);
  long decided = 0, undecided = 0, jumps = 0;
  double lambda_least = 1e9, lambda_most = 0, deepest = 0;
  for (int material = 0; material < spread.materials; ++material) {
    const Sample sample = random_sample(random, material % 2 == 0);
    // Probe and coupling in series, from the softest pair to none at all.
    const double c = material % 7 == 0 ? 0.0
                                       : 1 / log_uniform(random, 0.01, 1000) + 1 / log_uniform(random, 1e-3, 1e6);
    const TipSampleLaw law(sample.parameters);
    const double unit = sample.force_nn / sample.overlap_nm;
    const oracle::MdWalk walk(sample.lambda, c * unit, sample.parameters.van_der_waals);
    lambda_least = std::min(lambda_least, sample.lambda);
    lambda_most = std::max(lambda_most, sample.lambda);
    Memory memory(walk);
    TipSampleState state;
    const double near = 0.165 + 3 * sample.overlap_nm + 3 * c * sample.force_nn;
    for (int i = 0; i < spread.steps; ++i) {
      // At the scale of the forces; anywhere within a micrometre; or to either side of the end of the segment.
      double base = random.uniform(-near, near);
      if (i % 4 == 1) base = random.uniform(-1000, 5);
      if (i % 4 == 3) {
        const auto end = memory.inside() ? walk.leaves_inside() : walk.leaves_outside();
        const double off = log_uniform(random, 1e-9, 1) * (random.chance(0.5) ? 1 : -1);
        base = (static_cast<double>(end) + off) * sample.overlap_nm;
      }
      const Equilibrium e = law.advance(base, c, sample.radius_nm, state);
      ASSERT_EQ(e.status, SolveStatus::kOk) << sample.lambda << ' ' << c << ' ' << base;
      ASSERT_TRUE(std::isfinite(e.force_nn) && std::isfinite(e.stiffness_n_m) && std::isfinite(e.potential_aj) &&
                  std::isfinite(e.overlap_nm) && std::isfinite(e.contact_radius_nm));
      ASSERT_GE(e.dissipated_aj, 0);
      jumps += e.jumps;
      const long double z = static_cast<long double>(base) / sample.overlap_nm;
      deepest = std::max(deepest, e.overlap_nm / sample.overlap_nm);
      // Rounding: a few ulp of what makes up Z. Ends are known to the root of the long double's precision in
      // their position, which is its square in Z.
      const long double size = std::fabs(z) + std::fabs(e.overlap_nm / sample.overlap_nm) +
                               c * unit * std::fabs(e.force_nn / sample.force_nn) + walk.range();
      if (!memory.move_to(z, 1e-13L * size)) {
        ++undecided;
        memory.believe(is_inside(e.branch));
        continue;
      }
      ++decided;
      ASSERT_EQ(is_inside(e.branch), memory.inside())
          << "material " << material << " step " << i << " lambda " << sample.lambda << " c " << c * unit << " Z "
          << static_cast<double>(z) << " ends " << static_cast<double>(walk.leaves_outside()) << ' '
          << static_cast<double>(walk.leaves_inside());
      if (i % spread.force_every != 0) continue;
      const oracle::MdWalk::State exact = memory.inside() ? walk.inside(z) : walk.outside(z);
      // 1e-10 is the law's claim near folds; the rest is what a few ulp of Z do to the force.
      const double tolerance = static_cast<double>(1e-10L * (std::fabs(exact.load) + 2) + 2e-15L * size * exact.gain);
      ASSERT_NEAR(e.force_nn / sample.force_nn, static_cast<double>(exact.load), tolerance)
          << "material " << material << " step " << i << " lambda " << sample.lambda << " c " << c * unit << " Z "
          << static_cast<double>(z) << " inside " << memory.inside();
    }
  }
  std::printf("lambda %.3g ... %.4g, overlap to %.3g u_delta, %ld steps decided, %ld on an end, %ld jumps\n",
              lambda_least, lambda_most, deepest, decided, undecided, jumps);
  EXPECT_LT(undecided, decided / 100);
  EXPECT_GT(jumps, decided / 100);
}

// A million steps over five thousand pairs of tip and sample.
TEST(Extremes, RightBranchAndForceAnywhere) {
  walk_at_random(20260214, {5000, 200, 16});
}

}  // namespace
}  // namespace telenano::physics
