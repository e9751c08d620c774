// Compiled for AVX (CMakeLists.txt), and called only where the processor has it: nothing in here may be an inline function that other
// files have too. In a section of its own, as the stencils of fields are.
#include <immintrin.h>

#include "telenano/common/base/det_exp_lanes.h"

namespace telenano {

std::size_t exp_by_fours(const double* x, std::size_t count, double* exp) noexcept;

namespace {

struct Four {
  static constexpr std::size_t kCount = 4;
  __m256d v;

  static Four load(const double* p) noexcept { return {_mm256_loadu_pd(p)}; }
  static Four all(double a) noexcept { return {_mm256_set1_pd(a)}; }
  void store(double* p) const noexcept { _mm256_storeu_pd(p, v); }
  bool within(double most) const noexcept {
    const __m256d size = _mm256_andnot_pd(_mm256_set1_pd(-0.0), v);
    return _mm256_movemask_pd(_mm256_cmp_pd(size, _mm256_set1_pd(most), _CMP_LE_OQ)) == 0b1111;
  }
  Four floor() const noexcept { return {_mm256_floor_pd(v)}; }
  /// 2^n; each n a whole number whose power is normal. Whole numbers of four lanes are AVX2's: two by two.
  Four power_of_two() const noexcept {
    const __m128i biased = _mm_add_epi32(_mm256_cvttpd_epi32(v), _mm_set1_epi32(1023));
    const __m128i low = _mm_slli_epi64(_mm_unpacklo_epi32(biased, _mm_setzero_si128()), 52);
    const __m128i high = _mm_slli_epi64(_mm_unpackhi_epi32(biased, _mm_setzero_si128()), 52);
    return {_mm256_castsi256_pd(_mm256_insertf128_si256(_mm256_castsi128_si256(low), high, 1))};
  }
  friend Four operator+(Four a, Four b) noexcept { return {_mm256_add_pd(a.v, b.v)}; }
  friend Four operator-(Four a, Four b) noexcept { return {_mm256_sub_pd(a.v, b.v)}; }
  friend Four operator*(Four a, Four b) noexcept { return {_mm256_mul_pd(a.v, b.v)}; }
};

}  // namespace

__attribute__((section("dispatched_avx"), flatten)) std::size_t exp_by_fours(const double* x,
                                                                             std::size_t count,
                                                                             double* exp) noexcept {
  return exp_by_lanes<Four>(x, count, exp);
}

}  // namespace telenano
