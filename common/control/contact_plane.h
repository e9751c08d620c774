#pragma once

#include <cstdint>

#include "telenano/common/base/vec3.h"
#include "telenano/common/control/scaling.h"

namespace telenano::control {

/// What the slave's port is like around the tip, as the slave says it: an adhesive spring along the normal
/// and a bristle across it, in terms of the port's **commanded** position x (coupling, probe and contact in
/// series), frame W.
///
///   depth δ = (point − x)·normal;  in touch f = stiffness·δ along the normal, for δ > −adhesion/stiffness;
///   shear: f_t = −shear_stiffness·q, |f_t| ≤ friction, q the bristle's extension.
///
/// Potential in touch U = ½ k δ² − F_ad²/(2k), apart U = 0: letting go at δ = −F_ad/k costs nothing, touching
/// at any δ between ±F_ad/k gives energy away, as a tip that snaps into contact does.
struct ContactPlane {
  std::uint32_t version = 0;  ///< 0 = none
  Vec3 point_w_nm = Vec3::Zero();
  Vec3 normal_w = Vec3::UnitZ();  ///< unit, out of the sample
  double stiffness_n_m = 0;       ///< ≥ 0
  double adhesion_nn = 0;         ///< ≥ 0
  double shear_stiffness_n_m = 0;
  double friction_nn = 0;

  /// Depth of `commanded_w_nm`, and in `slope_w` its gradient, turned round: the direction of the force. The
  /// plane is taken at its word up to kTrustNm beside its point, and as level with W's plane beyond: its
  /// tilt, carried on for as far as a hand moves in a long round trip, would be a cliff that is not there.
  double depth_nm(const Vec3& commanded_w_nm, Vec3& slope_w) const noexcept;
  double depth_nm(const Vec3& commanded_w_nm) const noexcept {
    Vec3 slope_w;
    return depth_nm(commanded_w_nm, slope_w);
  }

  static constexpr double kTrustNm = 2;
};

inline double ContactPlane::depth_nm(const Vec3& commanded_w_nm, Vec3& slope_w) const noexcept {
  slope_w = normal_w;
  Vec3 beside = commanded_w_nm - point_w_nm;
  const double up = beside.z();
  beside.z() = 0;
  const double far = beside.norm();
  if (far > kTrustNm) {
    const Vec3 along = beside / far;
    Vec3 tilt(normal_w.x(), normal_w.y(), 0);
    tilt = (tilt - along * along.dot(tilt)) * (kTrustNm / far);
    slope_w = Vec3(tilt.x(), tilt.y(), normal_w.z());
    beside = along * kTrustNm;
  }
  return -(normal_w.x() * beside.x() + normal_w.y() * beside.y() + normal_w.z() * up);
}

}  // namespace telenano::control
