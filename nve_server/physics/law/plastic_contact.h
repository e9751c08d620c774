#pragma once

#include "telenano/nve_server/physics/contact/flow_family.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"

namespace telenano::physics {

/// What flowed in one step: the surface at the contact is lower by `depth` afterwards and its effective
/// radius is `radius`. Nothing else remembers the flow.
struct PlasticFlow {
  double depth_nm = 0;           ///< 0: the step was elastic
  double radius_nm = 0;          ///< R_eff there now
  double contact_radius_nm = 0;  ///< a*, of the plastic contact: the crater's rim
  double dissipated_aj = 0;      ///< in the flow, >= 0; also part of the equilibrium's
};

struct PlasticStep {
  Equilibrium equilibrium;  ///< overlap against the surface as it was before the step
  PlasticFlow flow;
};

/// Contact that yields at a hardness H, around any elastic law of sphere on flat with K and R.
///
/// Flow. The residual surface is again locally a sphere, lower by δ_p and of radius R_p, such that the
/// largest plastic contact radius a* is just elastic on it (Thornton, J. Appl. Mech. 64:383, 1997):
///
///   R_p(a*) = K a*/(πH) = a*/ε,  ε = πH/K,    a_v = ε R (first yield),
///   dδ_p/da* = 2 a*/R − ε    (a* >= a_v: outside the crater the tip goes on cutting the surface of radius R,
///                             a*² = R δ; at the rim the elastic overlap is a*²/R_p = ε a*),
///   dδ_p/da* = ε             (a* < a_v: a ridge sharper than the origin is flattened, first yield ever on).
///
/// Yield. A surface of radius R_p(a*) flows where load and adhesion together reach the hardness over the
/// plastic contact area (Maugis, Pollock, Acta Metall. 32:1323, 1984, their fully plastic contact),
///
///   F > Y(a*) = max(0, πH a*² − L),   L = 2πwR  (0 for Hertz, which has no adhesion),
///
/// with R of the **origin**: what pulls beside the plastic contact is the gap to the surface as it was. (The
/// elastic law adheres by R_p, as it must on unloading. With its pull in the yield rule, each flow, by
/// raising R_p, would bring the next: a sticky polymer then sinks by many radii without load.) A net pull
/// never flows: the rule would give energy there.
///
/// F = law(δ − δ_p, R_p). Without adhesion this is Thornton's line F = F_y + πHR(δ − δ_y) = πH a*², unloading
/// as Hertz on R_p to the residual depth δ_p = a*²/R − ε a*.
///
/// Adhesion alone, at no load, flows to Y = 0: a₀ = √(2wR/H), nothing if that is below a_v, else by
///   δ_p = (a₀ − a_v)² /R + ε(a₀ − a_v) = 2w/H − ε a₀ < 2w/H,
/// some 1 nm on polymers under silicon, nothing on oxides; zero_load_depth_nm() tells.
///
/// Memory. R_p says a*, so that height and effective radius of the surface there are the whole state.
/// Besides only the radius R before any mark (`origin`) is needed, to know how a* grows: two steps through
/// the same a* add up to one, whatever their size, δ_p being a function of a*.
///
/// Dissipation. At held base, flow by da* loses D da* with
///   D = F dδ_p/da* − ∂U/∂R_p dR_p/da*.
/// Let f = F/(πHa*²), so that 0 <= f <= 1, y = a/a* and x = max(1, a*/a_v). For JKR, where U_E = ¾K(δ²a −
/// ⅔δa³/R + a⁵/5R²) at given a, and F = (3K/2)(aδ − a³/3R):
///   D/(ε²Ka*²) = f (2x − 1 − y²/3) + (2/15) y⁵ > 0   (by f <= 1; at y² > 3 the last term outweighs the
///   first),
/// which for y = f = 1 is Hertz, 2x − 1.2; for DMT f (2x − 1 − y²) + ⅘ y⁵ > 0 as y³ >= f. The state during
/// flow depends on a* alone, not on the spring, so that what a finite step dissipates is
///   ∫ F dδ along that line − (U_end − U_onset),
/// F = Y known, the overlaps by Gauss–Lobatto nodes (4 points on pieces of a* ratio <= 1.5; 2 for a piece
/// shorter than 1.002). Then the work on the base is Δ(U + ½cF²) + dissipated to about 1e-7 of the work, and
/// never more is given back than was put in.
///
/// Units nm, nN, GPa, aJ. Limits: no work-hardening, no pile-up pressure, no difference between H and the
/// pressure of first yield (1.1 Y against 3 Y); adhesion that has not the form 2πwR (capillary) presses
/// through the elastic law only, not through Y. a*/R beyond 0.5 is formal, as the half-space is. R_p stops at
/// kMostRadii origins: there flow goes on at the force reached, without hardening.
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

  /// a* of a surface of this effective radius.
  double yield_radius_nm(double radius_nm) const noexcept { return strain_ * radius_nm; }
  /// δ_p between two effective radii that flow passed through.
  double depth_nm(double from_radius_nm, double to_radius_nm, double origin_radius_nm) const noexcept;
  /// Y: the force beyond which a surface of this effective radius flows, nN.
  double yield_force_nn(double radius_nm, double origin_radius_nm) const noexcept {
    return yield_force_at(strain_ * radius_nm, origin_radius_nm);
  }
  /// By how much adhesion alone, at no load, marks a surface that was never marked. 0: not at all.
  double zero_load_depth_nm(double origin_radius_nm) const noexcept;
  double hardness_gpa() const noexcept { return hardness_gpa_; }
  double strain() const noexcept { return strain_; }  ///< ε = πH/K
  const TipSampleLaw& law() const noexcept { return law_; }

 private:
  struct LineState;
  double yield_force_at(double a_star_nm, double origin_nm) const noexcept;
  LineState on_line(double a_star_nm, const FlowFamily& family, double start_nm,
                    TipSampleState& state) const noexcept;
  double dissipation(double from_nm, double to_nm, const FlowFamily& family, const Equilibrium& end,
                     const TipSampleState& state) const noexcept;

  TipSampleLaw law_;
  double hardness_gpa_;
  double strain_;               // ε = πH/K
  double adhesion_per_nm_ = 0;  // L/R
};

}  // namespace telenano::physics
