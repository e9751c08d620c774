#pragma once

#include <Eigen/Core>

namespace telenano::physics {

/// L D Lᵀ = A of a symmetric 9 × 9 matrix, whose lower triangle it reads, and A x = b by it. Without roots, and with one division
/// a column: on x86-64 one division takes the time of some ten products, and Eigen::LLT's size that is not known to the compiler
/// three times the instructions.
/// Source  G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed., section 4.1.2.
class CholeskyNine {
 public:
  static constexpr int kSize = 9;
  using Vec9 = Eigen::Matrix<double, kSize, 1>;
  using Mat9 = Eigen::Matrix<double, kSize, kSize>;

  /// False: A is not positive definite, or no number.
  bool compute(const Mat9& a) noexcept {
#pragma GCC unroll 9
    for (int i = 0; i < kSize; ++i) {
      double products[kSize];  // l_ij d_j
      double d = a(i, i);
#pragma GCC unroll 9
      for (int j = 0; j < i; ++j) {
        double rest = a(i, j);
#pragma GCC unroll 9
        for (int k = 0; k < j; ++k) rest -= products[k] * l_[j][k];
        products[j] = rest;
        l_[i][j] = rest * inverse_[j];
        d -= rest * l_[i][j];
      }
      if (!(d > 0.0)) return false;
      inverse_[i] = 1.0 / d;
    }
    return true;
  }

  Vec9 solve(const Vec9& b) const noexcept {
    double x[kSize];
#pragma GCC unroll 9
    for (int i = 0; i < kSize; ++i) {
      double rest = b[i];
#pragma GCC unroll 9
      for (int j = 0; j < i; ++j) rest -= l_[i][j] * x[j];
      x[i] = rest;
    }
    Vec9 out;
#pragma GCC unroll 9
    for (int i = kSize - 1; i >= 0; --i) {
      double rest = x[i] * inverse_[i];
#pragma GCC unroll 9
      for (int j = i + 1; j < kSize; ++j) rest -= l_[j][i] * out[j];
      out[i] = rest;
    }
    return out;
  }

 private:
  double l_[kSize][kSize];  // below the diagonal
  double inverse_[kSize];   // of D
};

}  // namespace telenano::physics
