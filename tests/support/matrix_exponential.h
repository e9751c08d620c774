#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

/// For hands that are integrated exactly, independently of the product's own plant. `Matrix`: a square
/// std::array of std::array<long double, N>.
namespace telenano::support {

template <class Matrix>
Matrix product(const Matrix& a, const Matrix& b) {
  Matrix result{};
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < a.size(); ++k) {
      if (a[i][k] == 0) continue;
      for (std::size_t j = 0; j < a.size(); ++j) result[i][j] += a[i][k] * b[k][j];
    }
  }
  return result;
}

/// e^(A h): Taylor's series of A h/2ˢ with norm at most 1/8, 18 terms (remainder below 1e-30), squared s
/// times.
template <class Matrix>
Matrix exponential(const Matrix& a, long double h) {
  long double norm = 0;
  for (const auto& row : a) {
    long double sum = 0;
    for (const long double x : row) sum += std::fabs(x * h);
    norm = std::max(norm, sum);
  }
  int squarings = 0;
  for (; norm > 0.125L; norm /= 2, h /= 2) ++squarings;
  Matrix term{}, sum{};
  for (std::size_t i = 0; i < a.size(); ++i) term[i][i] = sum[i][i] = 1;
  for (int n = 1; n <= 18; ++n) {
    term = product(term, a);
    for (std::size_t i = 0; i < a.size(); ++i) {
      for (std::size_t j = 0; j < a.size(); ++j) {
        term[i][j] *= h / n;
        sum[i][j] += term[i][j];
      }
    }
  }
  for (; squarings > 0; --squarings) sum = product(sum, sum);
  return sum;
}

}  // namespace telenano::support
