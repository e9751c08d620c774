#include "telenano/common/control/z_width.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <random>

namespace telenano::control {
namespace {

using Complex = std::complex<long double>;
constexpr long double kPiL = 3.14159265358979323846L;

/// CB's theorem as it is printed, in complex long double: the margin b − T/2/(1 − cos θ) Re{(1 − e^{−jθ}) H}.
long double margin(const HapticDisplay& d, const VirtualDamper& w, long double k, long double theta) {
  const Complex z = std::polar(1.0L, theta);
  const long double t = d.period_s, tau = w.filter_s;
  const Complex velocity = (1.0L - 1.0L / z) / (t + tau - tau / z);
  const Complex h =
      std::pow(z, -w.delay_samples) * (k + static_cast<long double>(w.damping_n_s_m) * velocity);
  return d.damping_n_s_m - t / 2 / (1 - std::cos(theta)) * ((1.0L - 1.0L / z) * h).real();
}
long double least_margin(const HapticDisplay& d, const VirtualDamper& w, long double k) {
  long double least = std::numeric_limits<long double>::infinity();
  for (int i = 1; i <= 20000; ++i) least = std::min(least, margin(d, w, k, kPiL * i / 20000));
  return least;
}

TEST(ZWidth, PassiveStiffnessIsWhereTheTheoremsMarginEnds) {
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> unit(0, 1);
  int found = 0;
  for (int i = 0; i < 60; ++i) {
    const HapticDisplay d{std::pow(10, -1 + 2 * unit(random)), 0.25, std::pow(10, -4 + 2 * unit(random))};
    const VirtualDamper w{d.damping_n_s_m * (2 * unit(random) - 1),
                          unit(random) < 0.5 ? 0.0 : 20 * unit(random) * d.period_s,
                          static_cast<int>(6 * unit(random) * unit(random))};
    const double k = passive_stiffness(d, w);
    if (std::isnan(k)) {
      EXPECT_LT(least_margin(d, w, 0), 1e-6 * d.damping_n_s_m);
      continue;
    }
    ++found;
    // A grid of 20 000 misses the minimum by some 1e-7 of b at most.
    EXPECT_GT(least_margin(d, w, 0.9999 * k), 0) << i;
    EXPECT_LT(least_margin(d, w, 1.0001 * k), 0) << i;
  }
  EXPECT_GT(found, 30);
}

TEST(ZWidth, ClosedFormsWhereTheyExist) {
  for (const double virtual_b : {-1.5, -0.3, 0.0, 0.4, 1.0, 1.9}) {
    for (const double tau : {0.0, 1e-4, 5.3e-3}) {
      const HapticDisplay d{2.0, 0.25, 1e-3};
      const VirtualDamper w{virtual_b, tau, 0};
      // 0.1 % is asked for; the refined grid is as good as rounding.
      EXPECT_NEAR(passive_stiffness(d, w), passive_stiffness_closed(d, w),
                  1e-6 * passive_stiffness_closed(d, w));
    }
  }
  for (const int delay : {0, 1, 3, 20}) {
    EXPECT_NEAR(passive_stiffness({2, 0.25, 1e-3}, {0, 0, delay}), 4000.0 / (1 + 2 * delay), 1e-5);
  }
  EXPECT_DOUBLE_EQ(passive_stiffness_closed({2, 0.25, 1e-3}, {1, 0, 0}), 2000);
  EXPECT_TRUE(std::isnan(passive_stiffness_closed({2, 0.25, 1e-3}, {1, 0, 2})));
  EXPECT_TRUE(std::isnan(passive_stiffness_closed({2, 0.25, 1e-3}, {2.5, 0, 0})));
  EXPECT_TRUE(std::isnan(passive_stiffness({2, 0.25, 1e-3}, {2.5, 0, 0})));
  EXPECT_TRUE(std::isnan(passive_stiffness({2, 0.25, 1e-3}, {-2.5, 0, 0})));
}

// No filter, no delay: K(θ) = bθ²/(2 s² T) + 2B cos θ/T, typed in by hand.
TEST(ZWidth, HeavyHandsWithoutFilterOrDelay) {
  const HapticDisplay d{2, 0.25, 1e-3};
  for (const double virtual_b : {-1.0, 0.0, 1.0, 2.5, 4.0}) {
    double least = 2 * (d.damping_n_s_m + virtual_b) / d.period_s;
    for (int i = 1; i <= 100000; ++i) {
      const double theta = M_PI * i / 100000;
      const double s = std::sin(theta / 2);
      least =
          std::min(least, (d.damping_n_s_m * theta * theta / (2 * s * s) + 2 * virtual_b * std::cos(theta)) /
                              d.period_s);
    }
    EXPECT_NEAR(heavy_hand_stiffness(d, {virtual_b, 0, 0}), least, 1e-6 * least) << virtual_b;
  }
  EXPECT_NEAR(heavy_hand_stiffness(d, {1, 0, 0}), 4809, 0.5);
  EXPECT_NEAR(heavy_hand_stiffness(d, {4, 0, 0}), 411.8, 0.1);
}

}  // namespace
}  // namespace telenano::control
