#include "telenano/common/base/det_math.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

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

}  // namespace
}  // namespace telenano
