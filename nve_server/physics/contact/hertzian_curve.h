#pragma once

#include "telenano/nve_server/physics/contact/contact_curve.h"

namespace telenano::physics {

/// Hertz and DMT as a curve: P = Delta^1.5 - L, A = sqrt(Delta), Delta >= 0; L = 0 (Hertz) or 2 (DMT).
///
/// Parameter s = Delta. P is convex and rises from the first touch on, so that every state is stable under
///           any spring, the fold is the touch itself and Newton's method from the right is monotone.
/// Energy    (2/5) Delta^2.5 - L Delta, 0 at the touch.
/// Validity, source: closed_form_laws.h.
class HertzianCurve {
 public:
  HertzianCurve(double lambda, double pull_off) noexcept : lambda_(lambda), pull_off_(pull_off) {}

  double lambda() const noexcept { return lambda_; }
  double range() const noexcept { return 0; }

  CurvePoint contact(double overlap) const noexcept;
  CurvePoint fold(const Held& /*held*/) const noexcept { return contact(0); }
  CurveSolution solve(double z, const Held& held, double guess = 0) const noexcept;

 private:
  double lambda_;
  double pull_off_;
};

static_assert(ContactCurve<HertzianCurve>);

}  // namespace telenano::physics
