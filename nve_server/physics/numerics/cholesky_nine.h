#pragma once

#include <Eigen/Core>
#include <cmath>

namespace telenano::physics {

/// L Lᵀ = A of a symmetric 9 × 9 matrix, whose lower triangle it reads, and A x = b by it. The sums are taken in the order of
/// Eigen::LLT with two doubles a register, so that the bits are the same; with sizes that the compiler knows it takes a third of
/// the instructions.
class CholeskyNine {
 public:
  static constexpr int kSize = 9;
  using Vec9 = Eigen::Matrix<double, kSize, 1>;
  using Mat9 = Eigen::Matrix<double, kSize, kSize>;

  /// False: A is not positive definite.
  bool compute(const Mat9& a) noexcept {
#pragma GCC unroll 9
    for (int k = 0; k < kSize; ++k) {
      double x = a(k, k);
      if (k > 0) {
        double squares = l_[k][0] * l_[k][0];
#pragma GCC unroll 9
        for (int j = 1; j < k; ++j) squares += l_[k][j] * l_[k][j];
        x -= squares;
      }
      if (x <= 0.0) return false;
      l_[k][k] = x = std::sqrt(x);
#pragma GCC unroll 9
      for (int i = k + 1; i < kSize; ++i) {
        double rest = a(i, k);
        if (k > 0) {
          double sum = l_[i][0] * l_[k][0];
          if (k < kSize - 2) sum += 0.0;  // a sum that begins with 0 is never -0
#pragma GCC unroll 9
          for (int j = 1; j < k; ++j) sum += l_[i][j] * l_[k][j];
          rest -= sum;
        }
        l_[i][k] = rest / x;
      }
    }
    return true;
  }

  Vec9 solve(const Vec9& b) const noexcept {
    double x[kSize];
    for (int i = 0; i < kSize; ++i) x[i] = b[i];
    constexpr int kLast = kSize - 1;
    // L y = b: eight columns one after the other, then the last row.
#pragma GCC unroll 9
    for (int k = 0; k < kLast; ++k) {
      if (x[k] == 0.0) continue;
      x[k] /= l_[k][k];
#pragma GCC unroll 9
      for (int i = k + 1; i < kLast; ++i) x[i] -= x[k] * l_[i][k];
    }
    double last = 0.0;
#pragma GCC unroll 9
    for (int j = 0; j < kLast; ++j) last += l_[kLast][j] * x[j];
    x[kLast] -= last;
    if (x[kLast] != 0.0) x[kLast] /= l_[kLast][kLast];
    // Lᵀ x = y: eight rows from the end, then the first.
    if (x[kLast] != 0.0) x[kLast] /= l_[kLast][kLast];
#pragma GCC unroll 9
    for (int k = 1; k < kLast; ++k) {
      const int i = kLast - k;
      double term[kLast];
#pragma GCC unroll 9
      for (int t = 0; t < k; ++t) term[t] = l_[i + 1 + t][i] * x[i + 1 + t];
      x[i] -= sum_by_pairs(term, k);
      if (x[i] != 0.0) x[i] /= l_[i][i];
    }
    double odd = 0.0, even = 0.0;
#pragma GCC unroll 9
    for (int j = 1; j < kSize; j += 2) {
      odd += l_[j][0] * x[j];
      even += l_[j + 1][0] * x[j + 1];
    }
    x[0] -= odd + even;
    if (x[0] != 0.0) x[0] /= l_[0][0];
    Vec9 out;
    for (int i = 0; i < kSize; ++i) out[i] = x[i];
    return out;
  }

 private:
  /// Two pairs at once, then what is left of pairs, then what is left.
  static double sum_by_pairs(const double* term, int count) noexcept {
    if (count < 2) return term[0];
    double first = term[0], second = term[1];
    if (count >= 4) {
      first += term[2];
      second += term[3];
    }
    if (count >= 6) {
      first += term[4];
      second += term[5];
    }
    const double sum = first + second;
    return count % 2 != 0 ? sum + term[count - 1] : sum;
  }

  double l_[kSize][kSize] = {};
};

}  // namespace telenano::physics
