#include "telenano/common/base/det_math.h"

#include <emmintrin.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include "telenano/common/base/det_exp_lanes.h"

namespace telenano {
namespace {

// pi/2 in three parts of 33 bits each, so that n*part is exact for n < 2^20 (Cody & Waite, "Software Manual
// for the Elementary Functions", 1980; the splitting of fdlibm's e_rem_pio2.c).
constexpr double kPio2A = 1.57079632673412561417e+00;
constexpr double kPio2B = 6.07710050630396597660e-11;
constexpr double kPio2C = 2.02226624871116645580e-21;
constexpr double kPio2CTail = 8.47842766036889956997e-32;
constexpr double kTwoOverPi = 6.36619772367581382433e-01;
constexpr double kHalfPi = 1.57079632679489655800e+00;

constexpr int kMantissaBits = 52;
constexpr int kBias = 1023;
constexpr std::uint64_t kMantissa = (std::uint64_t{1} << kMantissaBits) - 1;
constexpr std::uint64_t kOne = std::uint64_t{kBias} << kMantissaBits;  // the exponent of [1, 2)

// Taylor series of sin and cos on [-pi/4, pi/4]; the first term left out is below 2^-55 of the result. `lo`
// is the part of the reduced argument that did not fit into `hi`.
double sin_kernel(double hi, double lo) noexcept {
  const double z = hi * hi;
  double p = -7.6471637318198164759e-13;
  p = p * z + 1.6059043836821614599e-10;
  p = p * z - 2.5052108385441718775e-08;
  p = p * z + 2.7557319223985890653e-06;
  p = p * z - 1.9841269841269841270e-04;
  p = p * z + 8.3333333333333333333e-03;
  p = p * z - 1.6666666666666666667e-01;
  return hi + (hi * z * p + lo * (1.0 - 0.5 * z));
}

double cos_kernel(double hi, double lo) noexcept {
  const double z = hi * hi;
  double p = 4.7794773323873852974e-14;
  p = p * z - 1.1470745597729724714e-11;
  p = p * z + 2.0876756987868098979e-09;
  p = p * z - 2.7557319223985890653e-07;
  p = p * z + 2.4801587301587301587e-05;
  p = p * z - 1.3888888888888888889e-03;
  p = p * z + 4.1666666666666666667e-02;
  const double half = 0.5 * z;
  const double w = 1.0 - half;
  return w + (((1.0 - w) - half) + (z * z * p - hi * lo));
}

}  // namespace

SinCos det_sin_cos(double x) noexcept {
  if (!(std::fabs(x) <= 1e6))
    return {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN()};
  const double n = std::floor(x * kTwoOverPi + 0.5);
  const double a = x - n * kPio2A;  // exact
  // The next two parts leave rounding errors; keep them (two-sum, Knuth).
  const double w = n * kPio2B;
  double hi = a - w;
  double lo = (a - hi) - w;
  const double w2 = n * kPio2C + n * kPio2CTail;
  const double hi2 = hi + (lo - w2);
  lo = (hi - hi2) + (lo - w2);
  hi = hi2;
  const double s = sin_kernel(hi, lo);
  const double c = cos_kernel(hi, lo);
  switch (static_cast<std::int64_t>(n) & 3) {
    case 0:
      return {s, c};
    case 1:
      return {c, -s};
    case 2:
      return {-s, -c};
    default:
      return {-c, s};
  }
}

namespace {

struct Two {
  static constexpr std::size_t kCount = 2;
  __m128d v;

