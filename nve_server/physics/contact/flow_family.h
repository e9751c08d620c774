#pragma once

#include <emmintrin.h>

#include <algorithm>
#include <cmath>

namespace telenano::physics {

/// Residual surfaces that one contact flows through (plastic_contact.h): radius R_p = a*/ε and depth δ_p over
/// the largest plastic contact radius a*, from a place whose radius before any mark was R:
///
///   dδ_p/da* = ε up to a_v = ε R,   2 a*/R − ε beyond it;   R_p stops where a* = last.
struct FlowFamily {
  double strain;     ///< ε = πH/K
  double origin_nm;  ///< R
  double first_nm;   ///< a_v
  double last_nm;

  FlowFamily(double strain_, double origin_radius_nm, double last_a_nm) noexcept
      : strain(strain_),
        origin_nm(origin_radius_nm),
        first_nm(strain_ * origin_radius_nm),
        last_nm(last_a_nm) {}

  double radius_nm(double a_nm) const noexcept { return std::min(a_nm, last_nm) / strain; }
  double elastic_nm(double a_nm) const noexcept {
    return std::min(a_nm, last_nm);
  }  ///< largest a without flow
  /// δ_p(to) − δ_p(from), factored so that a small step does not cancel.
  double depth_nm(double from_nm, double to_nm) const noexcept {
    double depth = 0.0;
    if (from_nm < first_nm) {
      const double end = std::min(to_nm, first_nm);
      depth += strain * (end - from_nm);
      from_nm = end;
    }
    if (to_nm > from_nm) depth += (to_nm - from_nm) * ((to_nm + from_nm) / origin_nm - strain);
    return depth;
  }
  /// Its inverse: a* after a further depth >= 0.
  double after_nm(double from_nm, double depth_nm) const noexcept {
    if (from_nm < first_nm) {
      const double room = strain * (first_nm - from_nm);
      if (depth_nm <= room) return from_nm + depth_nm / strain;
      depth_nm -= room;
      from_nm = first_nm;
    }
    // (b − a)((b + a)/R − ε) = depth, the greater root.
    const double c = from_nm * (from_nm / origin_nm - strain) + depth_nm;
    return std::max(from_nm, 0.5 * origin_nm * (strain + std::sqrt(strain * strain + 4.0 * c / origin_nm)));
  }
};

/// after_nm(), then elastic_nm(), of two places of one material at once, with the bits of FlowFamily.
inline __m128d elastic_after_two_nm(double strain_, __m128d origin_nm, double last_nm, __m128d from_nm,
                                    __m128d depth_nm) noexcept {
  const __m128d strain = _mm_set1_pd(strain_);
  const auto choose = [](__m128d which, __m128d yes, __m128d no) {
    return _mm_or_pd(_mm_and_pd(which, yes), _mm_andnot_pd(which, no));
  };
  const __m128d first = _mm_mul_pd(strain, origin_nm);
  const __m128d below = _mm_cmplt_pd(from_nm, first);
  const __m128d room = _mm_mul_pd(strain, _mm_sub_pd(first, from_nm));
  const __m128d stays = _mm_and_pd(below, _mm_cmple_pd(depth_nm, room));
  const __m128d stayed = _mm_add_pd(from_nm, _mm_div_pd(depth_nm, strain));
  const __m128d depth = choose(below, _mm_sub_pd(depth_nm, room), depth_nm);
  const __m128d from = choose(below, first, from_nm);
  const __m128d c = _mm_add_pd(_mm_mul_pd(from, _mm_sub_pd(_mm_div_pd(from, origin_nm), strain)), depth);
  const __m128d square =
      _mm_add_pd(_mm_mul_pd(strain, strain), _mm_div_pd(_mm_mul_pd(_mm_set1_pd(4.0), c), origin_nm));
  const __m128d root =
      _mm_mul_pd(_mm_mul_pd(_mm_set1_pd(0.5), origin_nm), _mm_add_pd(strain, _mm_sqrt_pd(square)));
  const __m128d after = choose(stays, stayed, _mm_max_pd(root, from));  // as std::max(from, root)
  return _mm_min_pd(_mm_set1_pd(last_nm), after);                       // as std::min(after, last)
}

}  // namespace telenano::physics
