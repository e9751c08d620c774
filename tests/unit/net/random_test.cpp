#include "telenano/common/base/random.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

namespace telenano {
namespace {

TEST(Random, IsSplitmixAndXoshiroAsPublished) {
  // splitmix64 from state 0, and xoshiro256++ from state 1, 2, 3, 4 by hand: rotl(1 + 4, 23) + 1.
  std::uint64_t state = 0;
  EXPECT_EQ(Random::splitmix64(state), 0xe220a8397b1dcdafull);
  EXPECT_EQ(Random::splitmix64(state), 0x6e789e6aa1b965f4ull);
}

TEST(Random, RepeatsWithItsSeedOnly) {
  Random a(1);
  Random b(1);
  Random c(2);
  int equal = 0;
  for (int i = 0; i < 1000; ++i) {
    const auto x = a.bits();
    EXPECT_EQ(x, b.bits());
    equal += x == c.bits() ? 1 : 0;
  }
  EXPECT_EQ(equal, 0);
}

TEST(Random, HasTheMomentsOfItsDistributions) {
  // One million draws: the standard error of a mean is sigma/1000; five of them are allowed.
  Random random(42);
  constexpr int kN = 1'000'000;
  double mean = 0, square = 0, e_mean = 0, e_square = 0, u_mean = 0, fourth = 0;
  for (int i = 0; i < kN; ++i) {
    const double n = random.normal();
    mean += n / kN;
    square += n * n / kN;
    fourth += n * n * n * n / kN;
    const double e = random.exponential();
    ASSERT_GE(e, 0);
    e_mean += e / kN;
    e_square += e * e / kN;
    const double u = random.uniform();
    ASSERT_GE(u, 0);
    ASSERT_LT(u, 1);
    u_mean += u / kN;
  }
  EXPECT_NEAR(mean, 0, 5e-3);
  EXPECT_NEAR(square, 1, 5e-3 * std::sqrt(2.0));
  EXPECT_NEAR(fourth, 3, 5e-3 * std::sqrt(96.0));
  EXPECT_NEAR(e_mean, 1, 5e-3);
  EXPECT_NEAR(e_square, 2, 5e-3 * std::sqrt(20.0));
  EXPECT_NEAR(u_mean, 0.5, 5e-3 * std::sqrt(1.0 / 12));
}

TEST(Random, BelowCoversItsRangeEvenly) {
  Random random(3);
  std::array<int, 7> count{};
  for (int i = 0; i < 700'000; ++i) ++count[random.below(7)];
  for (const int c : count) EXPECT_NEAR(c, 100'000, 5 * std::sqrt(100'000.0));
}

}  // namespace
}  // namespace telenano
