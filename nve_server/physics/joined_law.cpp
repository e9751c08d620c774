#include "nve_server/physics/joined_law.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/base/constants.h"
#include "common/base/det_math.h"

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
double contact_crossing(const MaugisDugdale& curve, double eta, double guess) noexcept {
  double lo = 0;
  double hi = std::numeric_limits<double>::infinity();
  double u = guess > 0 ? guess : 0.92 * curve.lambda() * curve.lambda();
  double last = 0;
  for (int i = 0; i < 100; ++i) {
    const MaugisPoint p = curve.contact(u);
    double next = 0;
    if (!(p.load < 0)) {
      hi = u;
      next = 0.5 * (lo + hi);
    } else if (!(p.overlap_rate > 0)) {
      lo = u;
      next = hi < std::numeric_limits<double>::infinity() ? 0.5 * (lo + hi) : 2.0 * u + 1e-6;
    } else {
      const double root = std::sqrt(-2.0 / p.load);
      const double r = (1.0 - eta * p.overlap) - root;
      const double rate = -eta * p.overlap_rate + 0.5 * root * p.load_rate / p.load;
      (r > 0 ? lo : hi) = u;
      if (r == 0) return u;
      next = u - r / rate;
      const double size = std::fabs(next - u);
      if (size <= 1e-15 * u || (size < 1e-8 * u && size * size * size <= 1e-17 * u * last * last))
        return next;
      last = size;
      if (!(next > lo && next < hi)) {
        next = hi < std::numeric_limits<double>::infinity() ? 0.5 * (lo + hi) : 2.0 * u + 1e-6;
        last = 0;
      }
    }
    if (next == u) return next;
    u = next;
  }
  return u;
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
  const double m = 4.0 / 27.0 - 2.0 * compliance * eta_ / (b * b * b);
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
  const double target = 2.0 / std::sqrt(kPi * curve.lambda());
  const double q = curve.q();
  const double c0 = curve.onset_radius();
  // y C against 2/sqrt(pi lambda): smaller where van der Waals attracts more.
  const auto product = [&](double c) { return c * (1.0 + kRangeOverA0 + eta * c * (q - 0.5 * c)); };
  h.reversible = q < c0 && product(q) < target;
  if (h.reversible) {
    h.inside = curve.noncontact(noncontact_crossing(curve, eta, q));
  } else if (q < c0 && product(c0) < target) {
    h.inside = curve.noncontact(noncontact_crossing(curve, eta, c0));
  } else {
    h.inside = curve.contact(contact_crossing(curve, eta, guess));
  }
  h.gap = 1.0 - eta * h.inside.overlap;
  h.energy_offset = -2.0 / (eta * h.gap) - h.inside.energy;
  return h;
}

}  // namespace telenano::physics
