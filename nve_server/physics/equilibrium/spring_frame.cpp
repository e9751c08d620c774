#include "telenano/nve_server/physics/equilibrium/spring_frame.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace telenano::physics {
namespace {

constexpr double kRigid = 1e-12;  // of the greatest compliance

}  // namespace

void SpringFrame::make(const Compliance& c) noexcept {
  compliance_nm_nn = c;
  const Eigen::LLT<Mat3> llt(c);
  const double most = c.diagonal().maxCoeff();
  const Vec3 pivots = llt.matrixLLT().diagonal();
  if (most > 0.0 && llt.info() == Eigen::Success && pivots.minCoeff() * pivots.minCoeff() > kRigid * most) {
    rank = 3;
    basis_w = Mat3::Identity();
    const Mat3 inverse = c.inverse();
    stiffness_n_m = 0.5 * (inverse + inverse.transpose());
    return;
  }
  const Eigen::SelfAdjointEigenSolver<Mat3> eigen(c);  // values ascend
  rank = 0;
  stiffness_n_m = Mat3::Identity();
  for (int i = 2; i >= 0; --i) {
    const double value = eigen.eigenvalues()[i];
    basis_w.col(2 - i) = eigen.eigenvectors().col(i);
    if (!(most > 0.0 && value > kRigid * most)) continue;
    stiffness_n_m(2 - i, 2 - i) = 1.0 / value;
    rank = 3 - i;
  }
}

Vec3 SpringFrame::rigid_part(const Vec3& v) const noexcept {
  Vec3 y = basis_w.transpose() * v;
  for (int i = 0; i < 3; ++i) y[i] = i < rank ? 0.0 : y[i];
  return basis_w * y;
}

Vec3 SpringFrame::given_force(const Vec3& force) const noexcept {
  Vec3 f = basis_w.transpose() * force;
  clear_rigid(f);
  return f;
}

Vec3 SpringFrame::given_gradient(const Vec3& stretch, const Vec3& of_sample) const noexcept {
  Vec3 y = basis_w.transpose() * stretch;
  clear_rigid(y);
  Vec3 g = stiffness_n_m * y + basis_w.transpose() * of_sample;
  clear_rigid(g);
  return g;
}

Mat3 SpringFrame::given_hessian(const Mat3& of_sample) const noexcept {
  Mat3 h = stiffness_n_m + basis_w.transpose() * of_sample * basis_w;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      if (i >= rank || j >= rank) h(i, j) = i == j ? 1.0 : 0.0;
    }
  }
  return h;
}

double SpringFrame::energy_aj(const Vec3& stretch) const noexcept {
  if (rank == 3) return 0.5 * stretch.dot(stiffness_n_m * stretch);
  Vec3 y = basis_w.transpose() * stretch;
  clear_rigid(y);
  return 0.5 * y.dot(stiffness_n_m * y);
}

Vec3 SpringFrame::force_nn(const Vec3& stretch, const Vec3& of_sample) const noexcept {
  Vec3 pull = basis_w.transpose() * stretch;
  clear_rigid(pull);
  Vec3 f = basis_w.transpose() * of_sample;
  const Vec3 held = stiffness_n_m * pull;
  for (int i = 0; i < 3; ++i) f[i] = i < rank ? held[i] : f[i];
  return basis_w * f;
}

// ∇²E ∂p = K ∂x along the springs, where they are rigid ∂p = ∂x: in the frame K − the Hessian's rigid
// columns.
Mat3 SpringFrame::given(const Mat3& of_sample) const noexcept {
  Mat3 given = Mat3::Zero();
  const Mat3 u = basis_w.transpose() * of_sample * basis_w;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      if (i >= rank) {
        given(i, j) = i == j ? 1.0 : 0.0;
      } else {
        given(i, j) = j < rank ? stiffness_n_m(i, j) : -u(i, j);
      }
    }
  }
  return given;
}

}  // namespace telenano::physics
