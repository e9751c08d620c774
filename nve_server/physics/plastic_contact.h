#pragma once

#include "nve_server/physics/flow_family.h"
#include "nve_server/physics/tip_sample_law.h"

namespace telenano::physics {

/// What flowed in one step: the surface at the foot is lower by `depth` afterwards and its effective radius
/// is `radius`. Nothing else remembers the flow.
struct PlasticFlow {
  double depth_nm = 0;           ///< 0: the step was elastic
  double radius_nm = 0;          ///< R_eff there now
  double contact_radius_nm = 0;  ///< of the contact that flowed: the crater's rim
  double dissipated_aj = 0;      ///< in the flow, >= 0; also part of the equilibrium's
};

struct PlasticStep {
  Equilibrium equilibrium;  ///< overlap against the surface as it was before the step
  PlasticFlow flow;
};

/// Contact that yields at a hardness H, around any elastic law of sphere on flat with K and R.
///
/// Yield. A contact of radius a on a sphere of R_eff flows where the apparent (Hertz) mean pressure reaches
/// the hardness while the tip is pressed,
///
///   K a/(π R_eff) > H  and  F > 0.
///
/// With adhesion a is larger than Hertz's, so that at no load at all the contact may flow (Maugis, Pollock,
/// Acta Metall. 32:1323, 1984). Under a net pull it does not: the rule would give energy there (see below).
///
/// Flow. The residual surface is again locally a sphere, lower by δ_p and of radius R_p, such that the
/// largest plastic contact radius a* is just elastic on it (Thornton, J. Appl. Mech. 64:383, 1997):
///
///   R_p(a*) = K a*/(πH) = a*/ε,  ε = πH/K,    a_v = ε R (first yield),
///   dδ_p/da* = 2 a*/R − ε    (a* >= a_v: outside the crater the tip goes on cutting the surface of radius R,
///                             a*² = R δ; at the rim the elastic overlap is a*²/R_p = ε a*),
///   dδ_p/da* = ε             (a* < a_v: a ridge sharper than the origin is flattened, first yield ever on).
///
/// F = law(δ − δ_p, R_p). Without adhesion this is Thornton's line F = F_y + πHR(δ − δ_y) = πH a*², unloading
/// as Hertz on R_p to the residual depth δ_p = a*²/R − ε a*.
///
/// Memory. R_p says a*, so that height and effective radius of the surface at the foot are the whole state: a
/// lowered surface flows again exactly when K a/(πR_eff) > H. Besides only the radius R before any mark
/// (`origin`) is needed, to know how a* grows: two steps through the same a* add up to one, whatever their
/// size, δ_p being a function of a*.
///
/// Dissipation. At held base, flow by da* loses D da* with
///   D = F dδ_p/da* − ∂U/∂R_p dR_p/da*.
/// Hertz (∂U/∂R = K a⁵/5R³): D = F (2a*/R − 1.2 ε) >= 0.8 ε F at a* >= a_v. JKR (s = ⅔√(6πwa/K) the adhesive
/// part of the overlap, x = a*/a_v): D = K a ε (a ε (2x − 1.2) − s (3x − 2)), positive up to s = ⅔ aε = where
/// F = 0 and somewhat beyond, not for every pull: hence F > 0 in the yield rule. DMT is above Hertz. The
/// state during flow depends on a* alone, not on the spring, so that what a finite step dissipates is
///   ∫ F dδ along that line − (U_end − U_onset),
/// taken by Gauss–Lobatto quadrature (4 points on pieces of a* ratio <= 1.5). Then the work on the base is
/// Δ(U + ½cF²) + dissipated to about 1e-7 of the work, and never more is given back than was put in.
///
/// Units nm, nN, GPa, aJ. Limits: no work-hardening, no pile-up pressure, no difference between H and the
/// pressure of first yield (1.1 Y against 3 Y). Soft and sticky samples: without load, flow by adhesion alone
/// ends where the adhesive radius (6πwR_p²/K)^⅓ is ε R_p, at R_p = 6πw/(Kε³); where that is many R (polymers
/// of low hardness) the law's adhesion on the flattened place is overestimated, and the depth with it. a*/R
/// beyond 0.5 is formal, as the half-space is. R_p stops at kMostRadii origins: there flow goes on at the
/// force reached, without hardening.
class PlasticContact {
 public:
  static constexpr double kMostRadii = 1e4;

  /// Throws UserError unless the hardness is positive and finite.
  PlasticContact(const TipSampleLaw& law, double hardness_gpa);

  /// As TipSampleLaw::advance, with flow. `radius_nm` is the effective radius of the surface as it is,
  /// `origin_radius_nm` what it was before any mark. The state afterwards is that on the surface **with** the
  /// flow: whoever keeps it must also lower the surface (or give flow.radius and a base less by flow.depth in
  /// the next step). The stiffness of a step that flowed is that of further loading (Hertz, πHR). No
  /// allocation; unless the status is kOk, there is no force and the state is left.
  PlasticStep advance(double base_overlap_nm, double compliance_nm_nn, double radius_nm,
                      double origin_radius_nm, TipSampleState& state) const noexcept;

  /// Largest contact radius that is elastic at this effective radius.
  double yield_radius_nm(double radius_nm) const noexcept { return strain_ * radius_nm; }
  /// δ_p between two effective radii that flow passed through.
  double depth_nm(double from_radius_nm, double to_radius_nm, double origin_radius_nm) const noexcept;
  double hardness_gpa() const noexcept { return hardness_gpa_; }
  double strain() const noexcept { return strain_; }  ///< ε = πH/K
  const TipSampleLaw& law() const noexcept { return law_; }

 private:
  struct LineState;
  LineState on_line(double a_star_nm, const FlowFamily& family, double adhesive_nm,
                    TipSampleState& state) const noexcept;
  double dissipation(double from_nm, double to_nm, const FlowFamily& family, const Equilibrium& end,
                     const TipSampleState& state) const noexcept;

  TipSampleLaw law_;
  double hardness_gpa_;
  double strain_;  // ε = πH/K
};

}  // namespace telenano::physics
