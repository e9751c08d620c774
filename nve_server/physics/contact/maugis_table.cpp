#include "telenano/nve_server/physics/contact/maugis_table.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

#include "telenano/nve_server/physics/numerics/numbers.h"
#include "telenano/nve_server/physics/numerics/sign_change.h"

namespace telenano::physics {
namespace {

constexpr Held kOverlap{1.0, 0.0};

using Cubic = std::array<double, 4>;

double slope(const Cubic& c, double x) noexcept {
  return c[1] + x * (2.0 * c[2] + x * 3.0 * c[3]);
}

/// int_0^x c(x) 2 (left + width x) width dx
double work(const Cubic& c, double left, double width, double x) noexcept {
  const double flat = x * (c[0] + x * (c[1] / 2.0 + x * (c[2] / 3.0 + x * (c[3] / 4.0))));
  const double ramp = x * x * (c[0] / 2.0 + x * (c[1] / 3.0 + x * (c[2] / 4.0 + x * (c[3] / 5.0))));
  return 2.0 * width * (left * flat + width * ramp);
}

void hermite(Cubic& c, double y0, double y1, double d0, double d1) noexcept {
  c[0] = y0;
  c[1] = d0;
  c[2] = 3.0 * (y1 - y0) - 2.0 * d0 - d1;
  c[3] = 2.0 * (y0 - y1) + d0 + d1;
}

}  // namespace

MaugisTable::MaugisTable(double lambda) : exact_(lambda) {
  const CurvePoint fold = exact_.fold(kOverlap);
  fold_in_contact_ = fold.contact;
  start_ = fold_in_contact_ ? fold : exact_.contact(0);
  segments_.reserve(1 + kCells);
  loads_.reserve(1 + kCells);
  const auto at = [&](double t) { return exact_.solve(start_.overlap + t * t, kOverlap).point; };
  // The first segment begins at the fold or the onset, where the rates over t are limits: from three values,
  // which over 1.5e-5 leaves nothing to see.
  const double first = std::ldexp(1.0, kFirstOctave);
  const CurvePoint half = at(0.5 * first);
  CurvePoint left = at(first);
  const auto limit = [&](double y0, double y1, double y2) { return (4.0 * y1 - 3.0 * y0 - y2) / first; };
  append(0.0, first, start_, left, limit(start_.load, half.load, left.load),
         limit(start_.contact_radius, half.contact_radius, left.contact_radius));
  const auto load_slope = [](const CurvePoint& p, double t) {
    return p.load_rate / p.overlap_rate * 2.0 * t;
  };
  const auto radius_slope = [](const CurvePoint& p, double t) {
    return p.contact_radius_rate / p.overlap_rate * 2.0 * t;
  };
  double t = first;
  for (int i = 0; i < kOctaves * kPerOctave; ++i) {
    const double next = std::ldexp(1.0 + static_cast<double>((i + 1) % kPerOctave) / kPerOctave,
                                   kFirstOctave + (i + 1) / kPerOctave);
    const CurvePoint right = at(next);
    append(t, next, left, right, load_slope(left, t), radius_slope(left, t));
    left = right;
    t = next;
  }
  end_ = t;
  join_van_der_waals();
}

void MaugisTable::append(double left, double right, const CurvePoint& at_left, const CurvePoint& at_right,
                         double load_slope_left, double radius_slope_left) {
  Segment s{};
  s.left = left;
  s.width = right - left;
  s.per_width = 1.0 / s.width;
  const double over = 2.0 * right * s.width / at_right.overlap_rate;
  Cubic load{};
  hermite(load, at_left.load, at_right.load, load_slope_left * s.width, at_right.load_rate * over);
  hermite(s.radius, at_left.contact_radius, at_right.contact_radius, radius_slope_left * s.width,
          at_right.contact_radius_rate * over);
  s.energy = start_.energy;
  if (!segments_.empty()) {
    const Segment& before = segments_.back();
    s.energy = before.energy + work(loads_.back(), before.left, before.width, 1.0);
  }
  segments_.push_back(s);
  loads_.push_back(load);
}

void MaugisTable::join_van_der_waals() noexcept {
  const OutsideLaw outside(lambda());
  handover_ = find_handover(exact_, outside);
  parting_ = handover_.reversible ? parting_at(handover_, outside) : parting_at_fold(fold(kOverlap), outside);
  if (!handover_.inside.contact) return;
  double t = std::sqrt(std::max(0.0, handover_.inside.overlap - start_.overlap));
  for (int i = 0; i < 20; ++i) {
    // y - sqrt(-2/P) = 0 on the table's own curve, 1e-8 from the exact one.
    const CurvePoint p = contact(t);
    const double root = std::sqrt(-2.0 / p.load);
    const double step = -(outside.gap_of(p.overlap) - root) /
                        (-outside.eta() * p.overlap_rate + 0.5 * root * p.load_rate / p.load);
    t += step;
    if (std::fabs(step) <= 4.0 * kEpsilon * t) break;
  }
  handover_.inside = contact(t);
  handover_.gap = std::sqrt(-2.0 / handover_.inside.load);
}

std::size_t MaugisTable::segment_of(double t) const noexcept {
  const auto i = static_cast<std::int64_t>(std::bit_cast<std::uint64_t>(t) >> (52 - kPerOctaveBits)) + 1 -
                 static_cast<std::int64_t>(kFirstCell);
  return static_cast<std::size_t>(std::clamp<std::int64_t>(i, 0, static_cast<std::int64_t>(kCells)));
}

double MaugisTable::load_outside_cells(double overlap) const noexcept {
  return solve(overlap, kOverlap).point.load;
}

MaugisTable::Balance MaugisTable::balance(double t) const noexcept {
  const std::size_t i = segment_of(t);
  const Segment& s = segments_[i];
  const Cubic& load = loads_[i];
  const double x = (t - s.left) * s.per_width;
  return {start_.overlap + t * t, value(load, x), 2.0 * t, slope(load, x) * s.per_width};
}

void MaugisTable::contact(double t, CurvePoint& p) const noexcept {
  const std::size_t i = segment_of(t);
  const Segment& s = segments_[i];
  const Cubic& load = loads_[i];
  const double x = (t - s.left) * s.per_width;
  p = CurvePoint{};
  p.contact = true;
  p.parameter = t;
  p.overlap = start_.overlap + t * t;
  p.load = value(load, x);
  p.contact_radius = value(s.radius, x);
  p.overlap_rate = 2.0 * t;
  p.load_rate = slope(load, x) * s.per_width;
  p.contact_radius_rate = slope(s.radius, x) * s.per_width;
  p.energy = s.energy + work(load, s.left, s.width, x);
}

CurvePoint MaugisTable::fold(const Held& held) const noexcept {
  double radius = 0;
  if (exact_.fold_before_contact(held, &radius)) return exact_.noncontact(radius);
  if (held.load == 0) return contact(0);
  // dZ/dt rises from below zero through the fold, as the direct one.
  const auto rate = [&](double t) { return contact(t).held_rate(held); };
  // At the onset both rates over t vanish: look beside it.
  double lo = fold_in_contact_ ? 0.0 : segments_.front().width;
  double rate_lo = rate(lo);
  if (rate_lo >= 0) return contact(0);
  double hi = 1;
  double rate_hi = rate(hi);
  while (!(rate_hi > 0) && hi < end_) {
    lo = hi;
    rate_lo = rate_hi;
    hi *= 2;
    rate_hi = rate(hi);
  }
  SignChange fold{lo, rate_lo, hi, rate_hi};
  double last = hi;
  for (int i = 0; i < 100; ++i) {
    const double t = fold.between();
    if (std::fabs(t - last) <= 1e-9 * t) return contact(t);
    last = t;
    const double r = rate(t);
    if (r == 0) return contact(t);
    fold.take(t, r);
  }
  return contact(fold.positive);
}

CurveSolution MaugisTable::solve_directly(double z, const Held& held) const noexcept {
  CurveSolution out = exact_.solve(z, held);
  if (!out.point.contact) return out;
  // In the table's terms: its parameter, and an energy that goes on from the table's last.
  CurvePoint& p = out.point;
  const double t = std::sqrt(p.overlap - start_.overlap);
  const double per_t = 2.0 * t / p.overlap_rate;
  p.parameter = t;
  p.overlap_rate = 2.0 * t;
  p.load_rate *= per_t;
  p.contact_radius_rate *= per_t;
  return out;
}

void MaugisTable::solve(double z, const Held& held, double guess, CurveSolution& out) const noexcept {
  const CurvePoint& start = start_;
  double radius = 0;
  if (z <= start.held(held) && exact_.fold_before_contact(held, &radius)) {
    out = exact_.solve(z, held);
    return;
  }
  out.status = CurveStatus::kOk;
  out.evaluations = 1;
  if (held.load == 0) {
    const double above = z / held.overlap - start.overlap;
    if (above < 0) {
      out.status = CurveStatus::kNoState;
      contact(0, out.point);
      return;
    }
    const double t = std::sqrt(above);
    if (t >= end_) {
      out = solve_directly(z, held);
    } else {
      contact(t, out.point);
    }
    return;
  }
  double lo = 0;
  double hi = end_;
  double t = guess;
  if (!(guess > 0 && guess < end_)) t = std::clamp(std::sqrt(std::max(z - start.held(held), 1.0)), 0.1, end_);
  double last = t;
  bool fold_known = false;
  for (; out.evaluations <= 100; ++out.evaluations) {
    const Balance p = balance(t);
    const double rate = p.held_rate(held);
    if (!(rate > 0)) {
      if (fold_known) {  // at the fold to rounding
        contact(t, out.point);
        return;
      }
      const CurvePoint end = fold(held);
      fold_known = true;
      const double above = z - end.held(held);
      if (above <= 0) {
        out.point = end;
        if (above < 0) out.status = CurveStatus::kNoState;
        return;
      }
      lo = end.parameter;
      const double near = 1e-4 * std::max(lo, 1e-4);
      last = t;
      t = std::min(lo + std::sqrt(2.0 * above * near / balance(lo + near).held_rate(held)), 0.5 * (lo + hi));
      continue;
    }
    const double residual = p.held(held) - z;
    const double step = -residual / rate;
    const double scale = held.overlap * (std::fabs(start.overlap) + t * t) + held.load * std::fabs(p.load);
    if (std::fabs(residual) <= kEpsilon * scale || std::fabs(step) <= 4.0 * kEpsilon * t) {
      contact(t, out.point);
      return;
    }
    if (residual < 0) {
      lo = std::max(lo, t);
    } else {
      hi = std::min(hi, t);
    }
    double next = t + step;
    if (!(next < hi)) {
      if (hi == end_ && balance(end_).held(held) < z) {
        out = solve_directly(z, held);
        return;
      }
      next = std::min(0.5 * (t + hi), 3.0 * t + 1.0);
    }
    if (next < lo || next <= 0) next = 0.5 * (t + lo);
    if (next == t) {
      contact(t, out.point);
      return;
    }
    last = t;
    t = next;
  }
  contact(last, out.point);
  out.status = CurveStatus::kNotConverged;
}

}  // namespace telenano::physics
