#pragma once

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/equilibrium/tip_solution.h"
#include "telenano/nve_server/physics/numerics/small_matrix.h"

namespace telenano::physics {

/// The springs of a balance in coordinates in which they give: all three, or fewer where they are rigid.
/// There K is the inverse of their compliance; rows and columns of rigid directions are those of the unit
/// matrix, so that nothing moves along them.
struct SpringFrame {
  Compliance compliance_nm_nn = Compliance::Constant(-1.0);  ///< what the rest was made for
  int rank = 0;
  Mat3 basis_w = Mat3::Identity();        ///< columns; the first `rank` are the directions that give
  Mat3 stiffness_n_m = Mat3::Identity();  ///< in the basis; only its first rows and columns mean anything

  /// Finite; directions softer than 1e-12 of the softest one are taken to be rigid.
  void make(const Compliance& compliance_nm_nn) noexcept;

  /// The part of v along rigid directions.
  Vec3 rigid_part(const Vec3& v) const noexcept;
  void clear_rigid(Vec3& y) const noexcept {
    for (int i = 0; i < 3; ++i) y[i] = i < rank ? y[i] : 0.0;
  }
  Vec3 to_world(const Vec3& y) const noexcept { return rank == 3 ? y : Vec3(basis_w * y); }
  Vec3 to_frame(const Vec3& force_w_nn) const noexcept {
    return rank == 3 ? force_w_nn : given_force(force_w_nn);
  }

  /// Gradient and Hessian in the frame of ½ s·K s + U at the stretch s = apex − free end.
  Vec3 gradient(const Vec3& stretch_w_nm, const Vec3& of_sample_nn) const noexcept {
    return rank == 3 ? Vec3(stiffness_n_m * stretch_w_nm + of_sample_nn)
                     : given_gradient(stretch_w_nm, of_sample_nn);
  }
  Mat3 hessian(const Mat3& of_sample_n_m) const noexcept {
    return rank == 3 ? Mat3(stiffness_n_m + of_sample_n_m) : given_hessian(of_sample_n_m);
  }
  double energy_aj(const Vec3& stretch_w_nm) const noexcept;
  /// The springs' force on the tip; in rigid directions the one that holds against `of_sample_nn`.
  Vec3 force_nn(const Vec3& stretch_w_nm, const Vec3& of_sample_nn) const noexcept;
  /// ∂apex/∂(free end) of a balance, from the inverse of its Hessian in the frame.
  Mat3 follow(const Mat3& of_sample_n_m, const Mat3& inverse) const noexcept {
    if (rank == 3) return times(inverse, stiffness_n_m);
    return basis_w * times(inverse, given(of_sample_n_m)) * basis_w.transpose();
  }

 private:
  // Where some directions are rigid.
  Vec3 given_force(const Vec3& force_w_nn) const noexcept;
  Vec3 given_gradient(const Vec3& stretch_w_nm, const Vec3& of_sample_nn) const noexcept;
  Mat3 given_hessian(const Mat3& of_sample_n_m) const noexcept;
  Mat3 given(const Mat3& of_sample_n_m) const noexcept;
};

}  // namespace telenano::physics
