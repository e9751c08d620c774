#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "telenano/nve_server/physics/potential/bridge_potential.h"
#include "telenano/nve_server/physics/potential/far_term.h"
#include "telenano/nve_server/physics/potential/potential_jet.h"
#include "telenano/nve_server/physics/surface/softening.h"

namespace telenano::physics {

/// The square of the contact radius, whose rates are finite where contact begins.
struct ContactSize {
  double square_nm2 = 0;
  double by_overlap_nm = 0;      ///< ∂(a²)/∂δ
  double by_log_radius_nm2 = 0;  ///< ∂(a²)/∂ρ
};

/// A state of the contact law's curve, to start the next search of a near one from. Any other than the right
/// one costs time and nothing else. Private to the potential.
struct CurveHint {
  double overlap_nm = 0;
  double log_radius = 0;
  double parameter = 0;  ///< 0: none
  double by_overlap_per_nm = 0;
  double by_overlap_twice_per_nm2 = 0;
  double by_log_radius = 0;
};

/// The law of tip and sample (tip_sample_law.h) as one potential a branch, W_b(δ, ρ): force, radius force and
/// stiffness are derivatives of one function, so that no path over a surface of changing radius draws energy
/// from it.
///
/// Branches  Outside (van der Waals, or nothing) and inside (the stable segment of the contact law's curve).
///           Outside ends at the overlap `enter`(ρ), inside at `leave`(ρ); between the two both exist. At
///           `leave` the energies of the two are equal. At `enter` the tip goes in with a continuous force;
///           where the crossing is used both ways (λ < 0.717, `reversible`) both borders are one, energy and
///           force are continuous there, and it is no event. joined_law.h has the reasons.
/// Formula   W = E Û(Δ, λ) + O(ρ), Δ = δ/u_δ, E = u_F u_δ ~ R^(4/3), u_δ ~ λ ~ R^(1/3), O the offset where
///           the two laws join. With M = R ∂U/∂R/E (MaugisDugdale::radius_moment), x' = λ ∂x/∂λ at a constant
///           parameter of the curve, and P_Δ = dP/dΔ on the curve,
///             W_δ = u_F P,  W_ρ = E M + O',  W_δδ = (u_F/u_δ) P_Δ,  W_δρ = u_F X,  X = P + (P' − P_Δ (Δ' +
///             Δ))/3, W_ρρ = E (4/3 M + (M' − X (Δ' + Δ))/3) + O'',
///           since ∂M/∂Δ = X (mixed derivatives agree). Laws without λ (Hertz, DMT, JKR) have M = 4/3 Û − Δ
///           P/3 and no x'. Of laws whose own form goes with λ (Schwarz, COS, Piétrement–Troyon) W_ρ, W_δρ
///           and W_ρρ are differences over 2e-4 of ρ of the exact W and W_δ.
/// Method    Inside, the curve's own exact state at δ, found by Newton's method from the last one
///           (CurveHint): one or two evaluations, no table, no error of one, any radius. The borders and O
///           are piecewise cubics in ρ, with knots where λ passes 0.717 and 0.938 (where the fold comes to
///           lie in contact); O, which has a force, is C¹ with exact slopes.
/// Far       Retardation and cone are one term of δ and ρ (far_term.h), added on both sides. Bias and bridge
///           are terms apart, which the caller adds with overlaps and radii of their own: another range needs
///           another softening.
/// Wet       Under the liquid of a bridge the medium is another one (contact_medium.h): wet() has its
///           branches, this its dry ones.
/// Validity  R between 1/90 and 600 times the nominal radius; beyond, borders and O stay those of the end.
///           Overlaps up to `enter` outside, from `leave` on inside.
/// Errors    Inside and outside those of the law (1e-10 of the pull-off, 1e-13 of the energy); O 1e-10 of E;
///           far terms 1e-7 of theirs (force 1e-6). Second derivatives in ρ 1e-5.
class BranchPotential {
 public:
  /// Throws UserError unless the radius is positive and finite.
  BranchPotential(const TipSampleLaw& law, double nominal_radius_nm);

  struct Borders {
    double enter_nm = 0;  ///< outside ends here, going in
    double leave_nm = 0;  ///< inside ends here, going out
    bool reversible = false;
  };
  Borders borders(double log_radius) const noexcept;

