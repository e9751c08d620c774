#include "telenano/common/base/det_math.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

namespace telenano {
namespace {

// Oracle: glibc's functions on long double (64-bit mantissa), rounded. Our kernels leave out terms below
// 2^-55 and round three or four times, so 2 ulp of the result is what the derivation promises.
double ulps(double got, long double want) {
  const double rounded = static_cast<double>(want);
  const double ulp =
      std::nextafter(std::fabs(rounded), std::numeric_limits<double>::infinity()) - std::fabs(rounded);
  return static_cast<double>(std::fabs(static_cast<long double>(got) - want) / ulp);
}

TEST(DetMath, AgreesWithLongDoubleWithinTwoUlps) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> angle(-20, 20), first(0, 1.5707963), exponent(-700, 700),
      unit(-1, 1);
  double worst_trig = 0, worst_first = 0, worst_exp = 0, worst_log = 0, worst_cbrt = 0, worst_acos = 0,
         worst_atan = 0;
  for (int i = 0; i < 200000; ++i) {
    const double a = angle(random), b = first(random), e = exponent(random), u = unit(random);
    const SinCos r = det_sin_cos(a), q = det_sin_cos(b);
    worst_trig = std::max({worst_trig, ulps(r.sin, std::sin(static_cast<long double>(a))),
                           ulps(r.cos, std::cos(static_cast<long double>(a)))});
    worst_first = std::max({worst_first, ulps(q.sin, std::sin(static_cast<long double>(b))),
                            ulps(q.cos, std::cos(static_cast<long double>(b)))});
    worst_exp = std::max(worst_exp, ulps(det_exp(e), std::exp(static_cast<long double>(e))));
    const double x = std::exp(e / 2);
    worst_log = std::max(worst_log, ulps(det_log(x), std::log(static_cast<long double>(x))));
    worst_cbrt = std::max(worst_cbrt, ulps(det_cbrt(x), std::cbrt(static_cast<long double>(x))));
    worst_acos = std::max(worst_acos, ulps(det_acos(u), std::acos(static_cast<long double>(u))));
    worst_atan = std::max(worst_atan, ulps(det_atan(a), std::atan(static_cast<long double>(a))));
  }
  EXPECT_LT(worst_trig, 2);
  EXPECT_LT(worst_first, 2);
  EXPECT_LT(worst_exp, 2);
  EXPECT_LT(worst_log, 2);
  EXPECT_LT(worst_cbrt, 2);
  EXPECT_LT(worst_acos, 3);
  EXPECT_LT(worst_atan, 2);
}

TEST(DetMath, Corners) {
  EXPECT_EQ(det_sin_cos(0.0).sin, 0.0);
  EXPECT_EQ(det_sin_cos(0.0).cos, 1.0);
  EXPECT_TRUE(std::isnan(det_sin_cos(std::numeric_limits<double>::infinity()).sin));
  EXPECT_EQ(det_exp(0.0), 1.0);
  EXPECT_EQ(det_exp(-1e9), 0.0);
  EXPECT_TRUE(std::isinf(det_exp(1e9)));
  EXPECT_EQ(det_log(1.0), 0.0);
  EXPECT_TRUE(std::isnan(det_log(-1.0)));
  EXPECT_DOUBLE_EQ(det_cbrt(27.0), 3.0);
  EXPECT_DOUBLE_EQ(det_cbrt(-8.0), -2.0);
  EXPECT_EQ(det_acos(1.0), 0.0);
  EXPECT_TRUE(std::isnan(det_acos(1.5)));
}

// det_exp() one by one is the oracle; it has its own above.
TEST(DetMath, SeveralExponentialsHaveTheBitsOfEach) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  std::mt19937_64 random(8);
  std::vector<double> x{0.0,    -0.0,   1e-300,    700.0,      -700.0,
                        700.1,  -700.1, 709.9,     -745.5,     1e9,
                        -720.0, 0.5,    kInfinity, -kInfinity, -1e300,
                        3.0,    2.0,    1.0,       -1.0,       std::numeric_limits<double>::quiet_NaN()};
  const std::size_t corners = x.size();
  std::uniform_real_distribution<double> near(-3, 3), far(-700, 700);
  for (int i = 0; i < 20001; ++i) x.push_back(i % 2 == 0 ? near(random) : far(random));
  // Multiples of ln 2 / 2: where one power of two becomes the next.
  for (int n = -2000; n <= 2000; ++n) x.push_back(0.34657359027997264 * n);
  // The corners in each of four lanes, and what is left over at the end.
  for (const std::size_t first : {std::size_t{0}, std::size_t{1}, std::size_t{2}, std::size_t{3}, corners}) {
    const std::vector<double> from(x.begin() + static_cast<std::ptrdiff_t>(first), x.end());
    std::vector<double> exp(from);
    det_exp_each(exp.data(), exp.size(), exp.data());
    for (std::size_t i = 0; i < from.size(); ++i) {
      if (std::isnan(from[i])) {
        EXPECT_TRUE(std::isnan(exp[i]));
      } else {
        ASSERT_EQ(std::bit_cast<std::uint64_t>(exp[i]), std::bit_cast<std::uint64_t>(det_exp(from[i])))
            << from[i];
      }
    }
  }
}

}  // namespace
}  // namespace telenano
