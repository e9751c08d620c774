#pragma once

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/surface/softening.h"

namespace telenano::physics {

/// What a force law needs of the ground under the tip's apex (x, y, z) in W, nm, with exact derivatives in
/// all three: a potential U(δ, ρ) of them has the force −∇U and the stiffness ∇∇U by the chain rule alone.
struct ContactJet {
  /// δ, how deep the tip is pressed in along the normal of the ground under it; negative is a gap.
  double overlap_nm = 0;
  Vec3 overlap_grad = Vec3::Zero();
  Mat3 overlap_hess_per_nm = Mat3::Zero();
  /// ρ = ln(R_eff / 1 nm), the radius that the force law is given.
  double log_radius = 0;
  Vec3 log_radius_grad_per_nm = Vec3::Zero();
  Mat3 log_radius_hess_per_nm2 = Mat3::Zero();
};

/// Seam: the ground as fields of the apex, C¹ with second derivatives that are continuous but for where a
/// scan's blend of softenings changes levels. Closed forms and scans implement it.
class ContactFields {
 public:
  virtual ~ContactFields() = default;

  /// With the softening that grows with the distance from touch: for contact and van der Waals. No
  /// allocation, no throw.
  virtual void contact_at(const Vec3& apex_w_nm, ContactJet& jet) const noexcept = 0;
  /// With a softening that grows with the distance from touch by another rule, but is never finer than the
  /// fields' own: for a term whose range is another one.
  virtual void growing_at(const Vec3& apex_w_nm, const SofteningRule& rule,
                          ContactJet& jet) const noexcept = 0;
  /// With a fixed softening length (nm, > 0; kept within what the fields hold): for a term of another range.
  virtual void at_softening(const Vec3& apex_w_nm, double softening_nm, ContactJet& jet) const noexcept = 0;
  /// Of that overlap and ρ alone.
  virtual void values_at_softening(const Vec3& apex_w_nm, double softening_nm, double& overlap_nm,
                                   double& log_radius) const noexcept {
    ContactJet jet;
    at_softening(apex_w_nm, softening_nm, jet);
    overlap_nm = jet.overlap_nm;
    log_radius = jet.log_radius;
  }
};

}  // namespace telenano::physics
