#include "telenano/nve_server/physics/contact/joined_law.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"

namespace telenano::physics {
namespace {

constexpr double kRangeOverA0 = 0.97427857925749347766;  // h0/a0 = 9 sqrt(3)/16

/// y C = 2/sqrt(pi lambda), y = 1 - eta Delta(C): a cubic in C that rises from the fold (C = q) to a maximum
/// and falls again; concave for C > 2q/3. Newton from below the first root and from above the second one is
/// monotone.
double noncontact_crossing(const MaugisDugdale& curve, double eta, double start) noexcept {
  const double q = curve.q();
  const double target = 2.0 / std::sqrt(kPi * curve.lambda());
  double c = start;
  for (int i = 0; i < 60; ++i) {
    const double y = 1.0 + kRangeOverA0 + eta * c * (q - 0.5 * c);
    const double slope = y + eta * c * (q - c);
    const double next = std::clamp(c - (y * c - target) / slope, q, curve.onset_radius());
    if (std::fabs(next - c) <= 4e-16 * c) return next;
    c = next;
  }
  return c;
}

/// r(u) = y - sqrt(-2/P) = 0 in contact; r > 0 where Maugis–Dugdale attracts more (u too small).
CurvePoint contact_crossing(const MaugisDugdale& curve, double eta, double guess) noexcept {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double lo = 0;
  double hi = kInfinity;
  double u = guess > 0 ? guess : 0.92 * curve.lambda() * curve.lambda();
  CurvePoint p;
  for (int i = 0; i < 100; ++i) {
    p = curve.contact(u);
    double next = -1;
    if (!(p.load < 0)) {
      hi = u;
    } else if (!(p.overlap_rate > 0)) {
      lo = u;
    } else {
      const double root = std::sqrt(-2.0 / p.load);
      const double r = (1.0 - eta * p.overlap) - root;
      const double step = -r / (-eta * p.overlap_rate + 0.5 * root * p.load_rate / p.load);
      // To first order: what is left out is 1e-16 of the point.
      if (std::fabs(step) <= 1e-8 * u) {
        p.shift(step);
        return p;
      }
      (r > 0 ? lo : hi) = u;
      next = u + step;
    }
    if (!(next > lo && next < hi)) next = hi < kInfinity ? 0.5 * (lo + hi) : 2.0 * u + 1e-6;
    if (next == u) return p;
    u = next;
  }
  return p;
}

double target_of(const MaugisDugdale& curve) noexcept {
  return 2.0 / std::sqrt(kPi * curve.lambda());
}

/// y C against 2/sqrt(pi lambda): smaller where van der Waals attracts more.
double product(const MaugisDugdale& curve, double eta, double c) noexcept {
  return c * (1.0 + kRangeOverA0 + eta * c * (curve.q() - 0.5 * c));
}

/// Does van der Waals attract more at the fold of overlap?
bool crosses_twice(const MaugisDugdale& curve, double eta) noexcept {
  return curve.q() < curve.onset_radius() && product(curve, eta, curve.q()) < target_of(curve);
}

/// How much more the law attracts than van der Waals: > 0 at the pull-off point, < 0 at Delta = 0, where van
/// der Waals is at its cut-off.
double excess(const CurvePoint& p, const OutsideLaw& outside) noexcept {
  return p.load < 0 ? outside.gap_of(p.overlap) - std::sqrt(-2.0 / p.load) : -1.0;
}

bool crosses_twice(const AdhesiveCurve& curve, const OutsideLaw& outside) noexcept {
  return excess(curve.contact(curve.overlap_fold()), outside) < 0;
}

}  // namespace

OutsideLaw::OutsideLaw(double lambda) noexcept : eta_(kRangeOverA0 * (kPi / 2.0) * lambda) {}

OutsidePoint OutsideLaw::at_gap(double y) const noexcept {
  const double inverse = 1.0 / y;
  const double load = -2.0 * inverse * inverse;
  return {y, (1.0 - y) / eta_, load, 2.0 * eta_ * load * inverse, -2.0 * inverse / eta_};
}

bool OutsideLaw::stable(double z, double compliance) const noexcept {
  const double b = 1.0 - eta_ * z;
  return b > 0 && b * b * b >= 13.5 * compliance * eta_;
}

OutsidePoint OutsideLaw::solve(double z, double compliance) const noexcept {
  // y^3 - B y^2 + 2 c eta = 0 with B = 1 - eta Z, y = B (2/3 + v): v^2 (1 + v) = 4/27 - 2 c eta/B^3 = m, v in
  // [0, 1/3]. Newton on v sqrt(1 + v) = sqrt(m) is as good at the jump to contact (m = 0) as far away.
  const double b = 1.0 - eta_ * z;
  if (compliance == 0) return at_gap(b);
  if (!(b > 0)) return at_gap(jump_gap(compliance));
  const double k = 2.0 * compliance * eta_ / (b * b * b);
  if (k < 1e-4) {  // far away: y/B = 1 - k - 2 k^2 - 7 k^3 - 30 k^4 ..., the rest below 2e-18
    return at_gap(b * (1.0 - k * (1.0 + k * (2.0 + k * (7.0 + 30.0 * k)))));
  }
  const double m = 4.0 / 27.0 - k;
  if (!(m > 0)) return at_gap(jump_gap(compliance));
  const double root = std::sqrt(m);
  double v = root * (1.0 - 0.4 * root);
  for (int i = 0; i < 4; ++i) {
    const double w = std::sqrt(1.0 + v);
    v += (root - v * w) * w / (1.0 + 1.5 * v);
  }
  return at_gap(b * (2.0 / 3.0 + v));
}

double OutsideLaw::jump_gap(double compliance) const noexcept {
  return det_cbrt(4.0 * compliance * eta_);
}

Handover find_handover(const MaugisDugdale& curve, const OutsideLaw& outside, double guess) noexcept {
  Handover h;
  const double eta = outside.eta();
  const double q = curve.q();
  const double c0 = curve.onset_radius();
  h.reversible = crosses_twice(curve, eta);
  if (h.reversible) {
    h.inside = curve.noncontact(noncontact_crossing(curve, eta, q));
  } else if (q < c0 && product(curve, eta, c0) < target_of(curve)) {
    h.inside = curve.noncontact(noncontact_crossing(curve, eta, c0));
  } else {
    h.inside = contact_crossing(curve, eta, guess);
  }
  // The gap of the same force: at large lambda 1 - eta Delta has lost digits.
  h.gap = std::sqrt(-2.0 / h.inside.load);
  return h;
}

Handover find_handover(const HertzianCurve& curve, const OutsideLaw& /*outside*/, double /*guess*/) noexcept {
  Handover h;
  h.reversible = true;
  h.inside = curve.contact(0);
  h.gap = 1;
  return h;
}

Handover find_handover(const AdhesiveCurve& curve, const OutsideLaw& outside, double /*guess*/) noexcept {
  Handover h;
  if (curve.saturated()) {
    h.reversible = true;
    h.gap = std::sqrt(2.0 / curve.pull_off());
    h.inside = curve.noncontact(outside.at_gap(h.gap).overlap);
  } else {
    h.reversible = crosses_twice(curve, outside);
    double more = curve.load_fold();
    double less = h.reversible ? curve.overlap_fold() : curve.touching();
    double b = 0.5 * (more + less);
    for (int i = 0; i < 100; ++i) {
      h.inside = curve.contact(b);
      const CurvePoint& p = h.inside;
      const double r = excess(p, outside);
      (r > 0 ? more : less) = b;
      double next = 0.5 * (more + less);
      if (p.load < 0) {
        const double root = std::sqrt(-2.0 / p.load);
        const double newton = b - r / (-outside.eta() * p.overlap_rate + 0.5 * root * p.load_rate / p.load);
        if ((newton - more) * (newton - less) < 0) next = newton;
      }
      if (std::fabs(next - b) <= 4e-16 * b) break;
      b = next;
    }
    h.gap = std::sqrt(-2.0 / h.inside.load);
  }
  return h;
}

Parting parting_at(const Handover& handover, const OutsideLaw& outside) noexcept {
  return {true, handover.inside, handover.gap, outside.at_gap(handover.gap).energy - handover.inside.energy};
}

Parting parting_at_fold(const CurvePoint& fold, const OutsideLaw& outside) noexcept {
  const double gap = outside.gap_of(fold.overlap);
  return {false, fold, gap, outside.at_gap(gap).energy - fold.energy};
}

Parting find_parting(const MaugisDugdale& curve, const OutsideLaw& outside) noexcept {
  if (crosses_twice(curve, outside.eta())) return parting_at(find_handover(curve, outside), outside);
  return parting_at_fold(curve.fold({1.0, 0.0}), outside);
}

Parting find_parting(const HertzianCurve& curve, const OutsideLaw& outside) noexcept {
  return parting_at(find_handover(curve, outside), outside);
}

Parting find_parting(const AdhesiveCurve& curve, const OutsideLaw& outside) noexcept {
  if (curve.saturated() || crosses_twice(curve, outside)) {
    return parting_at(find_handover(curve, outside), outside);
  }
  return parting_at_fold(curve.contact(curve.overlap_fold()), outside);
}

double offset_moment(const MaugisDugdale& curve, const Parting& parting, const OutsideLaw& outside) noexcept {
  const CurvePoint& p = parting.end;
  const double moment = outside.at_gap(parting.gap).energy - curve.radius_moment(p);
  if (parting.reversible) return moment;
  return moment + (outside.at_gap(parting.gap).load - p.load) * curve.fold_radius_rate(p);
}

}  // namespace telenano::physics