  void outside(double overlap_nm, double log_radius, PotentialJet& jet) const noexcept;
  /// False, with nothing that means anything in `jet`, where the law has no stable state at this overlap.
  bool inside(double overlap_nm, double log_radius, CurveHint& hint, PotentialJet& jet,
              ContactSize& size) const noexcept;
  /// Where a ρ is in the tables over it, for who asks for borders and law there.
  struct Place;
  Place place(double log_radius) const noexcept;
  Borders borders(const Place& at) const noexcept;
  bool inside(const Place& at, double overlap_nm, double log_radius, CurveHint& hint, PotentialJet& jet,
              ContactSize& size) const noexcept;

  bool has_bias() const noexcept { return bias_.has_value(); }
  void add_bias(double overlap_nm, double log_radius, PotentialJet& jet) const noexcept;
  /// The softening of the fields that the bias reads. Its force goes like 1/d² with the capacitor's distance
  /// d = a0 + gap, so t grows with the gap from the first, 0.6 of it as for van der Waals; under the contact
  /// it rests, for the capacitor there does.
  /// (Against proximity sums over self-affine grounds at gaps of 0.165 to 6 nm: ninth decile 2 to 10 %; a
  /// fixed 1 nm gives 17 to 30 %.)
  SofteningRule bias_softening() const noexcept { return bias_softening_; }

  /// Of the branches under liquid; null where no bridge ever forms. Has no bias and no bridge of its own.
  const BranchPotential* wet() const noexcept { return wet_.get(); }
  const BridgePotential& bridge() const noexcept { return bridge_; }
  /// W inside at overlap 0, where a dry contact may turn wet; only where there is a bridge. 1e-6 of it.
  double touch_energy_aj(double log_radius) const noexcept;

  const TipSampleLaw& law() const noexcept { return law_; }
  double least_log_radius() const noexcept { return first_; }
  double greatest_log_radius() const noexcept { return first_ + step_ * static_cast<double>(pieces_.size()); }

 private:
  // Of one piece of ρ, over t in [0, 1].
  struct Piece {
    double enter[4];
    double leave[4];
    double offset[4];
    double touch[4];
    double cube_root;  // e^(ρ/3) where it begins
    bool reversible;
  };
  struct AtRadius {
    double offset_aj = 0;
    double enter_nm = 0;
    double leave_nm = 0;
    bool reversible = false;
  };

  /// e^(ρ/3).
  double cube_root(const Place& at, double log_radius) const noexcept;
  AtRadius at_radius(double log_radius) const;
  double offset_slope(double log_radius) const;
  /// inside() without offset and far terms; `root` = e^(ρ/3).
  bool on_law(double overlap_nm, double log_radius, double root, CurveHint& hint, PotentialJet& jet,
              ContactSize& size) const noexcept;
  /// Writes the derivatives in ρ of what on_law() has found.
  bool by_differences(double overlap_nm, double log_radius, const CurveHint& hint, PotentialJet& jet,
                      ContactSize& size) const noexcept;
  template <class Curve>
  bool on_curve(const Curve& curve, const ContactScales& scales, double overlap_nm, double log_radius,
                CurveHint& hint, PotentialJet& jet, ContactSize& size) const noexcept;

  BranchPotential(const TipSampleLaw& law, double nominal_radius_nm, bool wet);

  TipSampleLaw law_;
  ContactMedium medium_;
  ContactScales unit_;  // at a radius of 1 nm
  double cut_off_nm_ = 0;
  bool model_moves_ = false;  // the law's form itself goes with λ
  double first_ = 0;
  double step_ = 0;  // of ρ
  double per_step_ = 0;
  std::vector<Piece> pieces_;
  std::optional<FarTerm> far_;
  std::optional<FarTerm> bias_;
  SofteningRule bias_softening_;
  BridgePotential bridge_;
  std::shared_ptr<const BranchPotential> wet_;
};

struct BranchPotential::Place {
  const Piece* piece;
  double t;
};

inline BranchPotential::Borders BranchPotential::borders(double log_radius) const noexcept {
  return borders(place(log_radius));
}

inline bool BranchPotential::inside(double overlap_nm, double log_radius, CurveHint& hint, PotentialJet& jet,
                                    ContactSize& size) const noexcept {
  return inside(place(log_radius), overlap_nm, log_radius, hint, jet, size);
}

}  // namespace telenano::physics
