#include "telenano/common/control/scaling.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <complex>
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

using Complex = std::complex<double>;

Complex coupling(const ScalingPlant& p, Complex z) {
  return p.coupling_damping_n_s_m + p.coupling_stiffness_n_m * p.period_s * z / (z - 1.0);
}

/// KS eq. 7 as a matrix and eq. 21 as it stands, on a grid of the unit circle: the largest α_v α_F that
/// passes. The mass is in the matrix, and must not matter.
double llewellyn_on_the_matrix(const ScalingPlant& p, double mass_kg) {
  const auto passes = [&](double impedance) {
    constexpr int kPoints = 10'000;
    for (int i = 1; i < kPoints; ++i) {
      const Complex z = std::polar(1.0, kPi * i / kPoints);
      const Complex hold = 0.5 * (z + 1.0) / z;
      const Complex device = 2 * mass_kg / p.period_s * (z - 1.0) / (z + 1.0) + p.device_damping_n_s_m;
      const double velocity_scale = 1e-6, force_scale = impedance / velocity_scale;
      const Complex p11 = device + p.adaptive_damping_n_s_m * hold;
      const Complex p12 = force_scale * hold, p21 = -velocity_scale, p22 = 1.0 / coupling(p, z);
      const Complex product = p12 * p21;
      if (p11.real() < 0 || p22.real() < 0 ||
          2 * p11.real() * p22.real() < std::abs(product) + product.real())
        return false;
    }
    return true;
  };
  double low = 0, high = 1e9;
  for (int i = 0; i < 60; ++i) {  // to 1e-9
    const double middle = 0.5 * (low + high);
    (passes(middle) ? low : high) = middle;
  }
  return low;
}

/// The display's theorem (CB), b + γ cos θ ≥ T/2/(1 − cos θ)·Re{(1 − e^{−jθ}) e^{−jdθ} H}, for every
/// environment that is passive at that θ: behind the coupling, 1/Z = 1/Z_c + 1/Z_e with Re(1/Z_e) ≥ 0, so Z
/// fills the disc through 0 and 1/Re(1/Z_c), of radius R about R. H, force over position, is Z(z − 1)/(T z),
/// and Re(w Z) on that disc is at most R(Re w + |w|).
double worst_passive_environment(const ScalingPlant& p) {
  double largest = std::numeric_limits<double>::infinity();
  constexpr int kPoints = 4000;
  for (int i = 1; i <= kPoints; ++i) {
    const double theta = kPi * i / kPoints;
    const Complex z = std::polar(1.0, theta);
    const double radius = 0.5 / (1.0 / coupling(p, z)).real();
    const Complex w = (1.0 - 1.0 / z) * std::pow(z, -p.delay_samples) * (z - 1.0) / (p.period_s * z);
    const double taken = 0.5 * p.period_s / (1 - std::cos(theta)) * radius * (w.real() + std::abs(w));
    const double damping = p.device_damping_n_s_m + p.adaptive_damping_n_s_m * std::cos(theta);
    if (taken > 0) largest = std::min(largest, damping / taken);
  }
  return largest;
}

TEST(ExactBound, IsTheWorstPassiveEnvironmentBehindTheCoupling) {
  for (int d : {0, 1, 3}) {
    for (double b_c : {0.0, 0.003, 0.02}) {
      for (double gamma : {0.0, 0.7}) {
        const ScalingPlant p = plant(2, gamma, 40, b_c, d);
        const double walked = worst_passive_environment(p);
        // The grid misses the minimum by O((d + 1)π/4000)² ≤ 1e-5 of it, and never lies below.
        EXPECT_NEAR(exact_impedance_bound(p), walked, 1e-5 * walked) << d << ' ' << b_c << ' ' << gamma;
        EXPECT_LE(exact_impedance_bound(p), walked * (1 + 1e-9));
      }
    }
  }
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

TEST(LlewellynBound, IsTheCriterionOnTheHybridMatrix) {
  for (double b_c : {0.0, 0.003, 0.02, 0.2}) {
    for (double gamma : {0.0, 0.5, 1.5}) {
      for (double mass_kg : {0.0, 0.25}) {
        const ScalingPlant p = plant(2, gamma, 40, b_c, 0);
        const double expected = llewellyn_on_the_matrix(p, mass_kg);
        // The grid misses the minimum by O(π/10000)² = 1e-7 of it. Re p11 of a mass is rounding of 2m/T =
        // 500 N·s/m times tan(θ/2) up to 1e4: 1e-9 N·s/m beside b = 2.
        EXPECT_NEAR(llewellyn_impedance_bound(p), expected, 1e-6 * expected) << b_c << ' ' << gamma;
      }
    }
  }
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

/// The least that any hand, whatever its way through so many periods, puts into a device of 1 N s/m that holds a
/// sampled spring for periods of 1 s, `delay` of them late; per square of its way. Hand motions are lines between
/// `kParts` places a period: what it puts in, b∫v² dt − ∫F v dt, is then a quadratic form of the steps between
/// them, and its least eigenvalue says whether there is a motion that takes something out.
double least_put_in(double spring_n_m, double delay) {
  constexpr int kPeriods = 10, kParts = 5;
  const int late = static_cast<int>(std::lround(delay * kParts));
  Eigen::MatrixXd form = Eigen::MatrixXd::Identity(kPeriods * kParts, kPeriods * kParts) * kParts;
  for (int step = late; step < kPeriods * kParts; ++step) {
    const int sampled = (step - late) / kParts * kParts;
    for (int before = 0; before < sampled; ++before) form(step, before) += spring_n_m;
  }
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(0.5 * (form + form.transpose()))
      .eigenvalues()
      .minCoeff();
}

TEST(ExactBound, HoldsForEveryHandWhereTheForceIsAPartOfAPeriodLate) {
  ScalingPlant p = plant(1, 0, 1, 0, 0);
  p.period_s = 1;
  for (const double delay : {0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.4, 2.0}) {
    const double spring_n_m = exact_impedance_bound(p, delay);
    EXPECT_GE(least_put_in(0.999 * spring_n_m, delay), 0) << delay;
    // Any environment counts, of which a spring alone is not the worst; without a delay it is.
    if (delay <= 1) {
      EXPECT_LT(least_put_in((delay == 0 ? 1.001 : 1.6) * spring_n_m, delay), 0) << delay;
    }
    EXPECT_LT(exact_impedance_bound(p, delay + 0.1), exact_impedance_bound(p, delay));
  }
  for (const int whole : {0, 1, 7}) {
    p.delay_samples = whole;
    EXPECT_EQ(exact_impedance_bound(p, static_cast<double>(whole)), exact_impedance_bound(p));
  }
}

}  // namespace
}  // namespace telenano::control
