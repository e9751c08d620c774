#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "tests/support/contact_paths.h"

// What must hold for every contact law, not only for the exact one (contact_property_test.cpp).

namespace telenano::physics {
namespace {

using telenano::testing::material_of;
using telenano::testing::stored_aj;
using telenano::testing::WorkIntegral;

constexpr double kRadius = 20;

double log_uniform(std::mt19937_64& random, double low, double high) {
  return low * std::exp(std::uniform_real_distribution<double>(0, std::log(high / low))(random));
}

class EveryLaw : public ::testing::TestWithParam<ContactLaw> {
 protected:
  bool has_van_der_waals() const { return GetParam() != ContactLaw::kHertz; }
  TipSampleLaw law_of(double lambda, bool van_der_waals) const {
    TipSampleParameters p = material_of(lambda, van_der_waals);
    p.model = GetParam();
    return TipSampleLaw(p);
  }
};

INSTANTIATE_TEST_SUITE_P(ContactLaws, EveryLaw, ::testing::ValuesIn(kContactLaws), [](const auto& law) {
  std::string name(contact_law_name(law.param));
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
});

// A closed loop never yields energy, whatever lambda and spring; the work of the force alone is the judge,
// not the law's own accounts, and these must agree with it.
TEST_P(EveryLaw, LoopNeverYieldsEnergy) {
  for (double lambda = 1e-3; lambda < 1.21e4; lambda *= 1.98) {  // 0.236 too: JKR meets van der Waals twice
    for (const bool vdw : {true, false}) {
      if (vdw && !has_van_der_waals()) continue;
      const TipSampleLaw law = law_of(lambda, vdw);
      const ContactScales s = law.scales(kRadius);
      for (const double soft : {0.0, 0.1, 1.0, 10.0}) {
        const double c = soft * s.overlap_nm / s.force_nn;
        const double far = -10 * 0.165 - (30 + 10 * soft) * s.overlap_nm;
        const double deep = 2 * s.overlap_nm;
        TipSampleState state;
        const double start = stored_aj(law.advance(far, c, kRadius, state), c);
        const WorkIntegral work(law, c, kRadius);
        const double scale = s.energy_aj * (1 + 2 / lambda + soft);
        const double tolerance = 1e-12 * scale;  // a panel; some hundred panels make 1e-10
        double loop = work.run(far, deep, state, tolerance);
        const Equilibrium in = law.advance(deep, c, kRadius, state);
        loop += work.run(deep, far, state, tolerance);
        const Equilibrium out = law.advance(far, c, kRadius, state);
        EXPECT_NE(state.branch, Branch::kContact);
        EXPECT_GE(loop, -1e-9 * scale) << lambda << ' ' << vdw << ' ' << soft;
        EXPECT_NEAR(loop, in.dissipated_aj + out.dissipated_aj, 1e-9 * scale)
            << lambda << ' ' << vdw << ' ' << soft;
        EXPECT_NEAR(stored_aj(out, c), start, 1e-12 * scale);
      }
    }
  }
}

// The whole range of materials and tips, any spring, steps up to 1 um; radius and spring also change.
TEST_P(EveryLaw, AnyMaterialAnySpringAnyStep) {
  std::mt19937_64 random(20240608);
  for (int material = 0; material < 300; ++material) {
    TipSampleParameters p;
    p.model = GetParam();
    p.contact_modulus_gpa = log_uniform(random, 1e-3, 1e3) * 4 / 3;
    p.work_of_adhesion_n_m = log_uniform(random, 1e-3, 1);
    p.van_der_waals = material % 2 == 0 && has_van_der_waals();
    const TipSampleLaw law(p);
    double radius = log_uniform(random, 1, 1e4);
    double c = material % 5 == 0 ? 0.0 : 1.0 / log_uniform(random, 0.01, 1e5);
    TipSampleState state;
    for (int step = 0; step < 100; ++step) {
      if (material % 3 == 0) {
        radius = log_uniform(random, 1, 1e4);
        c = step % 4 == 0 ? 0.0 : 1.0 / log_uniform(random, 0.01, 1e5);
      }
      const ContactScales s = law.scales(radius);
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
      // The spring balances the force: to rounding of the base and of the force behind the spring.
      ASSERT_NEAR(e.overlap_nm + c * e.force_nn, base,
                  1e-12 * (std::fabs(base) + s.overlap_nm * (1 + 1 / s.lambda) +
                           c * (s.force_nn + std::fabs(e.force_nn))))
          << s.lambda << ' ' << c;
      ASSERT_GE(1 + c * e.stiffness_n_m, -1e-6) << s.lambda << ' ' << c << ' ' << base;
      ASSERT_GE(e.force_nn, -2.0000001 * s.force_nn);
    }
  }
}

// One long step gives what many short ones give: jumps are found by crossings, not by where a step ends.
TEST_P(EveryLaw, StepSizeDoesNotMatter) {
  for (const double lambda : {1e-3, 0.02, 0.1, 0.22, 0.3, 0.38, 0.5, 0.74, 1.0, 4.0, 400.0, 1e4}) {
    for (const bool vdw : {true, false}) {
      if (vdw && !has_van_der_waals()) continue;
      const TipSampleLaw law = law_of(lambda, vdw);
      const ContactScales s = law.scales(kRadius);
      for (const double soft : {0.0, 1.0, 30.0}) {
        const double c = soft * s.overlap_nm / s.force_nn;
        const double far = -1.0 - (5 + 5 * soft) * s.overlap_nm;
        const double deep = (3 + soft) * s.overlap_nm;
        TipSampleState creep;
        law.advance(far, c, kRadius, creep);
        for (const bool inward : {true, false}) {
          TipSampleState before = creep;
          double lost = 0;
          for (int i = 1; i <= 500; ++i) {
            const double base = inward ? far + (deep - far) * i / 500 : deep + (far - deep) * i / 500;
            const Equilibrium e = law.advance(base, c, kRadius, creep);
            lost += e.dissipated_aj;
            TipSampleState leap = before;
            const Equilibrium once = law.advance(base, c, kRadius, leap);
            // Rounding, which the slope near a fold enlarges; a wrong branch is off by more than 0.01 u_F.
            ASSERT_EQ(once.branch, e.branch) << lambda << ' ' << vdw << ' ' << soft << ' ' << i;
            ASSERT_NEAR(once.force_nn, e.force_nn, 1e-6 * s.force_nn);
            ASSERT_NEAR(once.dissipated_aj, lost, 1e-9 * s.energy_aj * (1 + soft + 1 / lambda));
          }
        }
      }
    }
  }
}

// Stiffness is the derivative of the force and the force that of the potential, by differences of the law's
// own answers on both sides of a point, wherever the branch is the same.
TEST_P(EveryLaw, ForceAndStiffnessAreDerivatives) {
  std::mt19937_64 random(5);
  int compared = 0;
  for (double lambda = 1e-3; lambda < 1.21e4; lambda *= 3.1) {
    for (const bool vdw : {true, false}) {
      if (vdw && !has_van_der_waals()) continue;
      const TipSampleLaw law = law_of(lambda, vdw);
      const ContactScales s = law.scales(kRadius);
      for (int i = 0; i < 60; ++i) {
        const double at = std::uniform_real_distribution<double>(-1.5, 6)(random) * s.overlap_nm;
        TipSampleState state;
        law.advance(8 * s.overlap_nm, 0, kRadius, state);
        const Equilibrium mid = law.advance(at, 0, kRadius, state);
        const double h = 1e-5 * s.overlap_nm;
        TipSampleState left = state, right = state;
        const Equilibrium up = law.advance(at + h, 0, kRadius, right);
        const Equilibrium down = law.advance(at - h, 0, kRadius, left);
        if (up.branch != down.branch || up.branch == Branch::kFree || down.jumps > 0) continue;
        // Beside a fold, and on van der Waals at large lambda, differences say nothing.
        if (std::fabs(mid.stiffness_n_m) > 3 * s.force_nn / s.overlap_nm) continue;
        ++compared;
        // Differences: h^2 of the third derivative (1e-10 away from folds, which a random point is), and
        // rounding 1e-16/1e-5 of the energy's or force's own size.
        ASSERT_NEAR((up.potential_aj - down.potential_aj) / (2 * h), mid.force_nn,
                    1e-8 * (1 + 1 / lambda) * s.force_nn)
            << lambda << ' ' << at / s.overlap_nm;
        ASSERT_NEAR((up.force_nn - down.force_nn) / (2 * h), mid.stiffness_n_m,
                    1e-5 * (s.force_nn / s.overlap_nm + std::fabs(mid.stiffness_n_m)))
            << lambda << ' ' << at / s.overlap_nm;
      }
    }
  }
  EXPECT_GT(compared, 200);
}

}  // namespace
}  // namespace telenano::physics
