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
using telenano::testing::WorkIntegral;

constexpr double kRadius = 20;

double log_uniform(std::mt19937_64& random, double low, double high) {
  return low * std::exp(std::uniform_real_distribution<double>(0, std::log(high / low))(random));
}

double uniform(std::mt19937_64& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

/// Any material, any of the terms, any spring.
struct Case {
  TipSampleParameters parameters;
  double compliance = 0;
  double far_nm = 0;
  double deep_nm = 0;
  double energy_aj = 0;  // scale of all that is stored
};

Case draw(std::mt19937_64& random, int i) {
  Case c;
  TipSampleParameters& p = c.parameters;
  p = material_of(log_uniform(random, 1e-3, 1.2e4), i % 3 != 0);
  LongRangeParameters& l = p.long_range;
  l.tip_bias_v = i % 4 == 0 ? 0 : uniform(random, 0, 10);
  if (i % 5 != 0) l.capillary.humidity_percent = uniform(random, 5, 95);
  if (i % 2 == 0) l.capillary.model = CapillaryModel::kConstantVolume;
  if (i % 7 < 4) l.capillary.film_nm = uniform(random, 0, 1.5);
  l.capillary.contact_angle_tip_deg = uniform(random, 0, 70);
  // Of w = 0.1 N/m the liquid takes up to nine tenths; of every eighth all, which contradicts itself.
  if (i % 8 != 0) l.capillary.surface_tension_n_m = uniform(random, 0.003, 0.045);
  if (p.van_der_waals && i % 2 == 1) l.retardation_nm = 100;
  if (i % 4 == 1) {
    l.cone_half_angle_deg = uniform(random, 5, 40);
    l.cone_height_nm = log_uniform(random, 10, 2e4);
  }
  c.compliance = i % 6 == 0 ? 0 : 1 / log_uniform(random, 0.01, 1000);
  const TipSampleLaw law(p);
  const ContactScales s = law.scales(kRadius);
  const BridgeState bridge = law.long_range().capillary().formed(kRadius);
  const double at_touch = 2 * s.force_nn + std::fabs(law.long_range().evaluate(0, kRadius, bridge).force_nn);
  // Beyond formation, rupture, snap-in and the fold against the spring.
  c.far_nm = -(3 * bridge.rupture_gap_nm + 3 + 40 * s.overlap_nm + 3 * c.compliance * at_touch);
  c.deep_nm = 2 * s.overlap_nm + 1 + c.compliance * at_touch;
  c.energy_aj = s.energy_aj * (1 + 1 / s.lambda) + at_touch * (bridge.rupture_gap_nm + 1) +
                c.compliance * at_touch * at_touch;
  return c;
}

// Work of the force alone, through all jumps, against what is stored and dissipated; each leg, and the loop.
TEST(LongRangeProperty, WorkIsStoredOrDissipatedAndNeverCreated) {
  std::mt19937_64 random(31);
  for (int i = 0; i < 60; ++i) {
    const Case c = draw(random, i);
    const TipSampleLaw law(c.parameters);
    if (!law.long_range().active()) continue;
    TipSampleState state;
    const WorkIntegral work(law, c.compliance, kRadius);
    const double start = stored_aj(law.advance(c.far_nm, c.compliance, kRadius, state), c.compliance);
    double stored = start, position = c.far_nm, loop = 0, dissipated = 0;
    for (const double target : {0.3 * c.far_nm, 0.0, c.deep_nm, 0.1 * c.far_nm, c.far_nm}) {
      const double w = work.run(position, target, state, 1e-11 * c.energy_aj);
      const Equilibrium e = law.advance(target, c.compliance, kRadius, state);
      ASSERT_EQ(e.status, SolveStatus::kOk) << i;
      const double now = stored_aj(e, c.compliance);
      // The quadrature's limit: 1e-11 an interval, of a few hundred.
      EXPECT_NEAR(w, now - stored + e.dissipated_aj, 3e-9 * c.energy_aj) << i << ' ' << target;
      EXPECT_GE(e.dissipated_aj, 0);
      loop += w;
      dissipated += e.dissipated_aj;
      stored = now;
      position = target;
    }
    EXPECT_FALSE(state.bridge.present) << i;
    EXPECT_NEAR(stored, start, 1e-10 * c.energy_aj) << i;
    EXPECT_GE(loop, -1e-8 * c.energy_aj) << i;
    EXPECT_NEAR(loop, dissipated, 1e-8 * c.energy_aj) << i;
  }
}

TEST(LongRangeProperty, OneLongStepEqualsManyShortOnes) {
  std::mt19937_64 random(32);
  for (int i = 0; i < 400; ++i) {
    const Case c = draw(random, i);
    const TipSampleLaw law(c.parameters);
    const ContactScales s = law.scales(kRadius);
    TipSampleState one, many;
    double position = c.far_nm;
    law.advance(position, c.compliance, kRadius, one);
    law.advance(position, c.compliance, kRadius, many);
    for (int leg = 0; leg < 12; ++leg) {
      const double target = leg % 3 == 0   ? c.deep_nm
                            : leg % 3 == 1 ? uniform(random, 0.2 * c.far_nm, c.deep_nm)
                                           : uniform(random, c.far_nm, 0);
      const Equilibrium a = law.advance(target, c.compliance, kRadius, one);
      ASSERT_EQ(a.status, SolveStatus::kOk);
      double dissipated = 0;
      int jumps = 0;
      Equilibrium b;
      for (int k = 1; k <= 41; ++k) {
        b = law.advance(k == 41 ? target : position + (target - position) * k / 41, c.compliance, kRadius,
                        many);
        ASSERT_EQ(b.status, SolveStatus::kOk);
        dissipated += b.dissipated_aj;
        jumps += b.jumps;
      }
      position = target;
      ASSERT_EQ(a.branch, b.branch) << i << ' ' << leg;
      ASSERT_EQ(a.bridge, b.bridge) << i << ' ' << leg;
      ASSERT_EQ(a.jumps, jumps) << i << ' ' << leg;
      const double force = s.force_nn + std::fabs(a.force_nn) + c.energy_aj / kRadius;
      // Twice the law's own error near a fold, 1e-10.
      ASSERT_NEAR(a.force_nn, b.force_nn, 1e-9 * force) << i << ' ' << leg;
      ASSERT_NEAR(a.dissipated_aj, dissipated, 1e-9 * c.energy_aj) << i << ' ' << leg;
      ASSERT_NEAR(a.potential_aj, b.potential_aj, 1e-9 * (c.energy_aj + std::fabs(a.potential_aj)));
    }
  }
}

// The spring balances the force and holds the tip, wherever it is put; radius and spring may change.
TEST(LongRangeProperty, BalancedStableAndSoundAnywhere) {
  std::mt19937_64 random(33);
  for (int i = 0; i < 300; ++i) {
    const Case c = draw(random, i);
    const TipSampleLaw law(c.parameters);
    TipSampleState state;
    for (int step = 0; step < 200; ++step) {
      const double radius = i % 2 == 0 ? kRadius : log_uniform(random, 2, 500);
      const double compliance = i % 4 < 2 ? c.compliance : 1 / log_uniform(random, 0.01, 1000);
      const double base =
          step % 3 == 0 ? uniform(random, -1000, c.deep_nm) : uniform(random, 0.1 * c.far_nm, c.deep_nm);
      const TipSampleState before = state;
      const Equilibrium e = law.advance(base, compliance, radius, state);
      ASSERT_EQ(e.status, SolveStatus::kOk)
          << i << ' ' << step << " base " << base << " from " << before.overlap_nm;
      ASSERT_TRUE(std::isfinite(e.force_nn) && std::isfinite(e.stiffness_n_m) &&
                  std::isfinite(e.potential_aj));
      ASSERT_GE(e.dissipated_aj, 0);
      // Rounding of the base, and what an ulp of the overlap (or of its scale) does to the force.
      const double unit = law.scales(radius).overlap_nm;
      const double ulp =
          1e-15 * (std::fabs(e.overlap_nm) + unit) * (1 + compliance * std::fabs(e.stiffness_n_m));
      ASSERT_NEAR(e.overlap_nm + compliance * e.force_nn, base,
                  ulp + 1e-11 * (std::fabs(base) + unit + 1 + compliance * std::fabs(e.force_nn)))
          << i << ' ' << step;
      ASSERT_GE(1 + compliance * e.stiffness_n_m, -1e-4) << i << ' ' << step;
      // A bridge lives between touch and rupture.
      if (e.bridge) {
        ASSERT_GE(e.overlap_nm, -state.bridge.rupture_gap_nm * (1 + 1e-12));
      }
    }
  }
}

}  // namespace
}  // namespace telenano::physics
