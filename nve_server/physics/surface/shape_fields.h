#pragma once

#include "telenano/nve_server/physics/surface/contact_fields.h"
#include "telenano/nve_server/physics/surface/plane_surface.h"
#include "telenano/nve_server/physics/surface/softening.h"
#include "telenano/nve_server/physics/surface/sphere_surface.h"

/// Shapes whose ground is known in closed form, as fields of the apex (frame W, nm).
namespace telenano::physics {

/// The plane z = z₀ + s·(x, y): δ = n_z (z₀ + s·(x, y) − z) + R (1 − n_z), ρ = ln R; exact, at every
/// softening. Level: both slopes 0.
class PlaneFields final : public ContactFields {
 public:
  /// As PlaneSurface: slopes at most PlaneSurface::kMaxSlope, radius positive, all finite; UserError.
  PlaneFields(const PlaneSurface::Shape& shape, double tip_radius_nm);

  void contact_at(const Vec3& apex_w_nm, ContactJet& jet) const noexcept override;
  void growing_at(const Vec3& apex_w_nm, const SofteningRule& rule, ContactJet& jet) const noexcept override;
  void at_softening(const Vec3& apex_w_nm, double softening_nm, ContactJet& jet) const noexcept override;

 private:
  Vec3 slope_;  // ∂δ/∂apex = −n
  double offset_;
  double log_radius_;
};

/// A ball on a plate (sphere_surface.h). Each of the two feet has its exact overlap,
///   ball: δ_b = R + r − |e|, e = apex + R e_z − middle, ρ_b = ln(R r/(R + r));  plate: δ_p = −z, ρ_p = ln R,
/// and they add as e^{−gap/t} does, gaps taken along the normals: with p_i ~ R_i e^{δ_i/t},
///   δ = Σ p_i δ_i,  R_eff = Σ R_i e^{(δ_i − δ)/t}
/// — one foot alone where the other is some t farther away, twice the radius where two equal ones touch,
/// smooth at the crease. t grows with the distance from touch as in softening.h, v0 there being −δ at the
/// finest t.
class SphereFields final : public ContactFields {
 public:
  /// As SphereSurface; UserError.
  SphereFields(const SphereSurface::Shape& shape, double tip_radius_nm, const SofteningRule& rule);

  void contact_at(const Vec3& apex_w_nm, ContactJet& jet) const noexcept override;
  void growing_at(const Vec3& apex_w_nm, const SofteningRule& rule, ContactJet& jet) const noexcept override;
  void at_softening(const Vec3& apex_w_nm, double softening_nm, ContactJet& jet) const noexcept override;

 private:
  struct Feet;
  Feet feet(const Vec3& apex_w_nm) const noexcept;

  SofteningRule rule_;
  double tip_radius_, reach_;  // reach: of the two centres at touch
  Vec3 middle_;
  double log_ball_, log_plate_;
};

}  // namespace telenano::physics
