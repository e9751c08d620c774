#include "telenano/nve_server/physics/surface/relative_curvature.h"

#include <gtest/gtest.h>

#include <cmath>

namespace telenano::physics {
namespace {

// Sphere of radius ρ under a sphere of radius R: 1/R_eff = 1/R + 1/ρ; any point of the cap, however steep.
TEST(RelativeCurvature, SphereOnSphereIsExact) {
  for (const double rho : {5.0, 80.0, 3000.0}) {
    for (const double x : {0.0, 0.3, -0.7}) {
      const double y = 0.4;
      const double z = std::sqrt(1 - x * x - y * y);  // in units of ρ
      HeightJet jet;
      jet.zx = -x / z;
      jet.zy = -y / z;
      jet.zxx = -(1 - y * y) / (z * z * z) / rho;
      jet.zxy = -x * y / (z * z * z) / rho;
      jet.zyy = -(1 - x * x) / (z * z * z) / rho;
      const PrincipalCurvatures k = principal_curvatures(jet);
      // The two are a square root of rounding apart: √(1e-16).
      EXPECT_NEAR(k.first_1_per_nm * rho, 1, 1e-7);
      EXPECT_NEAR(k.second_1_per_nm * rho, 1, 1e-7);
      EXPECT_NEAR(relative_curvature(20, k), 1 + 20 / rho, 1e-13 * (1 + 20 / rho));
    }
  }
}

TEST(RelativeCurvature, CylinderAndSaddleAreExact) {
  HeightJet ridge;
  ridge.zxx = -0.05;
  EXPECT_NEAR(relative_curvature(20, principal_curvatures(ridge)), std::sqrt(2.0), 1e-15);
  HeightJet saddle;
  saddle.zxy = 0.02;  // κ = ±0.02
  EXPECT_NEAR(relative_curvature(20, principal_curvatures(saddle)), std::sqrt(1.4 * 0.6), 1e-15);
}

// C² where it starts and ends, rises throughout, exact above 2m, never below m.
TEST(RelativeCurvature, FactorsAreKeptSmoothly) {
  constexpr double m = kMinRelativeCurvature;
  EXPECT_EQ(kept_factor(1.0), 1.0);
  EXPECT_EQ(kept_factor(2 * m), 2 * m);
  EXPECT_EQ(kept_factor(0.0), m);
  EXPECT_EQ(kept_factor(-50.0), m);
  const double h = 1e-4;
  for (double c = -0.05; c < 0.3; c += 0.0007) {
    EXPECT_GE(kept_factor(c + h), kept_factor(c));
    EXPECT_GE(kept_factor(c), std::max(c, m) - 1e-15);
    const auto bend = [&](double at) {
      return (kept_factor(at + h) - 2 * kept_factor(at) + kept_factor(at - h)) / (h * h);
    };
    // The third derivative is at most 12m/(2m)³·... = 150: h times it, and rounding 4e-17/1e-8.
    EXPECT_NEAR(bend(c + h), bend(c), 2 * 150 * h);
  }
}

TEST(RelativeCurvature, PitNarrowerThanTheTipHasTheGreatestRadius) {
  HeightJet pit;
  pit.zxx = pit.zyy = 1 / 15.0;
  EXPECT_NEAR(relative_curvature(20, principal_curvatures(pit)), kMinRelativeCurvature, 1e-15);
}

}  // namespace
}  // namespace telenano::physics
