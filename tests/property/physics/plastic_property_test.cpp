#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/random.h"
#include "telenano/nve_server/physics/law/plastic_contact.h"

namespace telenano::physics {
namespace {

TipSampleLaw law_of(double modulus, double adhesion) {
  TipSampleParameters p;
  p.contact_modulus_gpa = modulus;
  p.work_of_adhesion_n_m = adhesion;
  return TipSampleLaw(p);
}

double log_uniform(Random& random, double low, double high) {
  return low * std::pow(high / low, random.uniform());
}

// E from 1 MPa to 1 TPa, H from 0.01 to 100 GPa, any radius, steps of up to 1 µm.
TEST(PlasticProperty, NoStepCreatesEnergyFromFlowOrLeavesAnOverload) {
  Random random(11);
  int flowed = 0, failed = 0, steps = 0;
  for (int trial = 0; trial < 800; ++trial) {
    const double modulus = log_uniform(random, 1e-3, 1e3);
    const double adhesion = log_uniform(random, 1e-3, 1.0);
    const double hardness = log_uniform(random, 0.01, 100.0);
    const double origin = log_uniform(random, 1.0, 1e4);
    const double compliance = random.chance(0.3) ? 0.0 : log_uniform(random, 1e-3, 100.0);
    const PlasticContact contact(law_of(modulus, adhesion), hardness);
    TipSampleState state;
    double radius = origin, depth = 0, z = -10;
    for (int i = 0; i < 20; ++i) {
      z = std::clamp(z + random.uniform(-1, 1) * log_uniform(random, 1e-3, 1e3), -20.0, 1000.0);
      const PlasticStep step = contact.advance(z - depth, compliance, radius, origin, state);
      ++steps;
      const Equilibrium& eq = step.equilibrium;
      ASSERT_TRUE(std::isfinite(eq.force_nn) && std::isfinite(eq.potential_aj));
      if (eq.status != SolveStatus::kOk) {
        EXPECT_EQ(eq.force_nn, 0.0);
        ++failed;
        continue;
      }
      ASSERT_GE(step.flow.depth_nm, 0.0);
      ASSERT_GE(step.flow.dissipated_aj, 0.0);
      if (step.flow.depth_nm > 0) {
        ++flowed;
        EXPECT_GE(step.flow.radius_nm, radius);
        depth += step.flow.depth_nm;
        radius = step.flow.radius_nm;
        EXPECT_LE(depth, std::max(0.0, z) + 50.0);  // never below where it was commanded, but for adhesion
      }
      // F <= max(0, πHa*² − 2πwR); 2e-9 is the yield rule's slack.
      const double hard_force = kPi * hardness * std::pow(contact.yield_radius_nm(radius), 2);
      const double yield = std::max(0.0, hard_force - 2 * kPi * adhesion * origin);
      EXPECT_LE(eq.force_nn, yield + 2e-9 * hard_force) << trial << ' ' << i;
    }
  }
  EXPECT_GT(flowed, 500);
  EXPECT_LE(failed, steps / 1000) << steps;
}

}  // namespace
}  // namespace telenano::physics
