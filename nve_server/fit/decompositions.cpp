#include "telenano/nve_server/fit/decompositions.h"

#include <Eigen/Dense>

namespace telenano::fit {

Matrix solve_of_any_rank(const Matrix& a, const Matrix& b) {
  return a.completeOrthogonalDecomposition().solve(b);
}

Matrix pseudo_inverse(const Matrix& a) {
  return solve_of_any_rank(a, Matrix::Identity(a.rows(), a.rows()));
}

Vector solve_symmetric(const Matrix& a, const Vector& b, Vector* pivots) {
  const Eigen::LDLT<Matrix> solver(a);
  if (pivots != nullptr) *pivots = solver.vectorD();
  return solver.solve(b);
}

std::optional<EigenPair> greatest_eigen_pair(const Matrix& symmetric) {
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(symmetric);  // values ascend
  if (solver.info() != Eigen::Success) return std::nullopt;
  const Eigen::Index last = symmetric.rows() - 1;
  return EigenPair{solver.eigenvalues()[last], solver.eigenvectors().col(last)};
}

}  // namespace telenano::fit
