#include "telenano/nve_server/physics/surface/field_stencil.h"

#include <emmintrin.h>

#include "telenano/nve_server/physics/surface/field_stencil_kernel.h"

namespace telenano::physics {

const StencilKernel& avx_kernel() noexcept;  // field_stencil_avx.cpp

namespace {

struct Narrow {
  __m128d low, high;

  static Narrow load(const double* p) noexcept { return {_mm_loadu_pd(p), _mm_loadu_pd(p + 2)}; }
  static Narrow all(double a) noexcept { return {_mm_set1_pd(a), _mm_set1_pd(a)}; }
  static Narrow gather(const double* p, int step) noexcept {
    return {_mm_set_pd(p[step], p[0]), _mm_set_pd(p[3 * step], p[2 * step])};
  }
  void store(double* p) const noexcept {
    _mm_storeu_pd(p, low);
    _mm_storeu_pd(p + 2, high);
  }
  /// {1, 2, 3, 0}
  Narrow turned() const noexcept { return {_mm_shuffle_pd(low, high, 1), _mm_shuffle_pd(high, low, 1)}; }
  friend Narrow operator+(Narrow a, Narrow b) noexcept {
    return {_mm_add_pd(a.low, b.low), _mm_add_pd(a.high, b.high)};
  }
  friend Narrow operator-(Narrow a, Narrow b) noexcept {
    return {_mm_sub_pd(a.low, b.low), _mm_sub_pd(a.high, b.high)};
  }
  friend Narrow operator*(Narrow a, Narrow b) noexcept {
    return {_mm_mul_pd(a.low, b.low), _mm_mul_pd(a.high, b.high)};
  }
};

constexpr StencilKernel kNarrow{&one<Narrow>, &plain<Narrow>, &blend<Narrow>};

}  // namespace

const StencilKernel& narrow_kernel() noexcept {
  return kNarrow;
}

const StencilKernel* wide_kernel() noexcept {
  return __builtin_cpu_supports("avx") ? &avx_kernel() : nullptr;
}

const StencilKernel& stencil_kernel() noexcept {
  static const StencilKernel& chosen = wide_kernel() ? *wide_kernel() : kNarrow;
  return chosen;
}

}  // namespace telenano::physics
