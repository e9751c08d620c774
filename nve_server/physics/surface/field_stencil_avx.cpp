// Compiled for AVX (CMakeLists.txt), and called only where the processor has it: nothing in here may be an
// inline function that other files have too. In a section of its own, as Dilation::sum_four is.
#include <immintrin.h>

#include "telenano/nve_server/physics/surface/field_stencil_kernel.h"

namespace telenano::physics {

const StencilKernel& avx_kernel() noexcept;

namespace {

struct Wide {
  __m256d v;

  static Wide load(const double* p) noexcept { return {_mm256_loadu_pd(p)}; }
  static Wide all(double a) noexcept { return {_mm256_set1_pd(a)}; }
  static Wide gather(const double* p, int step) noexcept {
    return {_mm256_set_pd(p[3 * step], p[2 * step], p[step], p[0])};
  }
  void store(double* p) const noexcept { _mm256_storeu_pd(p, v); }
  /// {1, 2, 3, 0}
  Wide turned() const noexcept { return {_mm256_shuffle_pd(v, _mm256_permute2f128_pd(v, v, 1), 0b0101)}; }
  friend Wide operator+(Wide a, Wide b) noexcept { return {_mm256_add_pd(a.v, b.v)}; }
  friend Wide operator-(Wide a, Wide b) noexcept { return {_mm256_sub_pd(a.v, b.v)}; }
  friend Wide operator*(Wide a, Wide b) noexcept { return {_mm256_mul_pd(a.v, b.v)}; }
};

#define TELENANO_AVX __attribute__((section("dispatched_avx"), flatten))

TELENANO_AVX void wide_one(const double* corner, std::ptrdiff_t stride, int lanes, const CubicWeights& x,
                           const CubicWeights& y, double (&jet)[6]) noexcept {
  one<Wide>(corner, stride, lanes, x, y, jet);
}
TELENANO_AVX void wide_plain(const StencilLevel& level, FieldRows& rows) noexcept {
  plain<Wide>(level, rows);
}
TELENANO_AVX void wide_blend(const StencilLevel* levels, int count, const double (&finest)[6],
                             FieldRows& rows) noexcept {
  blend<Wide>(levels, count, finest, rows);
}

constexpr StencilKernel kWide{&wide_one, &wide_plain, &wide_blend};

}  // namespace

const StencilKernel& avx_kernel() noexcept {
  return kWide;
}

}  // namespace telenano::physics
