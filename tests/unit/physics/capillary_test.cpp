#include "telenano/nve_server/physics/long_range/capillary.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/contact/maugis_dugdale.h"

namespace telenano::physics {
namespace {

constexpr double kRadius = 20;
constexpr double kTension = 0.0728;

CapillaryParameters water(double humidity, CapillaryModel model = CapillaryModel::kConstantCurvature) {
  CapillaryParameters p;
  p.humidity_percent = humidity;
  p.contact_angle_tip_deg = 30;
  p.contact_angle_sample_deg = 60;
  p.model = model;
  return p;
}
const double kCosine = 0.5 * (std::cos(M_PI / 6) + 0.5);

TEST(Capillary, KelvinRadiusIsThePublishedOne) {
  // Water at 20 °C, to the digits given.
  for (const auto& [humidity, r] : {std::pair{20.0, 0.335}, {50.0, 0.778}, {80.0, 2.416}})
    EXPECT_NEAR(Capillary(water(humidity)).kelvin_radius_nm(), r, 1e-3);
}

TEST(Capillary, ConstantCurvatureIsTheRigidLimitOfTheDugdaleAnnulus) {
  // sigma0 = gamma/r, w = 2 gamma c, h0 = 2 r c. A very stiff sphere before contact: the contact law itself,
  // whose elastic part at lambda = 1e-7 is 1e-7 of the rest.
  const Capillary bridge(water(50));
  const double r = bridge.kelvin_radius_nm();
  const double w = 2 * kTension * kCosine;
  const double sigma0 = kTension / r;
  constexpr double kLambda = 1e-7;
  // lambda = 2 sigma0 (R/(pi w K^2))^(1/3)
  const double k = std::sqrt(8 * sigma0 * sigma0 * sigma0 * kRadius / (M_PI * w)) / std::pow(kLambda, 1.5);
  const double u_delta = std::cbrt(M_PI * M_PI * w * w * kRadius / (k * k));
  const double u_force = M_PI * w * kRadius;
  const MaugisDugdale curve(kLambda);
  const BridgeState state = bridge.formed(kRadius);
  EXPECT_NEAR(state.rupture_gap_nm, curve.range() * u_delta, 1e-12);
  for (double gap = 0.02; gap < state.rupture_gap_nm; gap += 0.1) {
    const CurvePoint p = curve.solve(-gap / u_delta, {1, 0}).point;
    const double scale = 4 * M_PI * kRadius * kTension * kCosine;
    EXPECT_NEAR(bridge.at(gap, kRadius, state).force_nn, p.load * u_force, 3e-7 * scale) << gap;
    EXPECT_NEAR(bridge.energy_aj(gap, kRadius, state), p.energy * u_force * u_delta, 1e-6 * scale) << gap;
  }
}

TEST(Capillary, ForceIsThePressureOverTheWettedArea) {
  // Written from the geometry of the meniscus, not from the closed forms: the circle x where the liquid ends
  // by halving, then pressure times area.
  const Capillary curvature(water(65));
  const double r = curvature.kelvin_radius_nm();
  const BridgeState bridge = curvature.formed(kRadius);
  for (const double gap : {0.0, 0.3, 1.1}) {
    const double x2 = 2 * kRadius * (2 * r * kCosine - gap);  // D + x^2/2R = 2 r c
    EXPECT_NEAR(curvature.at(gap, kRadius, bridge).force_nn, -M_PI * x2 * kTension / r, 1e-12 * 20);
  }
  const Capillary volume(water(65, CapillaryModel::kConstantVolume));
  const BridgeState drop = volume.formed(kRadius);
  for (const double gap : {0.0, 0.3, 1.1, 2.0, 5.0}) {
    double low = 0, high = 100;
    for (int i = 0; i < 200; ++i) {
      const double x = 0.5 * (low + high);
      (M_PI * x * x * (gap + x * x / (4 * kRadius)) < drop.volume_nm3 ? low : high) = x;
    }
    const double height = gap + low * low / (2 * kRadius);
    EXPECT_NEAR(volume.at(gap, kRadius, drop).force_nn, -M_PI * low * low * kTension * 2 * kCosine / height,
                1e-12 * 20);
  }
}

TEST(Capillary, BothModelsStartFromTheSameForce) {
  for (const double film : {0.0, 0.2, 0.7}) {
    CapillaryParameters p = water(70);
    p.film_nm = film;
    const Capillary curvature(p);
    p.model = CapillaryModel::kConstantVolume;
    const Capillary volume(p);
    ASSERT_EQ(curvature.formation_gap_nm(kRadius), film);
    ASSERT_EQ(volume.formation_gap_nm(kRadius), film);
    EXPECT_NEAR(curvature.at(film, kRadius, curvature.formed(kRadius)).force_nn,
                volume.at(film, kRadius, volume.formed(kRadius)).force_nn, 1e-12 * 20);
  }
}

TEST(Capillary, ForceAndStiffnessAreDerivativesAndEnergyEndsAtZero) {
  for (const auto model : {CapillaryModel::kConstantCurvature, CapillaryModel::kConstantVolume}) {
    for (const double humidity : {5.0, 50.0, 95.0}) {
      const Capillary law(water(humidity, model));
      const BridgeState bridge = law.formed(kRadius);
      const double end = bridge.rupture_gap_nm;
      EXPECT_NEAR(law.energy_aj(end, kRadius, bridge), 0, 1e-14);
      EXPECT_EQ(law.energy_aj(0.5 * end, kRadius, {}), 0);
      EXPECT_EQ(law.at(0.5 * end, kRadius, {}).force_nn, 0);
      for (const double part : {0.01, 0.2, 0.5, 0.9}) {
        const double gap = part * end;
        const double h = 1e-4 * gap;
        const LongRangePoint p = law.at(gap, kRadius, bridge);
        // Central differences: h^2 of the third derivative, 1e-8 of the value over the gap's scale, is 1e-7.
        EXPECT_NEAR(
            p.force_nn,
            (law.energy_aj(gap - h, kRadius, bridge) - law.energy_aj(gap + h, kRadius, bridge)) / (2 * h),
            1e-7 * std::fabs(p.force_nn) + 1e-9);
        EXPECT_NEAR(
            p.stiffness_n_m,
            (law.at(gap - h, kRadius, bridge).force_nn - law.at(gap + h, kRadius, bridge).force_nn) / (2 * h),
            1e-7 * std::fabs(p.stiffness_n_m) + 1e-9);
        EXPECT_LT(law.energy_aj(gap, kRadius, bridge), 0);
      }
    }
  }
}

TEST(Capillary, LoopFormedAtTouch) {
  // W = 4 pi R gamma r c^2
  const Capillary law(water(50));
  const double r = law.kelvin_radius_nm();
  EXPECT_NEAR(-law.energy_aj(0, kRadius, law.formed(kRadius)),
              4 * M_PI * kRadius * kTension * r * kCosine * kCosine, 1e-13);
}

TEST(Capillary, RuptureOfAVolume) {
  CapillaryParameters p = water(0, CapillaryModel::kConstantVolume);
  p.volume_nm3 = 1000;
  // (1 + theta/2) V^(1/3), theta = 45 degrees
  EXPECT_NEAR(Capillary(p).formed(kRadius).rupture_gap_nm, (1 + M_PI / 8) * 10, 1e-12);
}

TEST(Capillary, FormsBeforeItRuptures) {
  for (const auto model : {CapillaryModel::kConstantCurvature, CapillaryModel::kConstantVolume}) {
    for (const double humidity : {1.0, 50.0, 99.0}) {
      for (const double radius : {1.0, 20.0, 1e4}) {
        CapillaryParameters p = water(humidity, model);
        p.film_nm = 1e6;
        const Capillary law(p);
        const BridgeState bridge = law.formed(radius);
        EXPECT_LE(law.formation_gap_nm(radius), bridge.rupture_gap_nm);
        EXPECT_GE(bridge.volume_nm3, 0);
      }
    }
  }
}

TEST(Capillary, RejectsWhatIsNoMeniscus) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const auto rejects = [](auto change) {
    CapillaryParameters p = water(50);
    change(p);
    EXPECT_THROW(Capillary{p}, UserError);
  };
  for (const double bad : {-1.0, 100.0, kNan}) rejects([=](auto& p) { p.humidity_percent = bad; });
  for (const double bad : {-1.0, 181.0, kNan}) rejects([=](auto& p) { p.contact_angle_tip_deg = bad; });
  for (const double bad : {0.0, -1.0, kNan}) rejects([=](auto& p) { p.surface_tension_n_m = bad; });
  for (const double bad : {-1.0, kNan, 1.0}) rejects([=](auto& p) { p.volume_nm3 = bad; });
  for (const double bad : {-1.0, kNan}) rejects([=](auto& p) { p.film_nm = bad; });
  rejects([](auto& p) { p.contact_angle_tip_deg = p.contact_angle_sample_deg = 95; });
  EXPECT_FALSE(Capillary(CapillaryParameters{}).active());
}

}  // namespace
}  // namespace telenano::physics
