#pragma once

// det_exp() of several at once, for a vector V of V::kCount doubles. Included by one file for each V, which is compiled for what V
// needs: the functions are the file's own, so that no code for one processor is linked where another's is called.

#include <cstddef>

namespace telenano {
namespace {

// x = n ln2 + r, ln2 in two parts, the first with 32 trailing zero bits.
constexpr double kLn2Hi = 6.93147180369123816490e-01;
constexpr double kLn2Lo = 1.90821492927058770002e-10;
constexpr double kPerLn2 = 1.44269504088896338700;
constexpr double kExpFirst = 1.0 / 6227020800.0;
constexpr double kExpNext[] = {1.0 / 479001600.0,
                               1.0 / 39916800.0,
                               1.0 / 3628800.0,
                               1.0 / 362880.0,
                               1.0 / 40320.0,
                               1.0 / 5040.0,
                               1.0 / 720.0,
                               1.0 / 120.0,
                               1.0 / 24.0,
                               1.0 / 6.0,
                               0.5};
constexpr double kMostInLanes = 700;  // on both sides of 0: the power of two is a normal number

template <class V>
inline V exp_of(V x) noexcept {
  const V n = (x * V::all(kPerLn2) + V::all(0.5)).floor();
  const V low = n * V::all(kLn2Lo);
  const V hi = x - n * V::all(kLn2Hi);
  const V r = hi - low;
  const V tail = (hi - r) - low;
  V p = V::all(kExpFirst);
  for (const double inverse : kExpNext) p = p * r + V::all(inverse);
  return (V::all(1.0) + (r + (r * r * p + tail))) * n.power_of_two();
}

/// Whole vectors, as long as all in them are within the range: how many numbers that were.
template <class V>
inline std::size_t exp_by_lanes(const double* x, std::size_t count, double* exp) noexcept {
  std::size_t i = 0;
  for (; i + V::kCount <= count; i += V::kCount) {
    const V at = V::load(x + i);
    if (!at.within(kMostInLanes)) break;
    exp_of(at).store(exp + i);
  }
  return i;
}

}  // namespace
}  // namespace telenano
