#include "tests/studies/fidelity/lagged_products.h"

#include <emmintrin.h>

#include <algorithm>
#include <cmath>

namespace telenano::studies::fidelity {
namespace {

constexpr std::ptrdiff_t kLags = 8;  // that are summed side by side
constexpr std::ptrdiff_t kRows =
    512;  // that all lags read before the next ones are read: they stay in the cache

double plain(const TouchTrace& trace, std::ptrdiff_t lag) {
  const auto n = static_cast<std::ptrdiff_t>(trace.rows.size());
  const auto at_row = [&](std::ptrdiff_t i) -> const TouchTrace::Row& {
    return trace.rows[static_cast<std::size_t>(i)];
  };
  double both = 0;
  for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(0, lag); k < std::min(n, n + lag); ++k)
    both += at_row(k).felt_h_n.dot(at_row(k - lag).true_h_n);
  return both;
}

struct Forces {
  explicit Forces(std::ptrdiff_t rows) {
    for (auto& axis : of_axis) axis.resize(static_cast<std::size_t>(rows), 0.0);
  }
  void put(std::ptrdiff_t row, const Vec3& force_h_n) {
    for (int axis = 0; axis < 3; ++axis) of_axis[axis][static_cast<std::size_t>(row)] = force_h_n[axis];
    is_lateral = is_lateral || force_h_n.x() != 0 || force_h_n.y() != 0;
    is_finite = is_finite && telenano::is_finite(force_h_n);
  }
  const double* axis(int which, std::ptrdiff_t row) const { return of_axis[which].data() + row; }

  std::vector<double> of_axis[3];
  bool is_lateral = false;
  bool is_finite = true;
};

/// Adds the rows from `from` to `to` to the sums of eight lags. `true_row`: beside row `from`, of the largest lag,
/// which comes first. The order within a row is that of Vec3::dot: (x + y) + z.
template <bool kLateral>
void add_rows(const Forces& felt, const Forces& real, std::ptrdiff_t from, std::ptrdiff_t to,
              std::ptrdiff_t true_row, double* sums) noexcept {
  const double *const x = felt.axis(0, 0), *const y = felt.axis(1, 0), *const z = felt.axis(2, 0);
  const double *true_x = real.axis(0, true_row), *true_y = real.axis(1, true_row),
               *true_z = real.axis(2, true_row);
  __m128d sum[kLags / 2];
  for (std::ptrdiff_t i = 0; i < kLags / 2; ++i) sum[i] = _mm_loadu_pd(sums + 2 * i);
  for (std::ptrdiff_t k = from; k < to; ++k, ++true_x, ++true_y, ++true_z) {
    // Nothing is felt most of the time; ±0 changes no sum that began with +0.
    if (z[k] == 0 && (!kLateral || (x[k] == 0 && y[k] == 0))) continue;
    const __m128d felt_z = _mm_set1_pd(z[k]);
    for (std::ptrdiff_t i = 0; i < kLags / 2; ++i) {
      __m128d product = _mm_mul_pd(felt_z, _mm_loadu_pd(true_z + 2 * i));
      if constexpr (kLateral) {
        const __m128d lateral = _mm_add_pd(_mm_mul_pd(_mm_set1_pd(x[k]), _mm_loadu_pd(true_x + 2 * i)),
                                           _mm_mul_pd(_mm_set1_pd(y[k]), _mm_loadu_pd(true_y + 2 * i)));
        product = _mm_add_pd(lateral, product);
      }
      sum[i] = _mm_add_pd(sum[i], product);
    }
  }
  for (std::ptrdiff_t i = 0; i < kLags / 2; ++i) _mm_storeu_pd(sums + 2 * i, sum[i]);
}

}  // namespace

std::vector<double> lagged_products(const TouchTrace& trace, std::ptrdiff_t ahead, std::ptrdiff_t reach) {
  const auto n = static_cast<std::ptrdiff_t>(trace.rows.size());
  const std::ptrdiff_t lags = ahead + reach + 1;
  const std::ptrdiff_t blocks = (lags + kLags - 1) / kLags;
  // True forces between zeros on both sides: a row that only one of them has adds ±0.
  const std::ptrdiff_t before = reach, after = ahead + kLags;
  Forces felt(n), real(before + n + after);
  for (std::ptrdiff_t k = 0; k < n; ++k) {
    const TouchTrace::Row& row = trace.rows[static_cast<std::size_t>(k)];
    felt.put(k, row.felt_h_n);
    real.put(before + k, row.true_h_n);
  }
  std::vector<double> products(static_cast<std::size_t>(blocks * kLags), 0.0);
  if (felt.is_finite && real.is_finite) {
    // From the largest lag down, so that true rows stand in rising order.
    for (std::ptrdiff_t from = 0; from < n; from += kRows) {
      const std::ptrdiff_t to = std::min(n, from + kRows);
      for (std::ptrdiff_t block = 0; block < blocks; ++block) {
        const std::ptrdiff_t true_row = before + from - reach + kLags * block;
        double* const sums = products.data() + kLags * block;
        felt.is_lateral&& real.is_lateral ? add_rows<true>(felt, real, from, to, true_row, sums)
                                          : add_rows<false>(felt, real, from, to, true_row, sums);
      }
    }
    products.resize(static_cast<std::size_t>(lags));
    std::reverse(products.begin(), products.end());
    return products;
  }
  // 0·∞ is not 0.
  products.resize(static_cast<std::size_t>(lags));
  for (std::ptrdiff_t i = 0; i < lags; ++i) products[static_cast<std::size_t>(i)] = plain(trace, i - ahead);
  return products;
}

}  // namespace telenano::studies::fidelity
