#include "tests/studies/zwidth/zwidth_study.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "telenano/common/base/error.h"
#include "tests/studies/zwidth/paper_study.h"
#include "tests/studies/zwidth/sampled_loop.h"
#include "tests/studies/zwidth/scaling_study.h"
#include "tests/studies/zwidth/wall_simulation.h"
#include "tests/studies/zwidth/zwidth_figures.h"

namespace telenano::studies {
namespace {

const control::HapticDisplay kDisplay{2.0, 0.25, 1e-3};

// Half a period at a time with the textbook solution of the underdamped oscillator.
TEST(SampledLoop, MotionUnderAHeldForceIsTheClosedSolution) {
  const double m = 0.7, c = 3.0, k = 900.0, t = 1e-3;
  const HeldMotion h = held_motion(m, c, k, t);
  const double a = c / (2 * m), w = std::sqrt(k / m - a * a), e = std::exp(-a * t);
  EXPECT_NEAR(h.xx, e * (std::cos(w * t) + a / w * std::sin(w * t)), 1e-14);  // eight squarings
  EXPECT_NEAR(h.xv, e * std::sin(w * t) / w, 1e-17);
  EXPECT_NEAR(h.xf, (1 - h.xx) / k, 1e-17);
  EXPECT_NEAR(h.vv, e * (std::cos(w * t) - a / w * std::sin(w * t)), 1e-14);  // eight squarings
}

// The limit again, in the time domain: a two-sided wall written as it runs, whose swing decays 0.5 % below
// the limit and grows 0.5 % above it.
double growth(const control::VirtualDamper& w, double k, const Hand& hand) {
  const HeldMotion h = held_motion(kDisplay.mass_kg + hand.mass_kg, kDisplay.damping_n_s_m,
                                   hand.stiffness_n_m, kDisplay.period_s);
  double x = 1, v = 0, before = 1, u = 0, early = 0, late = 0;
  std::vector<double> queue(static_cast<std::size_t>(w.delay_samples), 0.0);
  constexpr int kSteps = 60000;
  for (int i = 0; i < kSteps; ++i) {
    u = (w.filter_s * u + x - before) / (w.filter_s + kDisplay.period_s);
    before = x;
    queue.push_back(k * x + w.damping_n_s_m * u);
    const double f = -queue.front();
    queue.erase(queue.begin());
    const double next = h.vx * x + h.vv * v + h.vf * f;
    x = h.xx * x + h.xv * v + h.xf * f;
    v = next;
    if (!(std::fabs(x) < 1e100)) return 2;
    if (i < kSteps / 2)
      early = i > kSteps / 4 ? std::max(early, std::fabs(x)) : early;
    else if (i > 3 * kSteps / 4)
      late = std::max(late, std::fabs(x));
  }
  return late / early;
}

TEST(SampledLoop, FreeDeviceLosesStabilityWhereItsSwingStopsDecaying) {
  for (const control::VirtualDamper w :
       {control::VirtualDamper{0, 0, 0}, control::VirtualDamper{1, 0, 0},
        control::VirtualDamper{5, 5.3e-3, 0}, control::VirtualDamper{0.5, 0, 3}}) {
    const double limit = stability_limit(kDisplay, w, Hand{});
    EXPECT_LT(growth(w, 0.995 * limit, Hand{}), 1) << w.damping_n_s_m;
    EXPECT_GT(growth(w, 1.005 * limit, Hand{}), 1) << w.damping_n_s_m;
  }
  EXPECT_NEAR(stability_limit(kDisplay, {1, 0, 0}, Hand{}), 5984, 1);
}

// The worst heavy hand of the formula against the eigenvalues of hands of 500 and 5000 kg over the band.
TEST(SampledLoop, HeavyHandsAgreeWithEigenvalues) {
  for (const control::VirtualDamper w : {control::VirtualDamper{1, 0, 0}, control::VirtualDamper{2.5, 0, 0},
                                         control::VirtualDamper{5, 5.3e-3, 0}}) {
    const double expected = control::heavy_hand_stiffness(kDisplay, w);
    for (const double mass : {500.0, 5000.0}) {
      double least = stability_limit(kDisplay, w, Hand{});
      for (double theta = 0.05; theta <= 2.5; theta += 0.05) {
        const double omega = theta / kDisplay.period_s;
        least = std::min(least, stability_limit(kDisplay, w, {mass, (mass + 0.25) * omega * omega, 0}));
      }
      EXPECT_NEAR(least, expected, 0.005 * expected) << w.damping_n_s_m << ' ' << mass;
    }
  }
}

// A damper of twice the device's own: the worst hand resonates at 2.67, near Nyquist. By a third method, the
// eigenvalues of loops with masses, springs and dampers, all of them passive: none is driven up below what
// the formula says, to the mass that is not infinite, and a heavy one is there.
TEST(SampledLoop, NoPassiveHandIsDrivenUpBelowTheHeavyHand) {
  const control::VirtualDamper w{4, 0, 0};
  const double expected = control::heavy_hand_stiffness(kDisplay, w);
  EXPECT_NEAR(expected, 411.8, 0.1);
  double least = stability_limit(kDisplay, w, Hand{});
  for (const double mass : {0.25, 4.0, 100.0, 5000.0}) {
    for (double theta = 0.2; theta<6; theta += theta> 2.5 && theta < 2.85 ? 0.02 : 0.2) {
      const double omega = theta / kDisplay.period_s;
      for (const double damping : {0.0, 0.2}) {
        if (damping > 0 && mass > 10) continue;
        const double limit = stability_limit(kDisplay, w, {mass, (mass + 0.25) * omega * omega, damping});
        // NaN: not stable at K → 0 either.
        ASSERT_FALSE(std::isnan(limit)) << mass << ' ' << theta;
        least = std::min(least, limit);
      }
    }
  }
  EXPECT_NEAR(least, expected, 0.005 * expected);
}

TEST(ZWidthStudy, ALongDelayIsNoReasonToRefuse) {
  ZWidthOptions options;
  options.delay_samples = 100;
  options.validate();
  // CB's theorem in closed form, and no hand below it: 2b/((1 + 2d) T) = 4000/201.
  const control::VirtualDamper late{0, 0, 100};
  EXPECT_NEAR(control::passive_stiffness(kDisplay, late), 4000.0 / 201, 1e-6);
  // At a small K T²/m the delayed wall is b/((d + ½) T) − K of damping to first order: the same number.
  const double free = stability_limit(kDisplay, late, Hand{});
  EXPECT_GT(free, 4000.0 / 201 * 0.999);
  EXPECT_LT(free, 4000.0 / 201 * 1.5);
  options.delay_samples = 257;
  EXPECT_THROW(options.validate(), UserError);
}

// One-sided and with hands, no quantisation: never below passivity, never much above what the worst hand
// allows.
TEST(WallSimulation, LiesBetweenPassivityAndTheWorstHand) {
  for (const double b : {-1.0, 0.0, 0.5, 1.0, 1.5}) {
    for (const int delay : {0, 2}) {
      ZWidthOptions options;
      options.delay_samples = delay;
      const ZWidthRow row = zwidth_row(options, b);
      if (std::isnan(row.passive)) continue;
      EXPECT_GT(row.simulated, 0.99 * row.passive) << b << ' ' << delay;  // found to 1 %
      EXPECT_LT(row.simulated, 1.10 * row.coupled) << b << ' ' << delay;
      EXPECT_GE(row.coupled, row.passive * (1 - 1e-9));
      EXPECT_GE(row.free, row.coupled);
    }
  }
}

TEST(WallSimulation, CoarseEncoderNeedsFriction) {
  // Limit cycles of an encoder die where K q/2 < dry friction (Abbott & Okamura 2005; Diolaiti et al. 2006).
  WallPlant plant;
  plant.display = kDisplay;
  plant.encoder_quantum_m = 1.18e-4;
  const PushingHand leaning{{}, 1.0};
  const double k = 0.5 * 4000;
  const double without = simulate_wall(plant, k, leaning).peak_to_peak_m;
  plant.coulomb_friction_n = k * plant.encoder_quantum_m;
  EXPECT_LT(simulate_wall(plant, k, leaning).peak_to_peak_m, 1e-9);
  EXPECT_GT(without, 1e-9);
}

// CB fig. 4b: a coarse encoder at 1 kHz makes damping rough long before the swing is seen. One count is 118 um, so
// that its force is 0.118 N for each N s/m at 1 kHz and a tenth of it at 100 Hz.
TEST(WallSimulation, ACoarseEncodersDampingIsFeltBeforeItIsSeen) {
  WallPlant plant;
  plant.display = {20, 2, 1e-3};
  plant.encoder_quantum_m = 2 * M_PI * 0.15 / 8000;
  const double seen = reachable_damping(plant, 100, false), felt = reachable_damping(plant, 100, true);
  EXPECT_LT(felt, 0.2 * seen);
  EXPECT_LT(felt, kFeltSwing_n / (plant.encoder_quantum_m / plant.display.period_s));
  plant.display.period_s = 1e-2;
  EXPECT_GT(reachable_damping(plant, 100, true), 3 * felt);
}

TEST(ZWidthStudy, RefusesNonsense) {
  const auto message = [](auto change) {
    ZWidthOptions options;
    change(options);
    try {
      options.validate();
    } catch (const UserError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_NE(message([](auto& o) { o.display.period_s = 0; }).find("--period-s"), std::string::npos);
  EXPECT_NE(message([](auto& o) { o.display.mass_kg = -1; }).find("--mass"), std::string::npos);
  EXPECT_NE(message([](auto& o) { o.display.damping_n_s_m = NAN; }).find("--damping"), std::string::npos);
  EXPECT_NE(message([](auto& o) { o.virtual_damping_n_s_m.clear(); }).find("empty"), std::string::npos);
  EXPECT_NE(message([](auto& o) { o.delay_samples = -1; }).find("--delay-samples"), std::string::npos);
  EXPECT_NE(message([](auto& o) { o.encoder_counts_per_m = -1; }).find("counts"), std::string::npos);
}

TEST(PaperStudy, SixteenConfigurations) {
  const auto all = paper_configurations();
  EXPECT_EQ(all.size(), 16u);
  // q = 2π·0.15 m/8000 = 0.1178 mm; over 1 ms 0.118 m/s, behind 30 Hz (τ = 5.3 ms) 0.0187 m/s.
  for (const auto& c : all) {
    if (c.fine || !c.fast) continue;
    EXPECT_NEAR(c.velocity_resolution_m_s(), c.filtered ? 0.018692 : 0.117810, 1e-5);
  }
}

// Without damping the rigid environment is a spring of alpha k_c on a sampled mass and damper, whose limit
// the eigenvalues give: the time domain finds it to its own 1 % and what a swing needs to be seen growing (3
// % of b).
TEST(ScalingStudy, SimulatedLimitLiesWhereTheEigenvaluesSay) {
  control::ScalingPlant plant;
  plant.coupling_stiffness_n_m = 13.3;
  const SimulatedImpedance s = simulated_impedance(plant, kDisplay.mass_kg);
  const double free = stability_limit(kDisplay, {}, Hand{}) / plant.coupling_stiffness_n_m;
  EXPECT_NEAR(s.free_device, free, 0.04 * free);
  EXPECT_LE(s.worst_hand, s.free_device);
  EXPECT_GE(s.worst_hand, 0.999 * control::exact_impedance_bound(plant));  // passivity suffices
  EXPECT_LT(s.worst_hand, control::llewellyn_impedance_bound(plant));      // the published region does not
}

TEST(ScalingStudy, DampedCouplingBetweenTheBounds) {
  control::ScalingPlant plant;
  plant.coupling_stiffness_n_m = 13.3;
  plant.coupling_damping_n_s_m = 0.5 * plant.coupling_stiffness_n_m * plant.period_s;
  const SimulatedImpedance s = simulated_impedance(plant, kDisplay.mass_kg);
  EXPECT_GE(s.worst_hand, 0.999 * control::exact_impedance_bound(plant));
  EXPECT_LT(s.worst_hand, control::llewellyn_impedance_bound(plant));
  // gamma acts without the delay of the loop, which the wall of the simulation cannot.
  plant.adaptive_damping_n_s_m = 1;
  plant.delay_samples = 1;
  EXPECT_TRUE(std::isnan(simulated_impedance(plant, kDisplay.mass_kg).worst_hand));
}

TEST(ZWidthFigures, GainsOfAFactorAreMediansOfItsPairs) {
  // Made-up rows: the damper gives ten times the stiffness and twice the damping, nothing else does anything;
  // in one pair of the fine encoder it gives twenty.
  std::vector<PaperRow> rows;
  for (const PaperConfiguration& c : paper_configurations()) {
    const bool odd = c.damper && c.fine && c.fast && c.filtered;
    for (const double b : {0.0, c.damper ? 2.0 : 1.0}) {
      ZWidthRow values;
      values.virtual_damping_n_s_m = b;
      values.simulated = c.damper ? (odd ? 2000 : 1000) : 100;
      rows.push_back({c, values});
    }
    ZWidthRow nothing;
    nothing.virtual_damping_n_s_m = 50;
    nothing.simulated = NAN;  // not stable there: counts for nothing
    rows.push_back({c, nothing});
  }
  const std::vector<FactorGain> gains = factor_gains(rows);
  ASSERT_EQ(gains.size(), 4u);
  EXPECT_DOUBLE_EQ(gains[0].stiffness_least, 10);
  EXPECT_DOUBLE_EQ(gains[0].stiffness_median, 10);
  EXPECT_DOUBLE_EQ(gains[0].stiffness_most, 20);
  EXPECT_DOUBLE_EQ(gains[0].damping_median, 2);
  for (std::size_t i = 1; i < 4; ++i) {
    EXPECT_DOUBLE_EQ(gains[i].stiffness_median, 1);
    EXPECT_DOUBLE_EQ(gains[i].stiffness_most, 2);  // the odd one against its partner
    EXPECT_DOUBLE_EQ(gains[i].damping_most, 1);
  }
}

}  // namespace
}  // namespace telenano::studies
