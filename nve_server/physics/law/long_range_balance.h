#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "telenano/nve_server/physics/law/long_range_piece.h"
#include "telenano/nve_server/physics/numerics/numbers.h"
#include "telenano/nve_server/physics/numerics/sign_change.h"

namespace telenano::physics {

/// Balances and folds on one piece of the law with long-range terms.
///
/// Z(x) = delta + c F rises along x where the tip is stable. On one piece the slope dF/d(delta) of the contact
/// law is a concave function of delta, that of G falls with it and is concave, too (long_range.h; outside it
/// is the only one): so the slope is concave, the stable part of a piece is one interval, and Z has at most
/// one minimum and after it one maximum. Hence two stable points of one piece have no fold between them (what
/// lets the quick ways skip the walk), and first() finds the first root that a falling tip meets.
class LongRangeBalance {
 public:
  explicit LongRangeBalance(LongRangePiece& piece) noexcept : piece_(piece) {}

  /// Puts the tip at the first x between here and `border_x` where Z = z. On the way the net force (z - Z)
  /// points along `direction`; see the class for why there is one root, or none, before the end or the
  /// turning point taken.
  bool first(double border_x, double z, int direction) noexcept {
    const TipPlace& place = piece_.place();
    const auto ahead = [&](const TipPoint& t) { return direction * (z - t.base_nm); };
    if (border_x == place.x) return false;
    const TipPoint here = piece_.at(place.x);
    const TipPoint end = piece_.at(border_x);
    double turn = border_x;
    const bool falls_here = !(here.base_rate > 0);
    if (ahead(end) > 0 && end.base_rate >= 0) return false;
    if (ahead(end) > 0 || (falls_here && end.base_rate < 0)) {
      double rising = place.x;
      if (falls_here) {
        if (!place.inside) return false;  // concave: it falls ever more
        rising = steepest(place.x, border_x);
        if (!(piece_.at(rising).base_rate > 0)) return false;
      }
      turn = fold_between(rising, border_x);
      // From a fold the force grows with the square of the way: what is within rounding is the fold itself.
      const double rounding =
          8.0 * kEpsilon *
          (std::fabs(z) + std::fabs(end.overlap_nm) + piece_.compliance_nm_nn() * std::fabs(end.force_nn));
      if (ahead(piece_.at(turn)) > -rounding) return false;
    }
    return between(place.x, turn, z);
  }

  /// The root of dZ/dx between a rising and a falling point (Anderson and Bjorck), outside in the inverse of
  /// the gap, of which the attraction's slope is some power. Z is stationary there.
  double fold_between(double rising, double falling) const noexcept {
    const bool inside = piece_.place().inside;
    const double cut_off = piece_.cut_off_nm();
    const auto inverse = [=](double x) { return inside ? x : 1.0 / (cut_off - x); };
    const auto x_of = [=](double w) { return inside ? w : cut_off - 1.0 / w; };
    const double floor = inside ? 1e-3 * piece_.curve().onset_radius() : 0.0;
    SignChange fold{inverse(falling), piece_.at(falling).base_rate, inverse(rising),
                    piece_.at(rising).base_rate};
    if (!(fold.positive_rate > 0 && fold.negative_rate < 0)) return falling;
    double last = fold.positive;
    for (int i = 0; i < 100; ++i) {
      const double a = fold.positive;
      const double b = fold.negative;
      double w = a + (b - a) * (fold.positive_rate / (fold.positive_rate - fold.negative_rate));
      if (i % 8 == 7) w = 0.5 * (a + b);
      if (std::fabs(w - last) <= 1e-10 * (std::fabs(w) + floor)) return x_of(w);
      last = w;
      const double rate = piece_.at(x_of(w)).base_rate;
      if (rate == 0) return x_of(w);
      fold.take(w, rate);
    }
    return x_of(last);
  }

  /// Puts the tip at the one root of Z = z between two places that enclose it: Newton's method, halving where
  /// it leaves.
  bool between(double from, double to, double z) noexcept {
    const bool inside = piece_.place().inside;
    double low = std::min(from, to);
    double high = std::max(from, to);
    double x = inside ? 0.5 * (low + high) : std::clamp(z, low, high);
    for (int i = 0; i < 200; ++i) {
      TipPoint t = piece_.at(x);
      const double left = z - t.base_nm;
      if (left > 0) low = x;
      if (left < 0) high = x;
      double next = x + left / t.base_rate;
      const double scale =
          std::fabs(x) + (inside ? piece_.curve().onset_radius() * 1e-3 : piece_.cut_off_nm());
      if (left == 0 || high - low <= 2.0 * kEpsilon * scale ||
          (t.base_rate > 0 && std::fabs(next - x) <= 1e-9 * (inside ? scale : piece_.cut_off_nm() - x))) {
        const double step = left == 0 || !(t.base_rate > 0) ? 0.0 : std::clamp(next, low, high) - x;
        t.shift(step);
        piece_.put(x + step, t);
        return true;
      }
      if (!(t.base_rate > 0) || !(next > low && next < high)) next = 0.5 * (low + high);
      if (next == x) {
        piece_.put(x, t);
        return true;
      }
      x = next;
    }
    return false;
  }

  /// The same on a piece without border ahead: going out, outside; going in, pressed.
  bool open(double z, int direction) noexcept {
    const TipPlace& place = piece_.place();
    if (direction < 0) return between(std::min(z, place.x), place.x, z);  // Z <= delta
    const double force = piece_.touch().force_nn;
    const CurveSolution s =
        piece_.curve().solve((z - piece_.compliance_nm_nn() * force) / piece_.scales().overlap_nm,
                             piece_.held(), place.contact ? place.x : 0);
    if (s.status == CurveStatus::kNotConverged) return false;
    piece_.put_pressed(s.point, force);
    return true;
  }

 private:
  /// Where the slope dZ/d(delta), concave, is greatest (golden section).
  double steepest(double from, double to) const noexcept {
    constexpr double kGolden = 0.6180339887498949;
    const auto slope = [&](double x) {
      const TipPoint t = piece_.at(x);
      return t.overlap_rate > 0 ? t.base_rate / t.overlap_rate : -std::numeric_limits<double>::infinity();
    };
    double low = std::min(from, to);
    double high = std::max(from, to);
    double a = high - kGolden * (high - low);
    double b = low + kGolden * (high - low);
    double at_a = slope(a);
    double at_b = slope(b);
    for (int i = 0; i < 60 && high - low > 1e-9 * (std::fabs(low) + std::fabs(high)); ++i) {
      if (at_a > 0 || at_b > 0) break;  // any rising point will do
      if (at_a < at_b) {
        low = a;
        a = b;
        at_a = at_b;
        b = low + kGolden * (high - low);
        at_b = slope(b);
      } else {
        high = b;
        b = a;
        at_b = at_a;
        a = high - kGolden * (high - low);
        at_a = slope(a);
      }
    }
    return at_a > at_b ? a : b;
  }

  LongRangePiece& piece_;
};

}  // namespace telenano::physics
