#pragma once

#include <cstdint>

#include "common/base/vec3.h"
#include "common/control/scaling.h"

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
struct ContactModel {
  std::uint32_t version = 0;  ///< 0 = none
  Vec3 point_w_nm = Vec3::Zero();
  Vec3 normal_w = Vec3::UnitZ();  ///< unit, out of the sample
  double stiffness_n_m = 0;       ///< ≥ 0
  double adhesion_nn = 0;         ///< ≥ 0
  double shear_stiffness_n_m = 0;
  double friction_nn = 0;

  double depth_nm(const Vec3& commanded_w_nm) const noexcept {
    return normal_w.dot(point_w_nm - commanded_w_nm);
  }
};

}  // namespace telenano::control
