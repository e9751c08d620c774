#pragma once

#include <Eigen/Core>
#include <optional>

namespace telenano::fit {

using Vector = Eigen::VectorXd;
using Matrix = Eigen::MatrixXd;

// Eigen's decompositions of matrices of any size. They are dear to compile: here once for all of this folder.

/// The X of least |A X − B|, and of those the smallest, for A of any shape and rank: complete orthogonal decomposition.
Matrix solve_of_any_rank(const Matrix& a, const Matrix& b);
Matrix pseudo_inverse(const Matrix& a);

/// A x = b for a symmetric A: LDLᵀ. `pivots` gets D unless it is null.
Vector solve_symmetric(const Matrix& a, const Vector& b, Vector* pivots = nullptr);

struct EigenPair {
  double value = 0;
  Vector direction;
};
/// Of the greatest eigenvalue of a symmetric matrix; nothing if they are not found.
std::optional<EigenPair> greatest_eigen_pair(const Matrix& symmetric);

}  // namespace telenano::fit
