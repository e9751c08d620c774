#include "telenano/nve_server/physics/contact/hertzian_curve.h"
#include "telenano/nve_server/physics/numerics/numbers.h"

#include <cmath>

namespace telenano::physics {

CurvePoint HertzianCurve::contact(double overlap) const noexcept {
  CurvePoint p;
  p.contact = true;
  p.parameter = overlap;
  p.contact_radius = std::sqrt(overlap);
  p.outer_radius = p.contact_radius;
  p.overlap = overlap;
  p.load = overlap * p.contact_radius - pull_off_;
  p.overlap_rate = 1;
  p.load_rate = 1.5 * p.contact_radius;
  p.contact_radius_rate = overlap > 0 ? 0.5 / p.contact_radius : 0;
  p.energy = overlap * (0.4 * overlap * p.contact_radius - pull_off_);
  return p;
}

CurveSolution HertzianCurve::solve(double z, const Held& held, double guess) const noexcept {
  // a s + b s^1.5 = y, both terms >= 0: either alone would bound s from above.
  const double y = z + held.load * pull_off_;
  if (!(y >= 0)) return {CurveStatus::kNoState, contact(0), 1};
  if (held.load == 0) return {CurveStatus::kOk, contact(y / held.overlap), 1};
  if (y == 0) return {CurveStatus::kOk, contact(0), 1};
  double s = guess;
  if (!(guess > 0)) {
    s = y;
    if (held.overlap > 0) s = y / held.overlap;
    // With b s^1.5 <= y and s <= 1, s <= sqrt(y/b); with s >= 1, s <= y/b: both bounded by the greater.
    const double ratio = y / held.load;
    s = std::fmin(s > 0 ? s : ratio, std::fmax(ratio, std::sqrt(ratio)));
  }
  for (int i = 1; i <= 60; ++i) {
    const double root = std::sqrt(s);
    const double rate = held.overlap + 1.5 * held.load * root;
    const double step = -(held.overlap * s + held.load * s * root - y) / rate;
    // From left of the solution one step goes beyond it, never below zero from the right (convex).
    s = std::fmax(s + step, 0.25 * s);
    // The error left behind by a step is less than (3/8) b/(rate sqrt(s)) step^2 <= step^2/(4 s).
    if (step * step <= kEpsilon * s * s) return {CurveStatus::kOk, contact(s), i};
  }
  return {CurveStatus::kNotConverged, contact(s), 60};
}

}  // namespace telenano::physics
