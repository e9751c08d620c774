#include "tests/support/md_walk.h"

#include <algorithm>
#include <cmath>

namespace telenano::oracle {
namespace {

using Real = MdWalk::Real;

constexpr Real kPi = 3.141592653589793238462643383279502884L;
constexpr Real kDeep = -60;  // ln(m − 1): far deeper than any overlap asked for
constexpr Real kOnset = 40;  // m = 2e17: contact radius 0 to all digits

/// r − atan r without cancellation.
Real r_less_atan(Real r) {
  if (r > 0.1L) return r - std::atan(r);
  const Real y = r * r;
  Real sum = 0;
  for (int k = 12; k >= 1; --k) sum = 1 / static_cast<Real>(2 * k + 1) - y * sum;
  return r * y * sum;
}

}  // namespace

MdWalk::MdWalk(Real lambda, Real compliance, bool van_der_waals)
    : lambda_(lambda), compliance_(compliance), van_der_waals_(van_der_waals) {
  h0_ = 2 / (kPi * lambda);
  q_ = 8 * lambda / (3 * kPi);
  // (pi/4) lambda C0^2 + (4/3)(pi/2 − 1) lambda^2 C0 = 1
  const Real b = Real(4) / 3 * (kPi / 2 - 1) * lambda * lambda;
  c0_ = 2 / (b + std::sqrt(b * b + kPi * lambda));
  // h0 = (9 sqrt(3)/16) a0 in nm, and H0 in units of u_delta: eta = u_delta/a0.
  eta_ = 9 * std::sqrt(Real(3)) / 16 / h0_;
  end_x_ = segment_end(compliance);
  if (!van_der_waals) {
    outside_end_ = -h0_;
    inside_end_ = held(end_x_);
    return;
  }
  // Where both attract alike, on the states that are stable with the overlap held. If van der Waals attracts
  // more at the fold the segment inside ends at the first crossing, both ways.
  const Real fold = segment_end(0);
  const auto more_inside = [&](Real x) {
    const Point p = at(x);
    const Real y = 1 - eta_ * p.overlap;
    return y > 0 && -p.load * y * y > 2;
  };
  const bool reversible = !more_inside(fold);
  Real x = fold;
  // From the fold inwards until the sign changes; the crossings lie within a decade of its scale.
  const Real step = reversible ? (fold - kOnset) / 4000 : Real(0.01);
  for (int i = 0; i < 20000; ++i) {
    const Real next = x - step;
    if (more_inside(next) != more_inside(x)) {
      Real low = next;
      Real high = x;
      const bool at_high = more_inside(high);
      for (int k = 0; k < 80; ++k) {
        const Real mid = (low + high) / 2;
        (more_inside(mid) == at_high ? high : low) = mid;
      }
      x = (low + high) / 2;
      break;
    }
    x = next;
  }
  const Real gap = std::sqrt(-2 / at(x).load);
  if (reversible) end_x_ = std::min(end_x_, x);
  const Real jump_gap = std::cbrt(4 * compliance * eta_);
  end_gap_ = std::max(gap, jump_gap);
  outside_end_ = held_at_gap(end_gap_);
  inside_end_ = held(end_x_);
}

MdWalk::Point MdWalk::at(Real x) const {
  if (x >= kOnset) {
    const Real c = c0_ - (x - kOnset);
    return {c * c / 2 - q_ * c - h0_, -kPi / 2 * lambda_ * c * c};
  }
  const Real t = std::exp(x);
  const Real m = 1 + t;
  const Real r = std::sqrt(t * (2 + t));
  const Real arc = std::atan(r);
  // Maugis' alpha: r + (m^2 − 2) atan r = (r − atan r) + r^2 atan r
  const Real alpha = lambda_ / 2 * (r_less_atan(r) + r * r * arc);
  // and beta: r atan r − (m − 1) = t + t^2 − r (r − atan r), which cancels where t is large instead
  const Real rest = t < 1 ? t + t * t - r * r_less_atan(r) : r * arc - t;
  const Real beta = Real(4) / 3 * lambda_ * lambda_ * rest;
  const Real a = 2 / (beta + std::sqrt(beta * beta + 4 * alpha));
  return {a * a - Real(4) / 3 * lambda_ * a * r, a * a * a - lambda_ * a * a * (r + m * m * arc)};
}

Real MdWalk::held(Real x) const {
  const Point p = at(x);
  return p.overlap + compliance_ * p.load;
}

Real MdWalk::held_at_gap(Real y) const {
  return (1 - y) / eta_ - compliance_ * 2 / (y * y);
}

/// First minimum of Delta + c P coming from deep contact.
Real MdWalk::segment_end(Real compliance) const {
  const Real e = 1 - kPi * lambda_ * compliance;  // dZ/dC = e C − q before contact
  if (e > 0 && q_ / e < c0_) return kOnset + c0_ - q_ / e;
  const auto z = [&](Real x) {
    const Point p = at(x);
    return p.overlap + compliance * p.load;
  };
  // In contact: the lowest of a grid (near the onset Z is flat in x, where golden section alone would follow
  // the rounding), then golden section around it.
  Real lowest = kDeep;
  Real z_lowest = z(kDeep);
  constexpr Real kStep = 0.5L;
  for (Real x = kDeep + kStep; x <= kOnset; x += kStep) {
    const Real here = z(x);
    if (here >= z_lowest) continue;
    z_lowest = here;
    lowest = x;
  }
  const Real ratio = (std::sqrt(Real(5)) - 1) / 2;
  Real low = lowest - kStep;
  Real high = std::min(kOnset, lowest + kStep);
  Real x1 = high - ratio * (high - low), x2 = low + ratio * (high - low);
  Real z1 = z(x1), z2 = z(x2);
  for (int i = 0; i < 60; ++i) {
    if (z1 <= z2) {
      high = x2;
      x2 = x1;
      z2 = z1;
      x1 = high - ratio * (high - low);
      z1 = z(x1);
    } else {
      low = x1;
      x1 = x2;
      z1 = z2;
      x2 = low + ratio * (high - low);
      z2 = z(x2);
    }
  }
  return (low + high) / 2;
}

MdWalk::State MdWalk::inside(Real z) const {
  Real low = kDeep;
  Real high = end_x_;
  for (int i = 0; i < 90; ++i) {
    const Real mid = (low + high) / 2;
    (held(mid) > z ? low : high) = mid;
  }
  const Real x = (low + high) / 2;
  const Point p = at(x);
  // The gain by a difference; a factor of two in it does not matter.
  const Real h = std::max(Real(1e-9), Real(1e-3) * (end_x_ - x));
  const Point q = at(x - h);
  const Real rise = (q.overlap - p.overlap) + compliance_ * (q.load - p.load);
  return {p.overlap, p.load, std::fabs(q.load - p.load) / std::max(rise, Real(1e-300))};
}

MdWalk::State MdWalk::outside(Real z) const {
  if (!van_der_waals_) return {z, 0, 0};
  Real low = end_gap_;
  Real high = 2 * end_gap_ + 2 + eta_ * std::fabs(z) * 2;
  for (int i = 0; i < 130; ++i) {
    const Real mid = (low + high) / 2;
    (held_at_gap(mid) > z ? low : high) = mid;
  }
  const Real y = (low + high) / 2;
  // dP/dy = 4/y^3, dZ/dy = −1/eta + 4 c/y^3
  const Real load_rate = 4 / (y * y * y);
  return {(1 - y) / eta_, -2 / (y * y),
          load_rate / std::max(Real(1e-300), std::fabs(1 / eta_ - compliance_ * load_rate))};
}

}  // namespace telenano::oracle
