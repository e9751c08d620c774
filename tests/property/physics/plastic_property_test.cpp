#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/error.h"
#include "telenano/common/base/random.h"
#include "telenano/nve_server/physics/equilibrium/marked_sample.h"
#include "telenano/nve_server/physics/surface/sampled_shapes.h"
#include "tests/support/alloc_guard.h"

namespace telenano::physics {
namespace {

constexpr double kRadius = 20.0;
constexpr double kModulus = 60.0;

TipSampleLaw law_of(double modulus, double adhesion) {
  TipSampleParameters p;
  p.contact_modulus_gpa = modulus;
  p.work_of_adhesion_n_m = adhesion;
  return TipSampleLaw(p);
}

double log_uniform(Random& random, double low, double high) {
  return low * std::pow(high / low, random.uniform());
}

SplineSurface level(double half_nm, double spacing_nm) {
  return SplineSurface(sample_level({-half_nm, -half_nm, 2 * half_nm, 2 * half_nm, spacing_nm}, 0.0),
                       kRadius);
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

struct Groove {
  double depth = 0, ripple = 0, side_force = 0, force = 0;
  double work = 0, booked = 0;
  int failures = 0;
  double static_depth = 0;
};

// Pressed in, drawn along x by `step`, lifted.
Groove plough(double press_nm, double step_nm, const Vec3& along, double spacing_nm) {
  const SplineSurface flat = level(50, spacing_nm);
  EquilibriumOptions options;
  options.hardness_gpa = 2.0;
  MarkedSample sample(flat, law_of(kModulus, 0.05), kRadius, options);
  Compliance c = Mat3::Identity() / 20.0;
  c(2, 2) += 1 / 40.0;
  TipState state;
  Groove groove;
  Vec3 last_end(0, 0, 5), last_force = Vec3::Zero();
  double stored = 0;
  const auto go = [&](const Vec3& end) {
    const TipSolution tip = sample.equilibrium().advance(end, c, state);
    if (tip.status != SolveStatus::kOk) {
      ++groove.failures;
      return tip;
    }
    sample.press(tip.yielded);
    groove.work -= 0.5 * (tip.force_w_nn + last_force).dot(end - last_end);
    groove.booked += tip.dissipated_aj;
    stored = tip.potential_aj + 0.5 * tip.force_w_nn.dot(c * tip.force_w_nn);
    last_end = end;
    last_force = tip.force_w_nn;
    return tip;
  };
  const Vec3 start = -15.0 * along;
  for (double z = 5; z > -press_nm; z -= 0.1) go(start + Vec3(0, 0, z));
  go(start + Vec3(0, 0, -press_nm));
  groove.static_depth = -sample.surface().height_nm(start.x(), start.y());
  int middle = 0;
  for (double s = step_nm; s <= 30.0 + 1e-9; s += step_nm) {
    const TipSolution tip = go(start + along * s + Vec3(0, 0, -press_nm));
    if (s < 12 || s > 24) continue;
    groove.side_force -= tip.force_w_nn.dot(along);
    groove.force += tip.force_w_nn.z();
    ++middle;
  }
  groove.side_force /= middle;
  groove.force /= middle;
  for (double z = -press_nm; z < 8; z += 0.1) go(last_end + Vec3(0, 0, 0.1));
  groove.booked += stored;
  double low = 1e9, high = -1e9, sum = 0;
  int count = 0;
  for (double s = -3; s <= 6; s += 0.25, ++count) {
    const double depth = -sample.surface().height_nm(s * along.x(), s * along.y());
    low = std::min(low, depth);
    high = std::max(high, depth);
    sum += depth;
  }
  groove.depth = sum / count;
  groove.ripple = high - low;
  return groove;
}

TEST(PlasticProperty, AGrooveIsSmoothAndDeeperThanADent) {
  const Groove fine = plough(20, 0.1, Vec3(1, 0, 0), 1.0);
  const Groove coarse = plough(20, 0.3, Vec3(1, 0, 0), 1.0);
  const Groove slanted = plough(20, 0.1, Vec3(0.6, 0.8, 0), 1.0);
  for (const Groove& g : {fine, coarse, slanted}) EXPECT_EQ(g.failures, 0);
  // Only the front half of the contact bears a tip that ploughs: πa²H/2 = F, a² = Rδ: twice as deep as the
  // dent, less the elastic part.
  EXPECT_GT(fine.depth, 1.6 * fine.static_depth);
  EXPECT_LT(fine.depth, 2.4 * fine.static_depth);
  // Over the first lengths the depth swings about its mean by 3.5 % (7 % from top to bottom), a wave of two
  // contact radii that neither step nor grid changes.
  EXPECT_LT(fine.ripple, 0.08 * fine.depth);
  // First order in the step: 0.06 of the contact radius (5 nm) is within a few per cent.
  EXPECT_NEAR(coarse.depth, fine.depth, 0.03 * fine.depth);
  // Nor does the direction over the grid matter.
  EXPECT_NEAR(slanted.depth, fine.depth, 0.05 * fine.depth);
  EXPECT_GT(fine.side_force, 0.05 * fine.force);  // ploughing needs work
  EXPECT_GT(fine.work, 0.0);
  // What the books miss: the lateral part of the radius' change, which is not in the force.
  EXPECT_NEAR(fine.booked, fine.work, 0.06 * fine.work);
}

TEST(PlasticProperty, AMarkBesideAnotherHasItsConformityExactly) {
  SplineSurface surface = level(30, 0.5);
  surface.press({0.0, 0.0, 1.0, 8.0, 0.3, 0.1});
  const double before = surface.height_nm(4.1, 1.3);
  surface.press({4.1, 1.3, 0.2, 6.0, 0.25, 0.1});
  EXPECT_NEAR(surface.relative_curvature(4.1, 1.3).value, 0.25, 1e-12);  // rounding of 16 weights
  EXPECT_NEAR(before - surface.height_nm(4.1, 1.3), 0.2, 1e-9);
}

TEST(PlasticProperty, NeedsAHardnessAndNoRadiusForce) {
  const SplineSurface flat = level(10, 1.0);
  EquilibriumOptions options;
  EXPECT_THROW(MarkedSample(flat, law_of(kModulus, 0.05), kRadius, options), UserError);
  options.hardness_gpa = 2.0;
  EXPECT_NO_THROW(MarkedSample(flat, law_of(kModulus, 0.05), kRadius, options));
  options.radius_force = true;
  EXPECT_THROW(MarkedSample(flat, law_of(kModulus, 0.05), kRadius, options), UserError);
}

TEST(PlasticProperty, PressedAsOneContactAloneWouldBe) {
  const SplineSurface flat = level(40, 0.5);
  const TipSampleLaw law = law_of(kModulus, 0.05);
  EquilibriumOptions options;
  options.hardness_gpa = 2.0;
  MarkedSample sample(flat, law, kRadius, options);
  const PlasticContact alone(law, 2.0);
  TipState state;
  TipSampleState law_state;
  const Compliance c = Mat3::Identity() * 0.08;
  for (double z = 5; z > -12; z -= 0.25) {
    const TipSolution tip = sample.equilibrium().advance(Vec3(0.3, -0.2, z), c, state);
    ASSERT_EQ(tip.status, SolveStatus::kOk);
    const support::AllocGuard guard;
    sample.press(tip.yielded);
    EXPECT_EQ(guard.allocations(), 0u);
  }
  const PlasticStep one = alone.advance(11.75, 0.08, kRadius, kRadius, law_state);
  // Grid: the foot's height is exact, so this is the yield slack and the foot's wander.
  EXPECT_NEAR(-sample.surface().height_nm(0.3, -0.2), one.flow.depth_nm, 2e-3 * one.flow.depth_nm);
  EXPECT_NEAR(state.force_nn, one.equilibrium.force_nn, 1e-3 * one.equilibrium.force_nn);
  EXPECT_GT(sample.marks(), 10u);
  EXPECT_EQ(flat.height_nm(0.3, -0.2), 0.0);  // the scene's own surface is as it was
}

}  // namespace
}  // namespace telenano::physics
