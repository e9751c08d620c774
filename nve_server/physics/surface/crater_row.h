#pragma once

#include <emmintrin.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/contact/flow_family.h"
#include "telenano/nve_server/physics/numerics/log_one_plus.h"
#include "telenano/nve_server/physics/surface/coefficient_words.h"

namespace telenano::physics {

/// Some coefficients in a row of a crater: by how much H falls and ρ rises. What one of them takes waits for
/// itself (roots, divisions, a series); in loops of a few operations each several are under way at once.
struct CraterRow {
  static constexpr int kMost = 64;
  static_assert(kMost % 2 == 0);
  int count = 0;
  int column[kMost];
  double level[kMost], fall[kMost], rise[kMost];

  void add(int i, double level_, double fall_) noexcept {
    column[count] = i;
    level[count] = level_;
    fall[count] = fall_;
    ++count;
  }

  void rise_by_level(double log_radius_rise) noexcept {
    for (int k = 0; k < count; ++k) rise[k] = level[k] * log_radius_rise;
  }

  /// By the flow's own law at the depth that the coefficient falls: `own` and `made` begin with the row's.
  void rise_by_flow(const double* own, const double* made, std::size_t lanes, double strain,
                    double last_a) noexcept {
    double origin[kMost], old[kMost], cosine[kMost], more[kMost];
    for (int k = 0; k < count; ++k) {
      const std::size_t at = static_cast<std::size_t>(column[k]) * lanes;
      origin[k] = made[at + 1];
      old[k] = own[at + 1];
      cosine[k] = own[at + 2];
    }
    // Level ground has one radius before any mark.
    bool alike = true;
    for (int k = 1; k < count; ++k) alike &= origin[k] == origin[0];
    if (alike && count > 0) {
      std::fill_n(origin, count, det_exp(origin[0]));
    } else {
      det_exp_each(origin, static_cast<std::size_t>(count), origin);
    }
    det_exp_each(old, static_cast<std::size_t>(count), old);
    for (int k = 0; k < count; ++k) old[k] *= strain;
    if (count % 2 != 0) {  // the last goes with one that is thrown away
      origin[count] = old[count] = cosine[count] = 1.0;
      fall[count] = 0.0;
    }
    for (int k = 0; k < count; k += 2) {
      const __m128d before = _mm_loadu_pd(old + k), falls = _mm_loadu_pd(fall + k);
      const __m128d after = elastic_after_two_nm(strain, _mm_loadu_pd(origin + k), last_a, before,
                                                 _mm_mul_pd(falls, _mm_loadu_pd(cosine + k)));
      // Where it rises, or does not fall at all, the radius stays.
      const __m128d grows = _mm_and_pd(_mm_cmpgt_pd(falls, _mm_setzero_pd()), _mm_cmpgt_pd(after, before));
      _mm_storeu_pd(more + k, _mm_and_pd(grows, _mm_sub_pd(_mm_div_pd(after, before), _mm_set1_pd(1.0))));
    }
    log_one_plus(more, count, rise);
  }
};

/// Raises `count` coefficients in a row by height · level, those of a level above 0, keeps their words, and tells by how much
/// these have grown. Their number of lanes is a constant, so that nothing is looked up for each.
template <int kLanesEach, bool kTwoLevels>
std::uint64_t raise_row(double* at, std::uint64_t* words, std::size_t number, const double* level, int count,
                        double height) noexcept {
  std::uint64_t change = 0;
  for (int i = 0; i < count; ++i, ++number, at += kLanesEach) {
    if (!(level[i] > 0.0)) continue;
    const double rise = height * level[i];
    at[0] += rise;
    if constexpr (kTwoLevels) at[3] += rise;
    const std::uint64_t word = word_of(number, at, kTwoLevels);
    change += word - words[number];
    words[number] = word;
  }
  return change;
}

/// The same for what falls in a crater, with ρ rising.
template <int kLanesEach, bool kTwoLevels>
std::uint64_t lower_row(double* line, std::uint64_t* words, std::size_t first, const CraterRow& part,
                        int from, int to) noexcept {
  std::uint64_t change = 0;
  for (int k = from; k < to; ++k) {
    const auto i = static_cast<std::size_t>(part.column[k]);
    double* const at = line + i * kLanesEach;
    at[0] -= part.fall[k];
    at[1] += part.rise[k];
    if constexpr (kTwoLevels) {
      at[3] -= part.fall[k];
      at[4] += part.rise[k];
    }
    const std::uint64_t word = word_of(first + i, at, kTwoLevels);
    change += word - words[first + i];
    words[first + i] = word;
  }
  return change;
}

}  // namespace telenano::physics
