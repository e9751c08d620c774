#include "tests/studies/stress/binomial_bounds.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace telenano::studies::stress {
namespace {

/// Probabilities of 0…n hits, trial by trial: no factorials, no logarithms.
std::vector<long double> exact_probabilities(std::size_t n, long double p) {
  std::vector<long double> of(n + 1, 0.0L);
  of[0] = 1;
  for (std::size_t trial = 1; trial <= n; ++trial) {
    for (std::size_t k = trial; k > 0; --k) of[k] = of[k] * (1 - p) + of[k - 1] * p;
    of[0] *= 1 - p;
  }
  return of;
}

long double sum(const std::vector<long double>& of, std::size_t from, std::size_t to) {
  long double all = 0;
  for (std::size_t k = from; k <= to; ++k) all += of[k];
  return all;
}

TEST(BinomialBounds, TheTailsAreWhatTheyShouldBeByExactSums) {
  for (const std::size_t n : {1u, 2u, 3u, 7u, 20u, 100u, 400u}) {
    const std::size_t step = n > 20 ? 13 : 1;
    for (const double confidence : {0.9, 0.95, 0.975, 0.999}) {
      for (std::size_t k = 0; k <= n; k += step) {
        if (k < n) {
          const double upper = binomial_upper(k, n, confidence);
          EXPECT_NEAR(static_cast<double>(sum(exact_probabilities(n, upper), 0, k)), 1 - confidence, 1e-11)
              << k << " of " << n;
        }
        if (k > 0) {
          const double lower = binomial_lower(k, n, confidence);
          EXPECT_NEAR(static_cast<double>(sum(exact_probabilities(n, lower), k, n)), 1 - confidence, 1e-11)
              << k << " of " << n;
        }
      }
    }
  }
}

TEST(BinomialBounds, HoldTheTruthAsOftenAsTheySayWhateverItIs) {
  constexpr std::size_t kTrials = 20;
  for (double p = 0.01; p < 1; p += 0.01) {
    const std::vector<long double> of = exact_probabilities(kTrials, p);
    long double below_upper = 0, above_lower = 0;
    for (std::size_t k = 0; k <= kTrials; ++k) {
      if (p <= binomial_upper(k, kTrials, 0.95)) below_upper += of[k];
      if (p >= binomial_lower(k, kTrials, 0.95)) above_lower += of[k];
    }
    EXPECT_GE(static_cast<double>(below_upper), 0.95 - 1e-12) << p;
    EXPECT_GE(static_cast<double>(above_lower), 0.95 - 1e-12) << p;
  }
}

TEST(BinomialBounds, EndsAndManyTrials) {
  EXPECT_EQ(binomial_upper(0, 0, 0.95), 1);
  EXPECT_EQ(binomial_lower(0, 0, 0.95), 0);
  EXPECT_EQ(binomial_upper(5, 5, 0.95), 1);
  EXPECT_EQ(binomial_lower(0, 5, 0.95), 0);
  // None among N: (1 − p)^N = 0.05, in closed form; all of N: its mirror image.
  for (const std::size_t n : {1u, 10u, 980u, 30000u, 1000000u}) {
    const double exact = -std::expm1(std::log(0.05) / static_cast<double>(n));
    EXPECT_NEAR(binomial_upper(0, n, 0.95), exact, 1e-10 * exact) << n;
    EXPECT_NEAR(binomial_lower(n, n, 0.95), 1 - exact, 1e-12) << n;
  }
  // Many hits among many: the terms at 0 hits are far below a double. By the normal approximation.
  const double half = binomial_upper(15000, 30000, 0.975);
  EXPECT_NEAR(half - 0.5, 1.959964 * 0.5 / std::sqrt(30000.0), 5e-5);
}

}  // namespace
}  // namespace telenano::studies::stress
