#pragma once

#include "telenano/nve_server/physics/contact/adhesive_curve.h"
#include "telenano/nve_server/physics/contact/hertzian_curve.h"
#include "telenano/nve_server/physics/contact/maugis_dugdale.h"

namespace telenano::physics {

/// Van der Waals attraction outside joined to Maugis–Dugdale inside, without dimensions, for one lambda.
///
/// Formula   Outside P = -2/y^2, U = -2/(eta y), with the gap y = d/a0 = 1 - eta Delta; eta = u_delta/a0 =
///           (9 sqrt(3) pi/32) lambda since the Dugdale range is h0 = (9 sqrt(3)/16) a0. The joined law so
///           depends on lambda alone. Inside the stable curve of maugis_dugdale.h.
/// Handover  Both laws carry the whole adhesion w, so they must not be added. Coming in, the tip follows van
///           der Waals until it meets the stable Maugis–Dugdale curve: the force is continuous.
///           - lambda > 0.717: at its fold, Maugis–Dugdale attracts more than van der Waals. They cross once,
///             at Delta_in (d = 0.19-0.20 nm for the usual samples); going out the tip stays on
///             Maugis–Dugdale to the fold and jumps.
///           - lambda < 0.717: van der Waals attracts more at the fold. The outer one of the two crossings is
///             then used both ways and no energy is lost there. (Staying on to the fold would create energy.)
/// Energy    Inside U = U_MD + energy_offset, which no loop sees but in how the loss is shared between going
///           in and out. U is continuous where the tip goes out when the overlap is held (Parting: the fold,
///           or the crossing where it is used both ways), and what a handover that is not used both ways
///           takes off U is dissipated there, going in, though the force is continuous: the area between the
///           two laws from fold to handover, 0.66 just above 0.717, 1.275 at infinity. Why there: below 0.717
///           U has no choice, and the crossing becomes the fold at 0.717, so that only this choice leaves U,
///           and -dU/dR (a C1 join, the forces being equal there), continuous in lambda; it is also near the
///           truth for soft contacts, where of that 1.275 of JKR 1.154 is lost at the snap-in. Under a spring
///           the fold is met earlier, where still more than this is lost: with the base held, U + (Z -
///           Delta)^2/2c falls all the way from there down the unstable stretch to the fold of overlap and on
///           along van der Waals to the balance outside.
/// Others    DMT begins at y = 1 with the force of van der Waals there: they meet at the touch, both ways.
///           The laws with an adhesive neck follow the same rule as Maugis–Dugdale: one crossing where they
///           attract more at the fold of overlap, else the outer one of two, both ways; where van der Waals
///           attracts more even at their pull-off point, both ways at the load of the pull-off, which then
///           stays (adhesive_curve.h). (Seen at lambda < 0.231 for JKR.
///           There another path is taken, and U inside steps by 0.03, 0.5 % of it.)
/// Errors    Model, not numerics: between handover and fold neither law is exact; the joined one keeps w, the
///           pull-off of Maugis–Dugdale and the far field of van der Waals.
struct OutsidePoint {
  double gap = 0;  ///< y = d/a0
  double overlap = 0;
  double load = 0;
  double slope = 0;  ///< dP/dDelta
  double energy = 0;
};

/// Where the tip goes in with a continuous force.
struct Handover {
  bool reversible = false;
  CurvePoint inside;  ///< the state on the curve
  double gap = 0;     ///< y there
};

/// Where it goes out with the overlap held.
struct Parting {
  bool reversible = false;
  CurvePoint end;  ///< the handover if it is reversible, else the fold of overlap
  double gap = 0;  ///< y there
  double energy_offset = 0;
};

/// The law outside.
class OutsideLaw {
 public:
  explicit OutsideLaw(double lambda) noexcept;

  double eta() const noexcept { return eta_; }
  double gap_of(double overlap) const noexcept { return 1.0 - eta_ * overlap; }  ///< y
  OutsidePoint at_gap(double y) const noexcept;
  /// Has the base at z a stable state outside on a spring of compliance c? (Jump to contact: y^3 = 4 c eta.)
  bool stable(double z, double compliance) const noexcept;
  /// It, or the one at the jump to contact if there is none.
  OutsidePoint solve(double z, double compliance) const noexcept;
  /// Gap at which a spring of compliance c jumps to contact.
  double jump_gap(double compliance) const noexcept;

 private:
  double eta_;
};

/// Beyond this gap no handover lies for any lambda (1.59 at 0, rising to 2.18 at 0.717; then 1.14, rising
/// to 1.22 at infinity).
inline constexpr double kNoHandoverGap = 2.25;

/// `guess` is a contact parameter near the handover (0: none).
Handover find_handover(const MaugisDugdale& curve, const OutsideLaw& outside, double guess = 0) noexcept;
Handover find_handover(const HertzianCurve& curve, const OutsideLaw& outside, double guess = 0) noexcept;
Handover find_handover(const AdhesiveCurve& curve, const OutsideLaw& outside, double guess = 0) noexcept;

Parting find_parting(const MaugisDugdale& curve, const OutsideLaw& outside) noexcept;
Parting find_parting(const HertzianCurve& curve, const OutsideLaw& outside) noexcept;
Parting find_parting(const AdhesiveCurve& curve, const OutsideLaw& outside) noexcept;
/// Of a curve whose handover is used both ways, or which ends at `fold`.
Parting parting_at(const Handover& handover, const OutsideLaw& outside) noexcept;
Parting parting_at_fold(const CurvePoint& fold, const OutsideLaw& outside) noexcept;

/// R dE/dR over u_F u_delta, E the energy offset at R: the moments of the two laws at the parting, and as
/// their forces differ at a fold, what the fold's own displacement does.
double offset_moment(const MaugisDugdale& curve, const Parting& parting, const OutsideLaw& outside) noexcept;

}  // namespace telenano::physics
