#pragma once

#include <Eigen/Geometry>

#include "telenano/common/base/renew.h"
#include "telenano/common/base/vec3.h"

namespace telenano::physics {

/// Dry friction with an elastic part, by return mapping.
///
/// A bristle of stiffness k is carried by the motion, s_trial = s + Δs, and yields where its force would pass
/// the limit L: force = k s_trial, or L along s_trial. That is the gradient of the convex function (the
/// Moreau envelope of L|s|)
///   E(s_trial) = ½k s²          for k|s| <= L,     L|s| − L²/(2k)     beyond,
/// so that a step is a minimum and ΔE = Δ(½k s²) + L·slip: what slips is dissipated, never gained.
/// Units are those of the caller: nm, nN for sliding; radians, nN·nm for rolling and spinning.
/// Source    J. C. Simo, T. J. R. Hughes, Computational Inelasticity (1998) ch. 1; S. Luding, Granular Matter
///           10 (2008) 235 for the use in sliding, rolling and torsion.
struct Bristle {
  double stiffness = 0;
  double limit = 0;
  bool acts() const noexcept { return stiffness > 0.0 && limit > 0.0; }
};

struct BristleResponse {
  Vec3 force = Vec3::Zero();  ///< gradient of E: resists a motion along +Δs
  Vec3 deflection = Vec3::Zero();
  // The Hessian of E is stiffness (1 − along alongᵀ): a bristle that slips gives way along its force.
  double stiffness = 0;
  Vec3 along = Vec3::Zero();  ///< unit vector, 0 while nothing slips
  double size = 0;            ///< |force|
  double envelope = 0;        ///< E
  double stored = 0;          ///< ½k s² after the return
  double dissipated = 0;      ///< L·slip >= 0
  bool slips = false;

  /// Hessian of E.
  Mat3 tangent() const noexcept { return stiffness * (Mat3::Identity() - along * along.transpose()); }
};

inline void respond(const Bristle& bristle, const Vec3& trial, BristleResponse& out) noexcept {
  renew(out);
  if (!bristle.acts()) return;
  const double k = bristle.stiffness;
  const double length = trial.norm();
  if (k * length <= bristle.limit) {
    out.deflection = trial;
    out.force = k * trial;
    out.size = k * length;
    out.stored = out.envelope = 0.5 * k * length * length;
    out.stiffness = k;
    return;
  }
  const double reach = bristle.limit / k;
  out.slips = true;
  out.stiffness = bristle.limit / length;
  out.along = trial / length;
  out.deflection = reach * out.along;
  out.force = bristle.limit * out.along;
  out.size = bristle.limit;
  out.stored = 0.5 * bristle.limit * reach;
  out.dissipated = bristle.limit * (length - reach);
  out.envelope = out.stored + out.dissipated;
}

inline BristleResponse respond(const Bristle& bristle, const Vec3& trial) noexcept {
  BristleResponse out;
  respond(bristle, trial, out);
  return out;
}

/// The deflection that goes on when the stiffness changes between two steps: a stiffer bristle keeps its
/// force, a softer one its deflection. Both lose elastic energy, so that loading and unloading a contact that
/// leans sideways yields none (D. Elata, J. G. Berryman, Mech. Mater. 24 (1996) 229, on rules that do).
inline Vec3 carried_over(const Vec3& deflection, double stiffness_before, double stiffness) noexcept {
  if (!(stiffness > 0.0)) return Vec3::Zero();
  return stiffness > stiffness_before ? Vec3(deflection * (stiffness_before / stiffness)) : deflection;
}

/// A vector of the plane across `from`, turned with it into the plane across `to`, keeping its length.
inline Vec3 transported(const Vec3& vector, const Vec3& from, const Vec3& to) noexcept {
  // Rodrigues' formula for the smallest turn that takes one normal to the other.
  const double cosine = from.dot(to);
  if (!(cosine > -0.99)) return Vec3::Zero();
  const Vec3 axis = from.cross(to);
  const Vec3 once = axis.cross(vector);
  return vector + once + axis.cross(once) / (1.0 + cosine);
}

}  // namespace telenano::physics
