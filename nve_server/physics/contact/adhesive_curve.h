#pragma once

#include "telenano/nve_server/physics/contact/closed_form_laws.h"
#include "telenano/nve_server/physics/contact/contact_curve.h"

namespace telenano::physics {

/// The closed-form laws with an adhesive neck (JKR, Schwarz, COS, Piétrement–Troyon) as a curve.
///
/// Formula   P = (sqrt(kappa) B^3 - p)^2 - L, Delta = B^4 - k B^m, A = B^2 (closed_form_laws.h), 0 < m <= 1.
///           U = int P dDelta = kappa B^6 (0.4 B^4 - k m B^m/(6 + m)) - q B^3 (4/7 B^4 - k m B^m/(3 + m))
///               + (p^2 - L) Delta,  q = 2 sqrt(kappa) p; 0 where A = 0, or at the stable touch (Delta = 0)
///               if it were
///           above zero there: without van der Waals the tip that touches must not gain by it.
/// Parameter s = B in contact.
/// Fold      With Z = a Delta + b P, dZ/dB = B^2 f(B),
///             f = a (4 B - k m B^(m - 3)) + b (6 kappa B^3 - 3 q),
///           which rises strictly from -infinity: there is one fold, between the fold of Delta,
///           B^(4 - m) = k m/4, and that of P, B^3 = p/sqrt(kappa). Beyond it Z is convex: with f >= 0,
///             Z''/B >= a (4 B + k m (3 - m) B^(m - 3)) + 18 b kappa B^3 > 0,
///           so that Newton's method from the right is monotone.
/// Saturated Where van der Waals still attracts more than the law can, that is at the pull-off point
///           (-L, Delta_L), it is followed to the load -L and the load stays there up to Delta_L, where
///           contact begins: a range of constant attraction as Dugdale's, no hysteresis, no adhesion counted
///           twice. The law's own branch below Delta_L is then not used. s = B_L + Delta - Delta_L there.
/// Errors    Numerics 1e-14 of the terms; the model's are in closed_form_laws.h.
class AdhesiveCurve {
 public:
  AdhesiveCurve() noexcept : AdhesiveCurve(1.0, {1, 1, 1, 1, 1}, false) {}
  AdhesiveCurve(double lambda, const ClosedFormCoefficients& coefficients, bool van_der_waals) noexcept;

  double lambda() const noexcept { return lambda_; }
  double range() const noexcept { return 0; }
  bool saturated() const noexcept { return saturated_; }
  double pull_off() const noexcept { return c_.pull_off; }
  double overlap_fold() const noexcept { return overlap_fold_; }  ///< B where dDelta/dB = 0
  double load_fold() const noexcept { return load_fold_; }        ///< B where dP/dB = 0
  double touching() const noexcept { return touching_; }          ///< B where Delta = 0

  CurvePoint contact(double b) const noexcept;
  /// Saturated only: the state of load -L at an overlap of at most Delta_L.
  CurvePoint noncontact(double overlap) const noexcept;
  CurvePoint fold(const Held& held) const noexcept;
  CurveSolution solve(double z, const Held& held, double guess = 0) const noexcept;

 private:
  double power(double b) const noexcept;
  double cold_guess(double z, const Held& held) const noexcept;

  double lambda_;
  ClosedFormCoefficients c_;
  double q_;       // 2 sqrt(kappa) p
  double offset_;  // p^2 - L, the load where A = 0
  double overlap_fold_;
  double load_fold_;
  double touching_;
  double energy_zero_ = 0;
  bool saturated_ = false;
  double plateau_overlap_ = 0;
  double plateau_energy_ = 0;
};

static_assert(ContactCurve<AdhesiveCurve>);

}  // namespace telenano::physics
