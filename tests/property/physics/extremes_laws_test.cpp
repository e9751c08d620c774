// As extremes_test.cpp, for the other laws, the table, long-range forces, friction, and probes that bend in
// all directions or move by themselves.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/property/physics/extreme_samples.h"
#include "tests/source_dir.h"

namespace telenano::physics {
namespace {

using testing::log_uniform;
using testing::random_sample;
using testing::Sample;

constexpr ContactLaw kModels[] = {ContactLaw::kHertz,
                                  ContactLaw::kDmt,
                                  ContactLaw::kJkr,
                                  ContactLaw::kCarpickOgletreeSalmeron,
                                  ContactLaw::kPietrementTroyon,
                                  ContactLaw::kSchwarz};

/// Any law of those that extremes_test.cpp does not walk. `kind` 0 ... 5: kModels; 6: the table; 7 and above:
/// long-range forces.
Sample random_law(Random& random, int kind) {
  const bool van_der_waals = kind != 0 && random.chance(0.6);
  Sample sample = random_sample(random, van_der_waals);
  TipSampleParameters& p = sample.parameters;
  if (kind < 6) p.model = kModels[kind];
  if (kind == 6) p.method = MaugisMethod::kTable;
  if (kind < 7) return sample;
  LongRangeParameters& far = p.long_range;
  if (van_der_waals && random.chance(0.5)) far.retardation_nm = log_uniform(random, 10, 1000);
  if (random.chance(0.5)) {
    far.cone_half_angle_deg = random.uniform(1, 60);
    far.cone_height_nm = sample.radius_nm * log_uniform(random, 2, 100);
  }
  if (random.chance(0.5)) far.tip_bias_v = log_uniform(random, 0.01, 10) * (random.chance(0.5) ? 1 : -1);
  if (random.chance(0.5)) {
    far.capillary.humidity_percent = random.uniform(1, 95);
    far.capillary.contact_angle_tip_deg = random.uniform(0, 80);
    far.capillary.contact_angle_sample_deg = random.uniform(0, 80);
    far.capillary.model =
        random.chance(0.5) ? CapillaryModel::kConstantVolume : CapillaryModel::kConstantCurvature;
    if (random.chance(0.5)) far.capillary.film_nm = random.uniform(0, 1);
  }
  return sample;
}

double random_compliance(Random& random) {
  return random.chance(0.15) ? 0.0 : 1 / log_uniform(random, 0.01, 1000) + 1 / log_uniform(random, 1e-3, 1e6);
}

double stored_aj(const Equilibrium& e, double compliance) {
  return e.potential_aj + 0.5 * compliance * e.force_nn * e.force_nn;
}

// Leaps anywhere within a micrometre: numbers, and losses that are losses. And history is in the branch and
// the bridge alone: from far away and from deep inside the states are what a fresh tip finds there.
TEST(ExtremeLaws, LeapsStaySound) {
  Random random(818);
  int jumps = 0, bridges = 0, differ = 0;
  for (int material = 0; material < 4000; ++material) {
    const Sample sample = random_law(random, material % 12);
    const double c = random_compliance(random);
    const TipSampleLaw law(sample.parameters, sample.radius_nm);
    const double near = 0.165 + 3 * sample.overlap_nm + 3 * c * sample.force_nn;
    TipSampleState state;
    for (int i = 0; i < 60; ++i) {
      double base = random.uniform(-near, near);
      if (i % 4 == 1) base = random.uniform(-1000, 5);
      if (i % 16 == 7) base = random.uniform(0, 1e3) * (sample.overlap_nm + c * sample.force_nn);
      const Equilibrium e = law.advance(base, c, sample.radius_nm, state);
      ASSERT_EQ(e.status, SolveStatus::kOk) << material << ' ' << i << ' ' << sample.lambda << ' ' << base;
      ASSERT_TRUE(std::isfinite(e.force_nn) && std::isfinite(e.stiffness_n_m) &&
                  std::isfinite(e.potential_aj) && std::isfinite(e.overlap_nm) &&
                  std::isfinite(e.contact_radius_nm) && std::isfinite(e.dissipated_aj))
          << material << ' ' << i;
      ASSERT_GE(e.dissipated_aj, 0);
      // The balance itself: base = overlap + c F, to the 1e-10 that the laws claim near folds.
      ASSERT_NEAR(e.overlap_nm + c * e.force_nn, base,
                  1e-10 * (std::fabs(base) + std::fabs(e.overlap_nm) + c * std::fabs(e.force_nn) +
                           sample.overlap_nm + 0.165))
          << material << ' ' << i << ' ' << sample.lambda << " c " << c;
      jumps += e.jumps;
      bridges += e.bridge;
    }
    const double deep = 1e3 * (sample.overlap_nm + c * sample.force_nn) + 10;
    TipSampleState fresh;
    const Equilibrium a = law.advance(deep, c, sample.radius_nm, state);
    const Equilibrium b = law.advance(deep, c, sample.radius_nm, fresh);
    // A soft contact that lost its bridge on the neck stays dry (it would take energy to wet it), where a
    // fresh tip brings one along from where the films met.
    differ += a.bridge != b.bridge;
    if (a.bridge != b.bridge) continue;
    // A bridge of fixed volume remembers the radius at which it formed, which is the same: all agree.
    ASSERT_NEAR(a.force_nn, b.force_nn, 1e-11 * std::fabs(b.force_nn)) << material << ' ' << sample.lambda;
  }
  EXPECT_GT(jumps, 10000);
  EXPECT_GT(bridges, 1000);
  EXPECT_LT(differ, 100);
}

// Along a path without jumps, the work of the spring's base is what is stored: Gauss–Legendre quadrature of
// the force, which knows nothing of the potential.
TEST(ExtremeLaws, WorkIsStoredWhereNothingJumps) {
  constexpr double kNode[3] = {0.23861918608319690863, 0.66120938646626451366, 0.93246951420315202781};
  constexpr double kWeight[3] = {0.46791393457269104739, 0.36076157304813860757, 0.17132449237917034504};
  Random random(919);
  int compared = 0;
  for (int material = 0; material < 6000; ++material) {
    const int kind = material % 12;
    const Sample sample = random_law(random, kind);
    const double c = random_compliance(random);
    const TipSampleLaw law(sample.parameters, sample.radius_nm);
    const double reach = sample.overlap_nm + c * sample.force_nn;
    TipSampleState state;
    const bool inside = random.chance(0.5);
    const double from = inside ? random.uniform(0.0, 20) * reach : -0.165 - random.uniform(3, 20) * reach;
    if (inside) law.advance(30 * reach, c, sample.radius_nm, state);
    const double to = from + 0.01 * random.uniform(-1, 1) * reach;
    const Equilibrium first = law.advance(from, c, sample.radius_nm, state);
    TipSampleState at_end = state;
    const Equilibrium last = law.advance(to, c, sample.radius_nm, at_end);
    // The terms have a kink at touch, where the bridge begins and at a jump.
    if (last.jumps > 0 || last.branch != first.branch || last.bridge != first.bridge ||
        (last.overlap_nm > 0) != (first.overlap_nm > 0))
      continue;
    double work = 0, greatest = 0;
    for (int i = 0; i < 6; ++i) {
      const double node = i < 3 ? kNode[i] : -kNode[i - 3];
      TipSampleState copy = state;
      const double f =
          law.advance(0.5 * (from + to) + 0.5 * (to - from) * node, c, sample.radius_nm, copy).force_nn;
      work += kWeight[i % 3] * f * 0.5 * (to - from);
      greatest = std::max(greatest, std::fabs(f));
    }
    // As in extremes_test.cpp; the table's cubics join at cells with a step in the third derivative only.
    const double accounts =
        std::fabs(stored_aj(first, c)) + std::fabs(stored_aj(last, c)) + sample.force_nn * reach;
    ASSERT_NEAR(stored_aj(last, c) - stored_aj(first, c), work,
                1e-8 * greatest * std::fabs(to - from) + 3e-13 * accounts)
        << "material " << material << " kind " << kind << " lambda " << sample.lambda << " inside " << inside;
    ++compared;
  }
  EXPECT_GT(compared, 4000);
}

// The whole slave with friction, with a tilted beam that couples the directions, and with a mode of its own:
// any of them together on any material, leaps up to a micrometre. Where there is no balance the tip holds
// still; what is published is a number within the limit, and the account is stored energy plus losses.
TEST(ExtremeLaws, SlaveWithFrictionBeamAndModeStaysSound) {
  Random random(1020);
  const auto deployed =
      scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/flat_silicon_oxide.toml");
  int steps = 0, unbalanced = 0;
  for (int trial = 0; trial < 800; ++trial) {
    auto scene = std::make_shared<scene::Scene>(*deployed);
    const Sample sample = random_sample(random, trial % 2 == 0);
    scene->law_parameters = sample.parameters;
    scene->probe.tip_radius_nm = sample.radius_nm;
    ProbeParameters probe;
    if (trial % 4 < 2) {
      probe.beam = BeamParameters{169,
                                  0.22,
                                  3e4,
                                  log_uniform(random, 300, 5000),
                                  log_uniform(random, 1e5, 4e5),
                                  log_uniform(random, 1e3, 2e4)};
    } else {
      probe.stiffness_n_m = log_uniform(random, 0.01, 1000);
    }
    probe.tilt_deg = random.uniform(0, 20);
    if (trial % 3 == 0) {
      probe.mode = ModeParameters{log_uniform(random, 1e3, 2e6), log_uniform(random, 1, 500)};
    }
    scene->cantilever = Probe(probe);
    scene->coupling.stiffness_n_m = log_uniform(random, 0.1, 1e4);
    scene->coupling.damping_n_s_m =
        trial % 5 == 0 ? 0.0 : scene->coupling.stiffness_n_m * log_uniform(random, 1e-5, 0.1);
    const Mat3 c = scene->port_compliance_nm_nn();
    const double top = 100 + 4 * c(2, 2) * sample.force_nn + 10 * sample.overlap_nm;
    scene->limits.workspace_max_w_nm.z() = top;
    scene->limits.speed_max_nm_s = std::max(1e5, top);
    scene->limits.force_max_nn = 2.5 * sample.force_nn * log_uniform(random, 1, 1e4);
    scene->friction.reset();
    if (trial % 2 == 1) {
      scene->friction =
          FrictionParameters{log_uniform(random, 1e-3, 1),
                             3.0 / 16 * sample.parameters.contact_modulus_gpa * random.uniform(0.5, 1.5),
                             random.chance(0.3) ? random.uniform(0, 1) : 0.0, random.uniform(0.3, 1)};
    }
    scene->level = std::make_shared<LevelEquilibrium>(std::make_shared<TipSampleLaw>(sample.parameters),
                                                      sample.radius_nm, scene->friction);
    slave::NveSlave slave(scene);
    const double dt = log_uniform(random, 1e-4, 1e-2);
    const double start_aj = slave.trace().stored_aj;
    slave::SlaveInput input;
    slave::SlaveOutput last;
    double dissipated = 0, most = std::fabs(start_aj);
    for (int i = 0; i < 60; ++i) {
      input.tip_target_pos_w_nm = Vec3(random.uniform(-500, 500), random.uniform(-500, 500),
                                       i % 2 == 0 ? random.uniform(-60, 100) : random.uniform(-2, 5));
      slave::SlaveOutput out;
      slave.step(input, dt, out);
      const auto& trace = slave.trace();
      ASSERT_TRUE(is_finite(out.force_w_nn) && is_finite(out.tip_pos_w_nm) && std::isfinite(trace.stored_aj))
          << trial << ' ' << i;
      ASSERT_LE(out.force_w_nn.norm(), scene->limits.force_max_nn * (1 + 1e-9)) << trial << ' ' << i;
      ASSERT_GE(out.energy_in_aj, last.energy_in_aj);
      ASSERT_GE(out.energy_out_aj, last.energy_out_aj);
      ASSERT_GE(trace.dissipated_aj, dissipated) << trial << ' ' << i;
      dissipated = trace.dissipated_aj;
      most = std::max({most, std::fabs(trace.stored_aj), out.energy_in_aj, out.energy_out_aj});
      ASSERT_NEAR(out.energy_in_aj - out.energy_out_aj, trace.stored_aj - start_aj + trace.dissipated_aj,
                  1e-11 * most)
          << trial << ' ' << i;
      ++steps;
      unbalanced += (out.fault_bits & link::kFaultNoEquilibrium) != 0;
      last = out;
    }
  }
  std::printf("%d steps, %d without a balance\n", steps, unbalanced);
  EXPECT_LT(unbalanced, steps / 100);
}

}  // namespace
}  // namespace telenano::physics
