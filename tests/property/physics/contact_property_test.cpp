#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "tests/support/contact_paths.h"

namespace telenano::physics {
namespace {

using telenano::testing::material_of;
using telenano::testing::stored_aj;

double log_uniform(std::mt19937_64& random, double low, double high) {
  return low * std::exp(std::uniform_real_distribution<double>(0, std::log(high / low))(random));
}

// The whole range of materials and tips, any spring, steps up to 1 um in one sample.
TEST(ContactProperty, AnyMaterialAnySpringAnyStep) {
  std::mt19937_64 random(20240607);
  for (int material = 0; material < 400; ++material) {
    TipSampleParameters p;
    p.contact_modulus_gpa = log_uniform(random, 1e-3, 1e3) * 4 / 3;
    p.work_of_adhesion_n_m = log_uniform(random, 1e-3, 1);
    p.van_der_waals = material % 2 == 0;
    const TipSampleLaw law(p);
    const double radius = log_uniform(random, 1, 1e4);
    const ContactScales s = law.scales(radius);
    const double c = material % 5 == 0 ? 0.0 : 1.0 / log_uniform(random, 0.01, 1e5);
    TipSampleState state;
    const double far = -1000 - 60 * s.overlap_nm - 30 * c * s.force_nn;
    const double start = stored_aj(law.advance(far, c, radius, state), c);
    double reach = s.energy_aj * (1 + 1 / s.lambda);
    for (int step = 0; step < 100; ++step) {
      // Half of the steps near the surface at the scale of the forces, half anywhere within a micrometre.
      const double near = 0.165 + 3 * s.overlap_nm + 3 * c * s.force_nn;
      const double base = step % 2 == 0 ? std::uniform_real_distribution<double>(-1000, 5)(random)
                                        : std::uniform_real_distribution<double>(-near, near)(random);
      const Equilibrium e = law.advance(base, c, radius, state);
      ASSERT_EQ(e.status, SolveStatus::kOk) << s.lambda << ' ' << c << ' ' << base;
      ASSERT_TRUE(std::isfinite(e.force_nn) && std::isfinite(e.stiffness_n_m) &&
                  std::isfinite(e.potential_aj) && std::isfinite(e.overlap_nm) &&
                  std::isfinite(e.contact_radius_nm));
      ASSERT_GE(e.dissipated_aj, 0);
      ASSERT_LE(e.jumps, 1);
      // The spring balances the force: to rounding of the base and of what one ulp of the overlap does to the
      // force.
      ASSERT_NEAR(e.overlap_nm + c * e.force_nn, base,
                  1e-12 * (std::fabs(base) + s.overlap_nm * (1 + 1 / s.lambda) + c * std::fabs(e.force_nn)))
          << s.lambda << ' ' << c;
      // Stable: the spring is stiffer than the attraction's slope.
      ASSERT_GE(1 + c * e.stiffness_n_m, -1e-6) << s.lambda << ' ' << c << ' ' << base;
      // An adhesive force cannot exceed the pull-off under load control, nor van der Waals at its cut-off.
      ASSERT_GE(e.force_nn, -2.0000001 * s.force_nn);
      reach = std::max(reach, std::fabs(stored_aj(e, c)));
    }
    // Back where it started: what was stored is stored again, however many jumps there were.
    const double end = stored_aj(law.advance(far, c, radius, state), c);
    EXPECT_NEAR(end, start, 1e-12 * reach);
    EXPECT_NE(state.branch, Branch::kContact);
  }
}

// A sphere over uneven ground: radius, spring and base change at every step, to 1 um in a step.
TEST(ContactProperty, ChangingRadiusAndSpringStaySound) {
  std::mt19937_64 random(99);
  for (const double lambda : {1e-3, 0.1, 0.5, 0.7, 0.73, 0.9, 1.0, 4.0, 400.0, 1e4}) {
    const TipSampleLaw law(material_of(lambda, true));
    const ContactScales s = law.scales(20);
    TipSampleState state;
    for (int i = 0; i < 20000; ++i) {
      const double radius = log_uniform(random, 2, 500);
      const double c = i % 3 == 0 ? 0.0 : log_uniform(random, 1e-4, 100) * s.overlap_nm / s.force_nn;
      const double base = std::uniform_real_distribution<double>(i % 7 == 0 ? -1000 : -3 * s.overlap_nm - 0.5,
                                                                 5 * s.overlap_nm)(random);
      const Equilibrium e = law.advance(base, c, radius, state);
      ASSERT_EQ(e.status, SolveStatus::kOk) << lambda << ' ' << i;
      ASSERT_TRUE(std::isfinite(e.force_nn) && std::isfinite(e.potential_aj));
      ASSERT_GE(e.dissipated_aj, 0);
      ASSERT_EQ(e.branch, state.branch);
    }
  }
}

}  // namespace
}  // namespace telenano::physics
