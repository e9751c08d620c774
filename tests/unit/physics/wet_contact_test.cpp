// A bridge changes what the contact is surrounded by: with Young's equation the wetted contact's work of
// adhesion is w - 2 gamma c. Oracles here are closed forms of rigid bodies, and sums of force times way that
// know nothing of potentials.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "tests/support/contact_paths.h"

namespace telenano::physics {
namespace {

using testing::material_of;
using testing::silicon_on;
using testing::stored_aj;
using testing::WorkIntegral;

constexpr double kRadius = 20;
constexpr double kTension = 0.0728;
constexpr double kCutOff = 0.165;
constexpr double kDeg = M_PI / 180;

double kelvin_nm(double humidity_percent) {
  return 18.05e-6 / (8.31446261815324 * 293.15) * 1e9 * kTension / -std::log(0.01 * humidity_percent);
}

/// Of a rigid sphere: w = 0.4 N/m, lambda = 2e-5 at 20 nm, so that elasticity moves forces by 1e-4 of
/// themselves.
TipSampleParameters rigid_bodies(double humidity_percent, double angle_deg) {
  TipSampleParameters p = material_of(2e-5, true);
  p.contact_modulus_gpa *= 4;  // lambda ~ (w^2/K^2)^(1/3) of w = 0.1 N/m
  p.work_of_adhesion_n_m = 0.4;
  p.long_range.capillary.humidity_percent = humidity_percent;
  p.long_range.capillary.contact_angle_tip_deg = angle_deg;
  p.long_range.capillary.contact_angle_sample_deg = angle_deg;
  return p;
}

/// Greatest attraction on the way out of the contact with the overlap held: what load control parts at.
double pull_off_nn(const TipSampleLaw& law, double from_nm, double to_nm, double step_nm) {
  TipSampleState state;
  law.advance(-50, 0, kRadius, state);
  double most = 0;
  law.advance(from_nm, 0, kRadius, state);
  for (double x = from_nm; x > to_nm; x -= step_nm)
    most = std::max(most, -law.advance(x, 0, kRadius, state).force_nn);
  return most;
}

// 4 pi R gamma c + 2 pi R w_SLS, w_SLS = w - 2 gamma c: all of it 2 pi R w, whatever the liquid.
TEST(WetContact, RigidSpherePartsAtMeniscusAndWettedVanDerWaals) {
  for (const double humidity : {25.0, 50.0, 90.0}) {
    for (const double angle : {0.0, 20.0, 60.0}) {
      const TipSampleLaw law(rigid_bodies(humidity, angle));
      const double c = std::cos(angle * kDeg);
      const double meniscus = 4 * M_PI * kRadius * kTension * c;
      const double wetted = 2 * M_PI * kRadius * (0.4 - 2 * kTension * c);
      TipSampleState state;
      law.advance(-50, 0, kRadius, state);
      // Touch is crossed by 1e-6 nm, which contact bears with 1e-3 nN at most here, and is left again.
      const Equilibrium in = law.advance(1e-6, 0, kRadius, state);
      ASSERT_TRUE(in.bridge) << humidity << ' ' << angle;
      const double out = pull_off_nn(law, 1e-6, -3, 1e-4);
      EXPECT_NEAR(out, meniscus + wetted, 1e-3 * out) << humidity << ' ' << angle;
    }
  }
}

// The loop in and out of touch, all by force times way, against its closed form: out from touch the meniscus
// F0 D_r/2 and the wetted attraction are overcome, in came the dry one,
//   W = F0 D_r/2 - 2 pi R (2 gamma c) A,
// A the integral over the gap of the rigid attraction over 2 pi R w: Dugdale's 1 - D/h0, h0 = 0.974 a0, up to
// where van der Waals' a0^2/(a0 + D)^2 is as strong, and that from there to D_r.
double displaced_nm(double reach_nm) {
  const double h0 = 9 * std::sqrt(3.0) / 16 * kCutOff;
  double low = 0.3 * kCutOff, high = h0;  // they also meet at 0
  for (int i = 0; i < 100; ++i) {
    const double mid = 0.5 * (low + high), y = 1 + mid / kCutOff;
    (1 - mid / h0 > 1 / (y * y) ? low : high) = mid;
  }
  return low - low * low / (2 * h0) + kCutOff * kCutOff * (1 / (kCutOff + low) - 1 / (kCutOff + reach_nm));
}

TEST(WetContact, LoopCostsTheMeniscusLessWhatItDisplaces) {
  for (const double humidity : {10.0, 50.0, 90.0}) {
    for (const double angle : {0.0, 45.0}) {
      const TipSampleLaw law(rigid_bodies(humidity, angle));
      const double c = std::cos(angle * kDeg);
      const double reach = 2 * kelvin_nm(humidity) * c;
      const double share = 4 * M_PI * kRadius * kTension * c;
      const double loop = share * (0.5 * reach - displaced_nm(reach));
      if (reach < 2.2 * kCutOff) continue;  // no bridge: below
      TipSampleState state;
      const WorkIntegral work(law, 0, kRadius);
      double position = -60, sum = 0, dissipated = 0;
      law.advance(position, 0, kRadius, state);
      for (const double target : {-1e-3, 1e-7, -1e-3, -60.0}) {
        sum += work.run(position, target, state, 1e-11);
        dissipated += law.advance(target, 0, kRadius, state).dissipated_aj;
        position = target;
      }
      // Elasticity: 1e-4 of the energies.
      EXPECT_NEAR(sum, loop, 1e-3 * share * reach) << humidity << ' ' << angle;
      EXPECT_NEAR(dissipated, sum, 1e-7 * share) << humidity << ' ' << angle;
      EXPECT_GT(loop, 0);
    }
  }
}

// Where the meniscus reaches no farther than what it displaces there is none, and so nothing is left of it as
// the air gets dry.
TEST(WetContact, DryAirIsDry) {
  for (const double lambda : {0.05, 0.73676, 4.0, 400.0}) {
    TipSampleParameters p = material_of(lambda, true);
    p.long_range.capillary.contact_angle_tip_deg = p.long_range.capillary.contact_angle_sample_deg = 60;
    const TipSampleLaw dry(material_of(lambda, true));
    const double step = 1e-3 * (dry.scales(kRadius).overlap_nm + 0.2);
    const double from = 3 * dry.scales(kRadius).overlap_nm, to = -4 * dry.scales(kRadius).overlap_nm - 2;
    const double expected = pull_off_nn(dry, from, to, step);
    for (const double humidity : {1e-6, 1e-3, 0.1, 1.0}) {
      p.long_range.capillary.humidity_percent = humidity;
      // The same curve, on the same rows: a part in 1e9 is how exactly folds are found.
      EXPECT_NEAR(pull_off_nn(TipSampleLaw(p), from, to, step), expected, 1e-9 * expected)
          << lambda << ' ' << humidity;
    }
  }
}

// Silicon on silicon oxide at 50 %, 20 degrees: the wetted contact is another one of Maugis–Dugdale, with
// w_SLS and its lambda. Its pull-off, of a law without any bridge, and the meniscus' force at touch bound it
// from above; at the gap where the wetted contact parts, from below.
TEST(WetContact, ElasticPullOffIsTheWettedContactsAndTheMeniscus) {
  TipSampleParameters p = silicon_on(70, 0.2, 0.27, true);
  p.long_range.capillary.humidity_percent = 50;
  p.long_range.capillary.contact_angle_tip_deg = p.long_range.capillary.contact_angle_sample_deg = 20;
  const double c = std::cos(20 * kDeg);
  const double meniscus = 4 * M_PI * kRadius * kTension * c;
  TipSampleParameters wetted = silicon_on(70, 0.2, 0.27, true);
  wetted.work_of_adhesion_n_m -= 2 * kTension * c;
  const double alone = TipSampleLaw(wetted).pull_off_nn(kRadius);
  const double out = pull_off_nn(TipSampleLaw(p), 0.5, -3, 1e-4);
  EXPECT_LT(out, alone + meniscus);
  EXPECT_GT(out, alone + meniscus * (1 - 0.2 / (2 * kelvin_nm(50) * c)));
  EXPECT_NEAR(out, 44.4, 0.1);
}

// Never does forming or breaking a bridge make work: random walks of the height, rigid and on springs, of any
// humidity, film, angle and stiffness, closed again: the sum of force times way is what was lost, and loss.
TEST(WetContact, ClosedWalksLoseEnergy) {
  std::mt19937_64 random(7);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  int bridged = 0;
  for (int i = 0; i < 60; ++i) {
    TipSampleParameters p = material_of(std::exp(uniform(std::log(0.01), std::log(300.0))), i % 5 != 0);
    p.work_of_adhesion_n_m = 0.2;
    CapillaryParameters& water = p.long_range.capillary;
    water.humidity_percent = i % 3 == 0 ? uniform(1, 25) : uniform(1, 95);
    water.film_nm = i % 4 == 0 ? 0 : uniform(0, 0.8);
    water.contact_angle_tip_deg = uniform(0, 80);
    water.contact_angle_sample_deg = uniform(0, 80);
    water.model = i % 2 == 0 ? CapillaryModel::kConstantVolume : CapillaryModel::kConstantCurvature;
    if (p.van_der_waals && i % 7 == 1) p.long_range.retardation_nm = 100;
    if (p.van_der_waals && i % 7 == 2) {
      p.long_range.cone_half_angle_deg = 20;
      p.long_range.cone_height_nm = 5000;
    }
    const TipSampleLaw law(p);
    const double unit = law.scales(kRadius).overlap_nm;
    const double c = i % 3 == 1 ? 0 : 1 / uniform(0.5, 100);
    const double pull = 60;
    // Round the gaps where bridges form and break, sometimes in the contact, sometimes far away.
    const double far = -(3 + 3 * unit + 2 * kelvin_nm(water.humidity_percent) + 2 * c * pull);
    std::vector<double> walk;
    for (int k = 0; k < 12; ++k)
      walk.push_back(k % 4 == 0 ? uniform(far, 0) : uniform(-1.2, 0.3) - c * pull * uniform(0, 1));
    if (i % 6 == 0) walk[6] = 2 * unit;
    walk.push_back(2 * far);
    TipSampleState state;
    const WorkIntegral work(law, c, kRadius);
    double position = 2 * far, sum = 0, dissipated = 0;
    const double start = stored_aj(law.advance(position, c, kRadius, state), c);
    const double scale = law.scales(kRadius).energy_aj + pull;
    double before = start;
    for (const double target : walk) {
      const double leg = work.run(position, target, state, 1e-10 * scale);
      const Equilibrium e = law.advance(target, c, kRadius, state);
      ASSERT_EQ(e.status, SolveStatus::kOk) << i;
      bridged += e.bridge;
      ASSERT_GE(e.dissipated_aj, 0) << i;
      // The quadrature's limit: 1e-10 an interval, of a few hundred.
      ASSERT_NEAR(leg, stored_aj(e, c) - before + e.dissipated_aj, 3e-8 * scale) << i << " to " << target;
      before = stored_aj(e, c);
      sum += leg;
      dissipated += e.dissipated_aj;
      position = target;
    }
    EXPECT_GE(sum, -1e-7 * scale) << i;
    EXPECT_NEAR(sum, dissipated, 1e-7 * scale) << i;
  }
  EXPECT_GT(bridged, 100);
}

// A bridge forms where that sets energy free: with films that meet at 0.4 nm and 20 % it does not do so
// there, at 50 % it does. By the closed form of rigid bodies, the meniscus' energy against what it displaces:
//   (D_r - D)^2/2 D_r = a0^2/(a0 + D).
TEST(WetContact, FormsWhereTheEnergyFalls) {
  for (const double humidity : {8.0, 20.0, 50.0}) {
    TipSampleParameters p = rigid_bodies(humidity, 20);
    p.long_range.capillary.film_nm = 0.4;
    const double reach = 2 * kelvin_nm(humidity) * std::cos(20 * kDeg);
    const auto frees = [&](double gap) {
      return (reach - gap) * (reach - gap) / (2 * reach) > kCutOff * kCutOff / (kCutOff + gap);
    };
    double expected = 0.4;
    while (expected > 0 && !frees(expected)) expected -= 1e-4;
    const TipSampleLaw law(p);
    TipSampleState state;
    double formed = -1;
    for (double gap = 2; gap > -0.01; gap -= 1e-4) {
      if (!law.advance(-gap, 0, kRadius, state).bridge) continue;
      formed = gap;
      break;
    }
    EXPECT_NEAR(formed, expected, 2.1e-4) << humidity;
    if (humidity == 20) {
      EXPECT_LT(formed, 0.39) << humidity;
    }
  }
}

}  // namespace
}  // namespace telenano::physics