  static Two load(const double* p) noexcept { return {_mm_loadu_pd(p)}; }
  static Two all(double a) noexcept { return {_mm_set1_pd(a)}; }
  void store(double* p) const noexcept { _mm_storeu_pd(p, v); }
  bool within(double most) const noexcept {
    return _mm_movemask_pd(_mm_cmple_pd(_mm_andnot_pd(_mm_set1_pd(-0.0), v), _mm_set1_pd(most))) == 0b11;
  }
  Two floor() const noexcept {
    const __m128d cut = _mm_cvtepi32_pd(_mm_cvttpd_epi32(v));
    return {_mm_sub_pd(cut, _mm_and_pd(_mm_cmpgt_pd(cut, v), _mm_set1_pd(1.0)))};
  }
  /// 2^n; each n a whole number whose power is normal.
  Two power_of_two() const noexcept {
    const __m128i biased = _mm_add_epi32(_mm_cvttpd_epi32(v), _mm_set1_epi32(kBias));  // above 0
    return {_mm_castsi128_pd(_mm_slli_epi64(_mm_unpacklo_epi32(biased, _mm_setzero_si128()), kMantissaBits))};
  }
  friend Two operator+(Two a, Two b) noexcept { return {_mm_add_pd(a.v, b.v)}; }
  friend Two operator-(Two a, Two b) noexcept { return {_mm_sub_pd(a.v, b.v)}; }
  friend Two operator*(Two a, Two b) noexcept { return {_mm_mul_pd(a.v, b.v)}; }
};

}  // namespace

double det_exp(double x) noexcept {
  if (std::isnan(x)) return x;
  if (x > 709.78) return std::numeric_limits<double>::infinity();
  if (x < -745.0) return 0.0;
  const double n = std::floor(x * kPerLn2 + 0.5);
  const double hi = x - n * kLn2Hi;
  const double r = hi - n * kLn2Lo;
  const double tail = (hi - r) - n * kLn2Lo;
  double p = kExpFirst;
  for (const double inverse : kExpNext) p = p * r + inverse;
  const double y = 1.0 + (r + (r * r * p + tail));
  const int k = static_cast<int>(n);
  if (k > -1020 && k < 1020) {  // y lies in (0.7, 1.5): exact
    return y * std::bit_cast<double>(static_cast<std::uint64_t>(1023 + k) << 52);
  }
  // Scale by 2^n in two steps so that subnormal results come out right.
  return std::ldexp(std::ldexp(y, k / 2), k - k / 2);
}

std::size_t exp_by_fours(const double* x, std::size_t count, double* exp) noexcept;  // det_exp_avx.cpp

void det_exp_each(const double* x, std::size_t count, double* exp) noexcept {
  static const bool fours = __builtin_cpu_supports("avx");
  std::size_t i = 0;
  while (i + 1 < count) {
    i += fours ? exp_by_fours(x + i, count - i, exp + i) : 0;
    i += exp_by_lanes<Two>(x + i, count - i, exp + i);
    // Where they stop, one is out of their range, or is the last.
    if (i < count) {
      exp[i] = det_exp(x[i]);
      ++i;
    }
  }
  if (i < count) exp[i] = det_exp(x[i]);
}

double det_log(double x) noexcept {
  if (std::isnan(x) || x < 0) return std::numeric_limits<double>::quiet_NaN();
  if (x == 0) return -std::numeric_limits<double>::infinity();
  if (std::isinf(x)) return x;
  double e = 0;
  if (x < std::numeric_limits<double>::min()) {  // subnormal: its exponent does not say how large it is
    x *= 0x1p54;
    e = -54;
  }
  // x = m 2^e, m in [1/sqrt 2, sqrt 2).
  const std::uint64_t bits = std::bit_cast<std::uint64_t>(x);
  double m = std::bit_cast<double>((bits & kMantissa) | kOne);
  e += static_cast<double>(static_cast<std::int64_t>(bits >> kMantissaBits) - kBias);
  if (m > 1.41421356237309504880) {
    m *= 0.5;
    e += 1;
  }
  // log m = 2 atanh(s), s = (m-1)/(m+1), |s| < 0.1716.
  const double f = m - 1.0;
  const double s = f / (2.0 + f);
  const double z = s * s;
  const double z2 = z * z;
  const double z4 = z2 * z2;
  // atanh(s)/s - 1 = z/3 + z^2/5 + ... + z^11/23, in pairs: a chain of eleven takes twice as long.
  const double p = z * (((1.0 / 3 + z * (1.0 / 5)) + z2 * (1.0 / 7 + z * (1.0 / 9))) +
                        z4 * (((1.0 / 11 + z * (1.0 / 13)) + z2 * (1.0 / 15 + z * (1.0 / 17))) +
                              z4 * ((1.0 / 19 + z * (1.0 / 21)) + z2 * (1.0 / 23))));
  constexpr double kLn2Hi = 6.93147180369123816490e-01;
  constexpr double kLn2Lo = 1.90821492927058770002e-10;
  // 2s = f - s f exactly, which keeps f's leading bits.
  const double correction = s * (2.0 * p - f);
  return e * kLn2Hi + (f + (correction + e * kLn2Lo));
}

double det_cbrt(double x) noexcept {
  if (x == 0 || !std::isfinite(x)) return x;
  double a = std::fabs(x);
  double scale = 1.0;
  if (a < std::numeric_limits<double>::min()) {  // subnormal
    a *= 0x1p54;
    scale = 0x1p-18;
  }
  // a = m 2^(3k), m in [1, 8).
  const std::uint64_t bits = std::bit_cast<std::uint64_t>(a);
  const auto exponent = static_cast<int>(bits >> kMantissaBits) - kBias + 3 * 400;  // > 0
  const int third = exponent / 3;
  const std::uint64_t rest = static_cast<std::uint64_t>(exponent - 3 * third);
  const double m = std::bit_cast<double>((bits & kMantissa) | (kOne + (rest << kMantissaBits)));
  const double power =
      std::bit_cast<double>(static_cast<std::uint64_t>(third - 400 + kBias) << kMantissaBits);
  const double inverse = 1.0 / m;
  // A parabola through the cube root at the Chebyshev nodes of each octave, within 9e-4 of it, then the
  // series of (1 - r)^(-1/3), r = 1 - y^3/m: what is left out, 0.14 r^4, is below 1e-11.
  constexpr double kStart[3][3] = {{0.62568722656414621, 0.43356059182365925, -0.05836172077613474},
                                   {0.78831650739851212, 0.27312605802175248, -0.01838279012848458},
                                   {0.99321656165099110, 0.17205863488820788, -0.00579021605966941}};
  const double* start = kStart[rest];
  double y = start[0] + m * (start[1] + m * start[2]);
  const double r = 1.0 - y * y * y * inverse;
  y += y * r * (1.0 / 3 + r * (2.0 / 9 + r * (14.0 / 81)));
  // With y rounded to 17 bits its cube is exact, and so is the difference from m, which is all that is left
  // to round: y (1 - s)^(-1/3), s = (m - y^3)/m below 3e-5.
  y = std::bit_cast<double>((std::bit_cast<std::uint64_t>(y) + (std::uint64_t{1} << 35)) &
                            ~((std::uint64_t{1} << 36) - 1));
  const double s = (m - y * y * y) * inverse;
  y += y * s * (1.0 / 3 + s * (2.0 / 9 + s * (14.0 / 81)));
  return std::copysign(y * power * scale, x);
}

double det_atan(double x) noexcept {
  if (std::isnan(x)) return x;
  const double a = std::fabs(x);
  // Reduce to |t| <= tan(pi/16) by the addition theorem, then Taylor.
  double base = 0;
  double base_lo = 0;
  double t = a;
  if (a > 2.41421356237309504880) {
    base = kHalfPi;
    base_lo = 6.12323399573676603587e-17;
    t = -1.0 / a;
  } else if (a > 0.41421356237309504880) {
    base = 7.85398163397448278999e-01;
    base_lo = 3.06161699786838301793e-17;
    t = (a - 1.0) / (a + 1.0);
  }
  double base2 = 0;
  if (std::fabs(t) > 0.19891236737965800691) {
    constexpr double kTanPio8 = 0.41421356237309504880;
    const double sign = std::copysign(1.0, t);
    t = (t - sign * kTanPio8) / (1.0 + sign * t * kTanPio8);
    base2 = sign * 0.39269908169872415481;
  }
  const double z = t * t;
  double p = 0;
  for (int k = 25; k >= 3; k -= 2) {
    const double term = 1.0 / k;
    p = (p + ((k / 2) % 2 == 0 ? term : -term)) * z;
  }
  const double y = base + (base2 + (t + (t * p + base_lo)));
  return std::copysign(y, x);
}

double det_acos(double x) noexcept {
  if (!(std::fabs(x) <= 1.0)) return std::numeric_limits<double>::quiet_NaN();
  // acos x = 2 atan sqrt((1-x)/(1+x)): well conditioned at both ends.
  if (x == -1.0) return 3.14159265358979311600;
  return 2.0 * det_atan(std::sqrt((1.0 - x) / (1.0 + x)));
}

}  // namespace telenano
