#pragma once

#include "telenano/nve_server/physics/contact/contact_curve.h"

namespace telenano::physics {

/// The adhesive contact of two elastic spheres after Maugis (1992), exact, without dimensions.
///
/// Formula   A Dugdale stress sigma0 acts in the annulus a < r < c around the contact a. In contact, with
///           theta = acos(a/c),
///             F1 = sin(2 theta)/2 - theta cos(2 theta)
///             F2 = theta sin theta - 1 + cos theta
///             b = (4/3) lambda^2 F2
///             C = 2/(b + sqrt(b^2 + 2 lambda F1)),  A = C cos theta
///             P = A^3 - lambda C^2 (theta + sin(2 theta)/2)
///             Delta = A^2 - (4/3) lambda C sin theta
///           Before contact (A = 0, 0 < C < C0):
///             P = -(pi/2) lambda C^2
///             Delta = C^2/2 - q C - H0,  q = 8 lambda/(3 pi),  H0 = 2/(pi lambda)
/// Symbols   A = a/u_a, C = c/u_a, Delta = overlap/u_delta, P = force/u_F (repulsion positive),
///           energy/(u_F u_delta); lambda = 2 sigma0 (R/(pi w K^2))^(1/3).
/// Parameter The curve is run through from first interaction to deep contact by one number s. In contact
///             s = u = cot^2(theta) = a^2/(c^2 - a^2) >= 0,
///           because Delta and P are then smooth up to the onset (in theta both have a double root there) and
///           grow like powers u^1.5 ... u^3 far from it, so Newton's method has an easy, convex function
///           everywhere; cos, sin and the radii follow from square roots. Without contact s = C - C0 < 0.
/// Stability A state is stable when dDelta/ds > 0 and dZ/ds > 0, Z = Delta + c P being what a spring of
///           compliance c holds. dP/dDelta grows monotonically along the stable curve, so the stable states
///           form one segment, from the fold of Z to deep contact, and Z is convex and monotone on it.
/// Validity  lambda 1e-3 ... 1.2e4, Delta to 1e4 and beyond (a/R < 0.5 for the half-space theory to hold,
///           which is for the caller to check).
/// Errors    Against 50 digits: force within 1e-10 (|P| + |pull-off|) down to 1e-11 above a fold and some
///           1e-14 away from it, energy within 1e-13 max(|U|, |U(onset)|, 1). dP/dDelta is exact to some
///           1e-8 (taken one small Newton step away).
/// Source    D. Maugis, J. Colloid Interface Sci. 150 (1992) 243-269.

/// The curve of one lambda.
class MaugisDugdale {
 public:
  explicit MaugisDugdale(double lambda) noexcept;

  double lambda() const noexcept { return lambda_; }
  double range() const noexcept { return h0_; }                   ///< H0
  double q() const noexcept { return q_; }                        ///< 8 lambda/(3 pi)
  double onset_radius() const noexcept { return onset_radius_; }  ///< C0
  double onset_overlap() const noexcept { return onset_radius_ * (0.5 * onset_radius_ - q_) - h0_; }
  double onset_load() const noexcept;

  CurvePoint noncontact(double outer_radius) const noexcept;
  CurvePoint contact(double u) const noexcept;

  /// R dU/dR at constant overlap, tip and sample, over u_F u_delta: the second moment of the pressure, since
  /// a larger radius lowers the gap by r^2/(2 R^2) dR (U is stationary in all else). With the Abel transform
  /// of the pressure (E* (delta - t^2/R) inside a, -2 sigma0 sqrt(c^2 - t^2) in the annulus)
  ///   A^3 (Delta/2 - (3/10) A^2) - (lambda/4) C^4 (theta - sin(4 theta)/4).
  /// Hertz: A^5/5.
  double radius_moment(const CurvePoint& p) const noexcept;

  /// R d(delta)/dR of the fold of overlap `p`, over u_delta: delta is stationary there, so it is that at
  /// constant parameter, (Delta + lambda dDelta/dlambda)/3. With lambda F1 C^2/2 + b C = 1 (above),
  /// lambda dC/dlambda = -(1 + b C)/(lambda F1 C + b).
  double fold_radius_rate(const CurvePoint& p) const noexcept;

  /// The end of the stable segment: where dZ/ds = 0 first, coming from deep contact. A search of about ten
  /// contact evaluations if the fold lies in contact, closed form if not. With the overlap held it depends on
  /// lambda alone: one evaluation at a tabulated parameter.
  CurvePoint fold(const Held& held) const noexcept;

  /// The stable state that holds Z. `guess` is a contact parameter to start from; 0 or less: none. Within
  /// some 5e-6 of itself it is accepted after one evaluation.
  CurveSolution solve(double z, const Held& held, double guess = 0) const noexcept;

  /// Does the fold lie on the branch without contact? Then its C.
  bool fold_before_contact(const Held& held, double* outer_radius) const noexcept;

 private:
  friend class OverlapFolds;

  double search_fold(const Held& held) const noexcept;
  CurveSolution solve_contact(double z, const Held& held, double guess) const noexcept;
  double cold_guess(double z, const Held& held) const noexcept;

  double lambda_;
  double h0_;
  double q_;
  double onset_radius_;
};

}  // namespace telenano::physics
