#include "telenano/nve_server/physics/contact/adhesive_curve.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/contact/joined_law.h"
#include "telenano/nve_server/physics/numerics/numbers.h"

namespace telenano::physics {
namespace {}  // namespace

AdhesiveCurve::AdhesiveCurve(double lambda, const ClosedFormCoefficients& coefficients,
                             bool van_der_waals) noexcept
    : lambda_(lambda), c_(coefficients) {
  const double root = std::sqrt(c_.kappa);
  q_ = 2.0 * root * c_.p;
  offset_ = c_.p * c_.p - c_.pull_off;
  load_fold_ = det_cbrt(c_.p / root);
  if (c_.m == 1.0) {
    touching_ = det_cbrt(c_.k);
    overlap_fold_ = det_cbrt(0.25 * c_.k);
  } else {
    const double log_k = det_log(c_.k);
    touching_ = c_.k > 0 ? det_exp(log_k / (4.0 - c_.m)) : 0.0;
    overlap_fold_ = c_.k > 0 ? det_exp((log_k + det_log(0.25 * c_.m)) / (4.0 - c_.m)) : 0.0;
  }
  energy_zero_ = std::max(0.0, contact(touching_).energy);
  const CurvePoint end = contact(load_fold_);
  saturated_ = van_der_waals && OutsideLaw(lambda).gap_of(end.overlap) <= std::sqrt(2.0 / c_.pull_off);
  plateau_overlap_ = end.overlap;
  plateau_energy_ = end.energy;
}

double AdhesiveCurve::power(double b) const noexcept {
  return c_.m == 1.0 ? b : det_exp(c_.m * det_log(b));
}

CurvePoint AdhesiveCurve::contact(double b) const noexcept {
  const double km = c_.k * power(b);
  const double b2 = b * b;
  const double b3 = b2 * b;
  const double b4 = b2 * b2;
  CurvePoint p;
  p.contact = true;
  p.parameter = b;
  p.contact_radius = b2;
  p.outer_radius = b2;
  p.overlap = b4 - km;
  p.load = b3 * (c_.kappa * b3 - q_) + offset_;
  p.overlap_rate = 4.0 * b3 - c_.m * km / b;
  p.load_rate = 3.0 * b2 * (2.0 * c_.kappa * b3 - q_);
  p.contact_radius_rate = 2.0 * b;
  p.energy = c_.kappa * b3 * b3 * (0.4 * b4 - c_.m * km / (6.0 + c_.m)) -
             q_ * b3 * ((4.0 / 7.0) * b4 - c_.m * km / (3.0 + c_.m)) + offset_ * p.overlap - energy_zero_;
  return p;
}

CurvePoint AdhesiveCurve::noncontact(double overlap) const noexcept {
  CurvePoint p;
  p.parameter = load_fold_ + (overlap - plateau_overlap_);
  p.overlap = overlap;
  p.load = -c_.pull_off;
  p.overlap_rate = 1;
  p.energy = plateau_energy_ - c_.pull_off * (overlap - plateau_overlap_);
  return p;
}

CurvePoint AdhesiveCurve::fold(const Held& held) const noexcept {
  if (saturated_ || load_fold_ <= overlap_fold_) return contact(std::max(load_fold_, overlap_fold_));
  if (held.load == 0) return contact(overlap_fold_);
  if (held.overlap == 0) return contact(load_fold_);
  double lo = overlap_fold_;
  double hi = load_fold_;
  double b = 0.5 * (lo + hi);
  for (int i = 0; i < 60; ++i) {
    const double neck = c_.k * c_.m * power(b) / (b * b * b);
    const double f = held.overlap * (4.0 * b - neck) + held.load * (6.0 * c_.kappa * b * b * b - 3.0 * q_);
    const double rate = held.overlap * (4.0 + (3.0 - c_.m) * neck / b) + held.load * 18.0 * c_.kappa * b * b;
    (f < 0 ? lo : hi) = b;
    double next = b - f / rate;
    if (!(next > lo && next < hi)) next = 0.5 * (lo + hi);
    const bool last = std::fabs(next - b) <= 1e-9 * b;  // Z is stationary: the rest is far below rounding
    b = next;
    if (last) break;
  }
  return contact(b);
}

double AdhesiveCurve::cold_guess(double z, const Held& held) const noexcept {
  // Without the terms that lower Z, each of the others alone bounds B from above.
  const double target = z - held.load * offset_;
  double b = std::max(load_fold_, overlap_fold_);
  if (target > 0) {
    double bound = std::numeric_limits<double>::infinity();
    if (held.overlap > 0) bound = std::sqrt(std::sqrt(target / held.overlap));
    if (held.load > 0) bound = std::min(bound, std::sqrt(det_cbrt(target / (held.load * c_.kappa))));
    b = std::max(b, bound);
  }
  return b;
}

CurveSolution AdhesiveCurve::solve(double z, const Held& held, double guess) const noexcept {
  CurveSolution out;
  if (saturated_ && z <= held.overlap * plateau_overlap_ - held.load * c_.pull_off) {
    if (held.overlap > 0) {
      out.point = noncontact((z + held.load * c_.pull_off) / held.overlap);
    } else {
      out.point = contact(load_fold_);
      out.status = CurveStatus::kNoState;
    }
    return out;
  }
  const double floor = saturated_ ? load_fold_ : overlap_fold_;
  double b = guess > floor ? guess : cold_guess(z, held);
  bool fold_known = false;
  for (out.evaluations = 1; out.evaluations <= 100; ++out.evaluations) {
    out.point = contact(b);
    CurvePoint& p = out.point;
    const double rate = p.held_rate(held);
    const double residual = p.held(held) - z;
    const double scale = held.overlap * (p.contact_radius * p.contact_radius + std::fabs(p.overlap)) +
                         held.load * (std::fabs(p.load) + c_.pull_off);
    if (std::fabs(residual) <= kEpsilon * scale && p.overlap_rate >= 0 && rate >= 0) return out;
    double next = b - residual / rate;
    if (!(p.overlap_rate > 0 && rate > 0) || !(next > floor)) {
      // Left of the fold: because the guess was, or because there is no state.
      const CurvePoint end = fold(held);
      if (z <= end.held(held)) {
        out.point = end;
        if (z < end.held(held)) out.status = CurveStatus::kNoState;
        return out;
      }
      if (fold_known) return out;  // at the fold to rounding
      fold_known = true;
      // From the parabola at the fold.
      const double near = 1e-4 * end.parameter;
      const double second = contact(end.parameter + near).held_rate(held) / near;
      b = end.parameter + std::sqrt(2.0 * (z - end.held(held)) / second);
      continue;
    }
    const double step = next - b;
    if (std::fabs(step) <= 3e-9 * b) {  // what first order leaves out is 1e-17 of the terms
      p.shift(step);
      return out;
    }
    if (out.evaluations == 3 && next < 0.9 * b && !fold_known) {
      next = std::min(next, cold_guess(z, held));  // a guess so far right shrinks by only a sixth a step
    }
    b = std::min(next, 2.0 * b);  // from the left a step overshoots, beside the fold by far
  }
  out.status = CurveStatus::kNotConverged;
  return out;
}

}  // namespace telenano::physics
