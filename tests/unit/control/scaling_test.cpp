#include "common/control/scaling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace telenano::control {
namespace {

ScalingPlant plant(double b, double gamma, double k_c, double b_c, int delay) {
  ScalingPlant p;
  p.device_damping_n_s_m = b;
  p.adaptive_damping_n_s_m = gamma;
  p.coupling_stiffness_n_m = k_c;
  p.coupling_damping_n_s_m = b_c;
  p.delay_samples = delay;
  return p;
}

/// The formula of the header, typed once more with library functions, on a fine grid: never below the true
/// minimum.
double brute_force(const ScalingPlant& p) {
  const long double spring = p.coupling_stiffness_n_m * p.period_s / 2,
                    sum = p.coupling_damping_n_s_m + spring;
  long double best = std::numeric_limits<long double>::infinity();
  constexpr int kPoints = 200'000;
  for (int i = 1; i <= kPoints; ++i) {
    const long double theta = static_cast<long double>(kPi) * i / kPoints;
    const long double s2 = std::pow(std::sin(theta / 2), 2), c2 = 1 - s2;
    const long double one_minus_cos = 2 * std::pow(std::sin((p.delay_samples + 1) * theta / 2), 2);
    const long double divisor = (sum * sum * s2 + spring * spring * c2) * one_minus_cos;
    if (divisor <= 0) continue;
    const long double damping = p.device_damping_n_s_m + p.adaptive_damping_n_s_m * std::cos(theta);
    best = std::min(best, damping * 2 * sum * s2 / divisor);
  }
  return static_cast<double>(best);
}

TEST(ExactBound, HasItsClosedFormWithoutDelay) {
  for (double gamma : {0.0, 0.5, 1.0, 1.9}) {
    for (double b_c : {0.0, 1e-4, 0.01, 1.0}) {
      const double expected = (2 - gamma) / (b_c + 40 * 1e-3 / 2);
      // The minimum is at θ = π, an end of the grid, so it is met exactly up to rounding.
      EXPECT_NEAR(exact_impedance_bound(plant(2, gamma, 40, b_c, 0)), expected, 1e-12 * expected)
          << gamma << ' ' << b_c;
    }
  }
}

TEST(ExactBound, HasItsClosedFormForASpringWithDelay) {
  for (int d = 0; d <= 200; d = 2 * d + 1) {
    const double expected = 2 * 2.0 / ((d + 1.0) * (d + 1.0) * 1e-3 * 50);
    EXPECT_NEAR(exact_impedance_bound(plant(2, 0, 50, 0, d)), expected, 1e-9 * expected) << d;
  }
}

TEST(ExactBound, FindsTheMinimumWithDampingAndDelay) {
  for (int d : {1, 2, 5, 20}) {
    for (double b_c : {0.001, 0.02, 0.3}) {
      for (double gamma : {0.0, 1.0}) {
        const ScalingPlant p = plant(2, gamma, 40, b_c, d);
        const double reference = brute_force(p);
        // The grid of the reference misses the minimum by at most O(step²) ~ (8e-6·d)².
        EXPECT_NEAR(exact_impedance_bound(p), reference, 1e-7 * reference) << d << ' ' << b_c << ' ' << gamma;
      }
    }
  }
}

TEST(ExactBound, NeedsACoupling) {
  EXPECT_EQ(exact_impedance_bound(plant(2, 0, 0, 0, 3)), std::numeric_limits<double>::infinity());
  EXPECT_LE(exact_impedance_bound(plant(2, 2.5, 40, 0, 0)), 0);  // γ > b: nothing is safe
}

TEST(LlewellynBound, HasItsClosedForm) {
  // γ = b_c = 0: 8b/(k_c T); with b = 2, T = 1 ms that shows α_F α_v k_c = 16 000 N/m.
  EXPECT_NEAR(llewellyn_impedance_bound(plant(2, 0, 50, 0, 0)) * 50, 16'000, 1e-6);
}

TEST(LlewellynBound, IsFourToSeventeenTimesTooPermissive) {
  for (double b_c : {0.0, 0.001, 0.02, 0.1, 1.0}) {
    const double ratio0 =
        llewellyn_impedance_bound(plant(2, 0, 40, b_c, 0)) / exact_impedance_bound(plant(2, 0, 40, b_c, 0));
    const double ratio1 =
        llewellyn_impedance_bound(plant(2, 1, 40, b_c, 0)) / exact_impedance_bound(plant(2, 1, 40, b_c, 0));
    EXPECT_GE(ratio0, 3.99);
    EXPECT_LE(ratio0, 8.01);
    EXPECT_GE(ratio1, 11.8);
    EXPECT_LE(ratio1, 17.9);
  }
}

TEST(Scaling, CrossesUnitsOnceAndConsistently) {
  const Scaling scaling{1e-6, 2e7};
  EXPECT_NEAR(scaling.tip_displacement_nm(Vec3(1e-3, 0, 0)).x(), 1.0, 1e-15);
  EXPECT_NEAR(scaling.hand_displacement_m(Vec3(0, 1, 0)).y(), 1e-3, 1e-18);
  EXPECT_NEAR(scaling.hand_force_n(Vec3(0, 0, 50)).z(), 1.0, 1e-15);
  EXPECT_NEAR(scaling.impedance(), 20, 1e-14);
  // Work is the same on both sides of the power-scale factor: 1 mm against 1 N is 1 nm against 50 nN.
  const double tip_work_aj = 50.0 * 1.0;
  EXPECT_NEAR(scaling.hand_energy_j(tip_work_aj), 1e-3, 1e-18);
  EXPECT_NEAR(scaling.tip_energy_aj(1e-3), 50, 1e-12);
}

TEST(Scaling, DeviceBound) {
  EXPECT_NEAR(device_force_scale_bound(0.8, 12, 100), 9.6 / 100e-9, 1);
  EXPECT_EQ(device_force_scale_bound(0.8, 12, 0), std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace telenano::control
