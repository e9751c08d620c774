#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "telenano/nve_server/physics/law/contact_medium.h"
#include "telenano/nve_server/physics/law/warm_start.h"
#include "telenano/nve_server/physics/long_range/long_range.h"
#include "telenano/nve_server/physics/numerics/sign_change.h"

namespace telenano::physics {

/// Where a tip with long-range forces is: on one smooth piece of the total law.
struct TipPlace {
  bool inside = false;   ///< on the contact law's curve
  bool contact = false;  ///< inside: contact or not (the curve is parametrized anew at the onset)
  bool pressed = false;  ///< inside: overlap >= 0, where G is constant
  BridgeState bridge;
  double x = 0;  ///< outside the overlap (nm), inside the curve's parameter
};

/// The total law at one point of a piece.
struct TipPoint {
  double overlap_nm = 0;
  double force_nn = 0;
  double base_nm = 0;       ///< Z = overlap + compliance * force
  double overlap_rate = 0;  ///< d(overlap)/dx, > 0 on the pieces
  double force_rate = 0;
  double base_rate = 0;  ///< dZ/dx; the tip is stable where > 0
  CurvePoint curve;

  void shift(double dx) noexcept {
    overlap_nm += overlap_rate * dx;
    force_nn += force_rate * dx;
    base_nm += base_rate * dx;
    curve.shift(dx);
  }
};

/// One step of the law with long-range terms G (long_range.h), on a spring of compliance c.
///
/// Pieces. The total law F(delta) has memory: outside or inside, bridge or none. It is smooth between
///   outside  the bridge's formation (going in) or rupture (going out), the handover to the curve (without
///            van der Waals: the range of the Dugdale stress);
///   inside   the same two, the onset of contact, the overlap 0 (where G becomes constant), and on the way
///            out the handover, if it is reversible, or the end of the curve.
/// Handover, onset and overlap 0 are passed with a continuous force; the others change the force at a given
/// overlap. With the bridge the medium changes (contact_medium.h): the curve, its scales and van der Waals
/// are other ones, and the tip stays at its overlap, inside if the new curve has it. In contact a bridge
/// forms at overlap 0, or not at all where the potential would rise by it. Stability. Z(x) = delta + c F
/// rises along x where the tip is stable. On one piece the slope dF/d(delta) of the contact law is a concave
/// function of delta, that of G falls with it and is concave, too (long_range.h; outside it is the only one):
/// so the slope is concave, the stable part of a piece is one interval, and Z has at most one minimum and
/// after it one maximum. Hence two stable points of one piece have no fold between them (what lets the quick
/// ways skip the walk), and first_balance() finds the first root that a falling tip meets. Walk. The base
/// goes from where the tip was in balance to its new place; the tip follows to the end of the piece, or of
/// its stable part. A fold or a change of force sets it free: at that base it moves with the net force,
/// through whatever pieces come, to the first balance (overdamped: never past a minimum), and what U + (Z -
/// delta)^2/2c has lost is dissipated. `Cache` is TipSampleCache: curve (contact, noncontact, fold, solve,
/// range, onset_radius), scales, outside.
template <class Cache>
class LongRangeStep {
 public:
  /// The cache is in the medium of the bridge that run() is given.
  LongRangeStep(double base_nm, double compliance_nm_nn, const ContactMedia& media, double cut_off_nm,
                const LongRange& long_range, Cache& cache) noexcept
      : base_(base_nm),
        compliance_(compliance_nm_nn),
        media_(media),
        vdw_(media.of(cache.wet).van_der_waals()),
        cut_off_(cut_off_nm),
        far_(long_range),
        cache_(cache),
        scales_(cache.scales),
        radius_(cache.radius_nm),
        held_(held()) {}

  /// From the overlap where the tip was, inside or outside, with or without bridge. False: not converged.
  bool run(bool inside, double overlap_nm, const BridgeState& bridge) noexcept {
    place_.inside = inside;
    place_.bridge = far_.has_bridge() ? bridge : BridgeState{};
    place_.pressed = inside && overlap_nm >= 0;
    const bool quick =
        inside ? (place_.pressed ? quick_pressed() : quick_neck(overlap_nm)) : quick_outside(overlap_nm);
    if (!quick) {
      if (!begin(overlap_nm) || !walk()) return false;
    }
    keep();
    return true;
  }

  const TipPlace& place() const noexcept { return place_; }
  const TipPoint& point() const noexcept { return point_; }
  /// Inside less `joining_energy_aj` of the law.
  double potential_before_joining_aj() noexcept { return potential(point_, 0.0); }
  double dissipated_aj() const noexcept { return dissipated_; }
  int jumps() const noexcept { return jumps_; }

 private:
  enum class Border { kNone, kTouch, kOnset, kForm, kRupture, kHandIn, kHandOut, kCurveEnd };
  struct Bound {
    Border border = Border::kNone;
    double x = 0;
  };
  static constexpr double kEpsilon = std::numeric_limits<double>::epsilon();
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();
  static constexpr double kEnergyRounding = 1e-10;  // where bridges form by the balance of energies
  static constexpr int kMostBorders = 64;  // eight pieces; more means that rounding sends the tip to and fro

  bool has_vdw() const noexcept { return vdw_.hamaker_aj > 0; }
  bool rigid() const noexcept { return compliance_ == 0; }
  const Handover& handover() noexcept { return cached_handover(cache_.curve, cache_); }
  const Parting& parting() noexcept { return cached_parting(cache_.curve, cache_); }
  double hand_in_overlap() noexcept {
    return scales_.overlap_nm * (has_vdw() ? handover().inside.overlap : -cache_.curve.range());
  }
  /// Outside where the films meet, in contact at overlap 0; one that is pressed dry stays so until it has
  /// been drawn out again, however the radius changes.
  double formation() const noexcept {
    if (!far_.has_bridge() || place_.bridge.present) return kInfinity;
    if (place_.inside) return place_.pressed || refused_inside_ ? kInfinity : 0.0;
    return refused_outside_ ? kInfinity : far_.formation_overlap_nm(radius_);
  }
  double rupture() const noexcept {
    return place_.bridge.present ? -place_.bridge.rupture_gap_nm : -kInfinity;
  }

  // ---- The law on the present piece.

  TipPoint at(double x) const noexcept {
    TipPoint t;
    LongRangePoint g;
    if (!place_.inside) {
      const double gap = cut_off_ - x;
      g = far_.evaluate_open(x, radius_, place_.bridge);
      t.overlap_nm = x;
      t.overlap_rate = 1;
      t.force_nn = vdw_.force_nn(radius_, gap) + g.force_nn;
      t.force_rate = vdw_.stiffness_n_m(radius_, gap) + g.stiffness_n_m;
    } else {
      t.curve =
          place_.contact ? cache_.curve.contact(x) : cache_.curve.noncontact(x + cache_.curve.onset_radius());
      t.overlap_nm = t.curve.overlap * scales_.overlap_nm;
      t.overlap_rate = t.curve.overlap_rate * scales_.overlap_nm;
      g = place_.pressed ? LongRangePoint{touch().force_nn, 0.0}
                         : far_.evaluate_open(std::min(t.overlap_nm, 0.0), radius_, place_.bridge);
      t.force_nn = t.curve.load * scales_.force_nn + g.force_nn;
      t.force_rate = t.curve.load_rate * scales_.force_nn + g.stiffness_n_m * t.overlap_rate;
    }
    t.base_nm = t.overlap_nm + compliance_ * t.force_nn;
    t.base_rate = t.overlap_rate + compliance_ * t.force_rate;
    return t;
  }

  /// Of the present bridge; what makes or breaks one forgets it.
  const LongRange::Touch& touch() const noexcept {
    if (!has_touch_) {
      touch_ = far_.at_touch(radius_, place_.bridge);
      has_touch_ = true;
    }
    return touch_;
  }
  Held held() const noexcept { return {1.0, compliance_ * (scales_.force_nn / scales_.overlap_nm)}; }
  void put(const BridgeState& bridge) noexcept {
    place_.bridge = bridge;
    has_touch_ = false;
    if (bridge.present == cache_.wet) return;
    enter(media_, bridge.present, radius_, cache_);
    vdw_ = media_.of(bridge.present).van_der_waals();
    held_ = held();
  }

  /// The same overlap after the medium has changed: inside if the curve has it, outside if it lies before the
  /// handover.
  void resettle(double overlap_nm) noexcept {
    if (place_.inside) {
      const CurveSolution s = cache_.curve.solve(overlap_nm / scales_.overlap_nm, {1.0, 0.0}, 0);
      const bool beyond = hands_out() && s.point.parameter <= parting().end.parameter;
      if (s.status == CurveStatus::kOk && !beyond) {
        put(s.point);
        return;
      }
      place_.inside = place_.contact = place_.pressed = false;
      put(overlap_nm);
    } else if (overlap_nm >= hand_in_overlap()) {
      put(on_curve(overlap_nm));
    } else {
      put(overlap_nm);
    }
  }

  /// The bridge forms where the potential falls by it; else the tip goes on without.
  void form() noexcept {
    const TipPlace place = place_;
    const TipPoint point = point_;
    const double before = potential(point_);
    const double gap = place.inside ? 0.0 : -far_.formation_overlap_nm(radius_);
    put(far_.capillary().formed_at(gap, radius_));
    resettle(point.overlap_nm);
    const double after = potential(point_);
    if (after <= before + kEnergyRounding * (std::fabs(before) + std::fabs(after))) return;
    put(BridgeState{});
    place_ = place;
    point_ = point;
    (place.inside ? refused_inside_ : refused_outside_) = true;
  }

  double potential(const TipPoint& t) noexcept {
    return potential(t, place_.inside && has_vdw() ? parting().energy_offset : 0.0);
  }
  double potential(const TipPoint& t, double offset) noexcept {
    double energy = t.overlap_nm < 0 ? far_.energy_aj(t.overlap_nm, radius_, place_.bridge)
                                     : touch().energy_aj + t.overlap_nm * touch().force_nn;
    if (!place_.inside) return energy + vdw_.energy_aj(radius_, cut_off_ - t.overlap_nm);
    return energy + (t.curve.energy + offset) * scales_.energy_aj;
  }
  /// With the spring's, the base at z.
  double energy(const TipPoint& t, double z) noexcept {
    const double stretch = z - t.overlap_nm;
    return potential(t) + (rigid() ? 0.0 : 0.5 * stretch * stretch / compliance_);
  }
  void lose(double before, double after) noexcept {
    ++jumps_;
    dissipated_ += std::max(0.0, before - after);
  }
  bool stable(const TipPoint& t) const noexcept { return t.overlap_rate > 0 && t.base_rate > 0; }

  void put(double x) noexcept {
    place_.x = x;
    point_ = at(x);
  }
  void put(const CurvePoint& p) noexcept {
    place_.inside = true;
    place_.contact = p.contact;
    put(p.parameter);
  }
  CurvePoint on_curve(double overlap_nm) const noexcept {
    return cache_.curve.solve(overlap_nm / scales_.overlap_nm, {1.0, 0.0}, cache_.u).point;
  }

  // ---- The quick ways: the new balance lies on the same piece.

  bool quick_outside(double overlap_nm) noexcept {
    const double low = rupture();
    double high = std::min(formation(), 0.0);
    const bool near_last = cache_.far_radius_nm == radius_ && cache_.far_compliance == compliance_ &&
                           !rigid() && cache_.far_base_rate > 0;
    double x = base_;
    if (near_last) x = overlap_nm + (base_ - cache_.far_base_nm) / cache_.far_base_rate;
    if (!(x < 0)) x = base_;
    if (!(x < 0)) return false;
    for (int i = 0; i < 30; ++i) {
      TipPoint t = at(x);
      if (!(t.base_rate > 0)) {
        if (x == base_) return false;
        x = base_;  // Z <= delta, and it is concave: from here Newton's method climbs to the root if there is
                    // one
        continue;
      }
      const double step = (base_ - t.base_nm) / t.base_rate;
      if (std::fabs(step) <= 1e-8 * (cut_off_ - x)) {  // to first order: what is left out is 1e-16
        x += step;
        if (!(x >= low && x <= high)) return false;
        if (cut_off_ - x < kNoHandoverGap * cut_off_ || !has_vdw()) {
          if (x > hand_in_overlap()) return false;
        }
        t.shift(step);
        place_.x = x;
        point_ = t;
        return true;
      }
      x += step;
      if (!(x < 0)) return false;
    }
    return false;
  }

  bool quick_pressed() noexcept {
    if (formation() < kInfinity) return false;
    const double force = touch().force_nn;
    const double z = (base_ - compliance_ * force) / scales_.overlap_nm;
    const CurveSolution solution = solve_warm(cache_.curve, cache_, z, held_);
    if (solution.status != CurveStatus::kOk || !(solution.point.overlap >= 0)) return false;
    take(solution.point, force);
    remember(cache_.curve, cache_, solution.point);
    remembered_ = true;
    return true;
  }

  void take(const CurvePoint& p, double far_force) noexcept {
    place_.contact = p.contact;
    place_.x = p.parameter;
    point_.curve = p;
    point_.overlap_nm = p.overlap * scales_.overlap_nm;
    point_.overlap_rate = p.overlap_rate * scales_.overlap_nm;
    point_.force_nn = p.load * scales_.force_nn + far_force;
    point_.force_rate = p.load_rate * scales_.force_nn;
    point_.base_nm = point_.overlap_nm + compliance_ * point_.force_nn;
    point_.base_rate = point_.overlap_rate + compliance_ * point_.force_rate;
  }

  bool quick_neck(double overlap_nm) noexcept {
    if (cache_.far_radius_nm != radius_) {
      const CurveSolution last = cache_.curve.solve(overlap_nm / scales_.overlap_nm, {1.0, 0.0}, cache_.u);
      if (last.status != CurveStatus::kOk) return false;
      place_.contact = last.point.contact;
      place_.x = last.point.parameter;
    } else {
      place_.contact = cache_.far_contact;
      place_.x = cache_.far_parameter;
      if (cache_.far_compliance == compliance_ && cache_.far_base_rate > 0) {
        const double step = (base_ - cache_.far_base_nm) / cache_.far_base_rate;
        if (std::fabs(step) < 0.3 * std::fabs(place_.x)) place_.x += step;
      }
    }
    const double low = rupture();
    const double high = std::min(formation(), 0.0);
    double x = place_.x;
    for (int i = 0; i < 12; ++i) {
      TipPoint t = at(x);
      if (!stable(t)) return false;
      const double step = (base_ - t.base_nm) / t.base_rate;
      const double size = place_.contact ? x : x + cache_.curve.onset_radius();
      const bool close = std::fabs(step) <= 1e-8 * size;
      x += step;
      if (!(place_.contact ? x > 0 : x <= 0 && x > -cache_.curve.onset_radius())) return false;
      if (!close) continue;
      t.shift(step);
      if (!(t.overlap_nm >= low && t.overlap_nm <= high)) return false;
      if (!place_.contact && hands_out() && x < parting().end.parameter) {
        return false;
      }
      place_.x = x;
      point_ = t;
      return true;
    }
    return false;
  }

  // ---- The walk.

  /// Puts the tip where it was; a state that the present radius does not have is carried to the nearest one.
  bool begin(double overlap_nm) noexcept {
    remembered_ = false;
    if (far_.has_bridge()) {
      if (place_.bridge.present && overlap_nm < rupture()) put(BridgeState{});
    }
    place_.pressed = place_.inside && overlap_nm >= 0;
    if (place_.inside) {
      put(on_curve(overlap_nm));
    } else {
      put(std::min(overlap_nm, hand_in_overlap()));
    }
    z_ = point_.base_nm;
    if (rigid() || stable(point_)) return true;
    z_ = base_;
    return fall(base_ >= point_.base_nm ? 1 : -1, energy(point_, base_));
  }

  Bound nearest(Bound a, Bound b, int direction) const noexcept {
    if (b.border == Border::kNone) return a;
    if (a.border == Border::kNone || direction * (b.x - a.x) < 0) return b;
    return a;
  }

  /// The next border of the piece from where the tip is; of two at one place the bridge's comes first.
  Bound border(int direction) noexcept {
    const double form = formation();
    const double rupt = rupture();
    if (!place_.inside) {
      if (direction < 0) {
        if (place_.bridge.present) return {Border::kRupture, std::min(rupt, place_.x)};
        return {};
      }
      const double hand = hand_in_overlap();
      if (form <= hand) return {Border::kForm, std::max(form, place_.x)};
      return {Border::kHandIn, std::max(hand, place_.x)};
    }
    if (direction > 0) {
      if (place_.pressed) {
        if (form < kInfinity) return {Border::kForm, place_.x};
        return {};
      }
      Bound bound = inside_bound(Border::kTouch, 0.0, direction);
      if (form < kInfinity) bound = nearest(inside_bound(Border::kForm, form, direction), bound, direction);
      if (!place_.contact) bound = nearest(bound, {Border::kOnset, 0.0}, direction);
      return bound;
    }
    Bound bound = curve_end();
    const bool has_onset = place_.contact && !curve_end_in_contact();
    if (has_onset) bound = {Border::kOnset, 0.0};
    if (place_.pressed) bound = nearest(inside_bound(Border::kTouch, 0.0, direction), bound, direction);
    if (place_.bridge.present)
      bound = nearest(inside_bound(Border::kRupture, rupt, direction), bound, direction);
    return bound;
  }

  /// The border at an overlap, as a parameter of the present part of the curve; none if it lies on the other.
  Bound inside_bound(Border border, double overlap_nm, int direction) noexcept {
    if (direction * (overlap_nm - point_.overlap_nm) <= 0) return {border, place_.x};
    const CurveSolution s = cache_.curve.solve(overlap_nm / scales_.overlap_nm, {1.0, 0.0}, cache_.u);
    if (s.status == CurveStatus::kNoState || s.point.contact != place_.contact) return {};
    const double x = s.point.parameter;
    return {border, direction * (x - place_.x) < 0 ? place_.x : x};
  }

  const CurvePoint& rigid_fold() noexcept {
    if (cache_.fold_radius_nm != radius_) {
      cache_.rigid_fold = cache_.curve.fold({1.0, 0.0});
      cache_.fold_radius_nm = radius_;
    }
    return cache_.rigid_fold;
  }
  bool hands_out() noexcept { return has_vdw() && parting().reversible; }
  bool curve_end_in_contact() noexcept { return hands_out() ? parting().end.contact : rigid_fold().contact; }
  Bound curve_end() noexcept {
    if (hands_out()) return {Border::kHandOut, std::min(parting().end.parameter, place_.x)};
    return {Border::kCurveEnd, std::min(rigid_fold().parameter, place_.x)};
  }

  void cross(Border border) noexcept {
    const double overlap = point_.overlap_nm;
    switch (border) {
      case Border::kNone:
        return;
      case Border::kTouch:
        place_.pressed = !place_.pressed;
        break;
      case Border::kOnset:
        place_.contact = !place_.contact;
        place_.x = 0;
        break;
      case Border::kForm:
        form();
        return;
      case Border::kRupture:
        put(BridgeState{});
        resettle(overlap);
        return;
      case Border::kHandIn:
        put(has_vdw() ? handover().inside : on_curve(hand_in_overlap()));
        return;
      case Border::kHandOut:
      case Border::kCurveEnd:
        place_.inside = place_.contact = place_.pressed = false;
        place_.x = overlap;
        break;
    }
    put(place_.x);
  }

  bool walk() noexcept {
    const int direction = base_ >= z_ ? 1 : -1;
    for (int i = 0; i < kMostBorders; ++i) {
      if (z_ == base_ && i > 0 && stable(point_)) return true;
      const Bound bound = border(direction);
      if (bound.border == Border::kNone) return solve_open(base_, direction);
      TipPoint end = at(bound.x);
      double end_x = bound.x;
      const bool reached = rigid() || stable(end) || end_x == place_.x;
      if (!reached) {
        end_x = fold_between(place_.x, bound.x);
        end = at(end_x);
      }
      if (direction * (end.base_nm - base_) >= 0) {
        return solve_between(place_.x, end_x, base_);
      }
      place_.x = end_x;
      point_ = end;
      z_ = end.base_nm;
      const double before = energy(point_, z_);
      if (!reached) {
        if (!fall(direction, before)) return false;
        continue;
      }
      const double force = point_.force_nn;
      const bool had_bridge = place_.bridge.present;
      cross(bound.border);
      const double change = point_.force_nn - force;
      // The handover's overlap has rounding of u_delta, up to 1e-12 of the gap in nm for the softest samples.
      const bool jumps = std::fabs(change) > 1e-9 * (std::fabs(force) + scales_.force_nn);
      if (rigid()) {
        if (jumps) lose(before, energy(point_, z_));
      } else if (jumps) {
        if (!fall(change < 0 ? 1 : -1, before)) return false;
      } else if (!stable(point_)) {
        if (!fall(direction, before)) return false;
        continue;
      } else {
        z_ = point_.base_nm;
      }
      // Continuous in the force; in the potential only if the same way leads out again (joined_law.h).
      if (!jumps && bound.border == Border::kHandIn && has_vdw() && !handover().reversible) {
        dissipated_ += std::max(0.0, before - energy(point_, z_));
      }
      // Nor does a bridge that takes over just the force there was (rigid bodies, at touch).
      if (!jumps && place_.bridge.present != had_bridge) lose(before, energy(point_, z_));
    }
    return false;
  }

  /// The tip moves at the base z_ with the net force to the first balance.
  bool fall(int direction, double before) noexcept {
    for (int i = 0; i < kMostBorders; ++i) {
      const Bound bound = border(direction);
      bool found = false;
      if (bound.border == Border::kNone) {
        found = solve_open(z_, direction);
        if (!found) return false;
      } else {
        found = first_balance(bound.x, direction);
      }
      if (found) {
        lose(before, energy(point_, z_));
        return true;
      }
      put(bound.x);
      cross(bound.border);
      // Where the liquid goes the bodies attract each other more again: the net force may turn. Not for ever:
      // every change of medium has cost energy.
      if (bound.border == Border::kForm || bound.border == Border::kRupture) {
        if (direction * (z_ - point_.base_nm) < 0) direction = -direction;
      }
    }
    return false;
  }

  /// First x between here and `border_x` where Z = z_. On the way the net force (z_ - Z) points along
  /// `direction`; see the class for why there is one root, or none, before the end or the turning point
  /// taken.
  bool first_balance(double border_x, int direction) noexcept {
    const auto ahead = [&](const TipPoint& t) { return direction * (z_ - t.base_nm); };
    if (border_x == place_.x) return false;
    const TipPoint here = at(place_.x);
    const TipPoint end = at(border_x);
    double turn = border_x;
    const bool falls_here = !(here.base_rate > 0);
    if (ahead(end) > 0 && end.base_rate >= 0) return false;
    if (ahead(end) > 0 || (falls_here && end.base_rate < 0)) {
      double rising = place_.x;
      if (falls_here) {
        if (!place_.inside) return false;  // concave: it falls ever more
        rising = steepest(place_.x, border_x);
        if (!(at(rising).base_rate > 0)) return false;
      }
      turn = fold_between(rising, border_x);
      // From a fold the force grows with the square of the way: what is within rounding is the fold itself.
      const double rounding =
          8.0 * kEpsilon *
          (std::fabs(z_) + std::fabs(end.overlap_nm) + compliance_ * std::fabs(end.force_nn));
      if (ahead(at(turn)) > -rounding) return false;
    }
    return solve_between(place_.x, turn, z_);
  }

  /// Where the slope dZ/d(delta), concave, is greatest (golden section).
  double steepest(double from, double to) const noexcept {
    constexpr double kGolden = 0.6180339887498949;
    const auto slope = [&](double x) {
      const TipPoint t = at(x);
      return t.overlap_rate > 0 ? t.base_rate / t.overlap_rate : -kInfinity;
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

  /// The root of dZ/dx between a rising and a falling point (Anderson and Bjorck), outside in the inverse of
  /// the gap, of which the attraction's slope is some power. Z is stationary there.
  double fold_between(double rising, double falling) const noexcept {
    const auto inverse = [this](double x) { return place_.inside ? x : 1.0 / (cut_off_ - x); };
    const auto x_of = [this](double w) { return place_.inside ? w : cut_off_ - 1.0 / w; };
    const double floor = place_.inside ? 1e-3 * cache_.curve.onset_radius() : 0.0;
    SignChange fold{inverse(falling), at(falling).base_rate, inverse(rising), at(rising).base_rate};
    if (!(fold.positive_rate > 0 && fold.negative_rate < 0)) return falling;
    double last = fold.positive;
    for (int i = 0; i < 100; ++i) {
      const double a = fold.positive;
      const double b = fold.negative;
      double w = a + (b - a) * (fold.positive_rate / (fold.positive_rate - fold.negative_rate));
      if (i % 8 == 7) w = 0.5 * (a + b);
      if (std::fabs(w - last) <= 1e-10 * (std::fabs(w) + floor)) return x_of(w);
      last = w;
      const double rate = at(x_of(w)).base_rate;
      if (rate == 0) return x_of(w);
      fold.take(w, rate);
    }
    return x_of(last);
  }

  /// The one root of Z = z between two places that enclose it: Newton's method, halving where it leaves.
  bool solve_between(double from, double to, double z) noexcept {
    double low = std::min(from, to);
    double high = std::max(from, to);
    double x = place_.inside ? 0.5 * (low + high) : std::clamp(z, low, high);
    for (int i = 0; i < 200; ++i) {
      TipPoint t = at(x);
      const double left = z - t.base_nm;
      if (left > 0) low = x;
      if (left < 0) high = x;
      double next = x + left / t.base_rate;
      const double scale = std::fabs(x) + (place_.inside ? cache_.curve.onset_radius() * 1e-3 : cut_off_);
      if (left == 0 || high - low <= 2.0 * kEpsilon * scale ||
          (t.base_rate > 0 && std::fabs(next - x) <= 1e-9 * (place_.inside ? scale : cut_off_ - x))) {
        const double step = left == 0 || !(t.base_rate > 0) ? 0.0 : std::clamp(next, low, high) - x;
        t.shift(step);
        place_.x = x + step;
        point_ = t;
        z_ = z;
        return true;
      }
      if (!(t.base_rate > 0) || !(next > low && next < high)) next = 0.5 * (low + high);
      if (next == x) {
        place_.x = x;
        point_ = t;
        z_ = z;
        return true;
      }
      x = next;
    }
    return false;
  }

  /// On a piece without border ahead: going out, outside; going in, pressed.
  bool solve_open(double z, int direction) noexcept {
    if (direction < 0) return solve_between(std::min(z, place_.x), place_.x, z);  // Z <= delta
    const double force = touch().force_nn;
    const CurveSolution s = cache_.curve.solve((z - compliance_ * force) / scales_.overlap_nm, held_,
                                               place_.contact ? place_.x : 0);
    if (s.status == CurveStatus::kNotConverged) return false;
    take(s.point, force);
    z_ = z;
    return true;
  }

  /// For the next step's quick way.
  void keep() noexcept {
    cache_.far_radius_nm = radius_;
    cache_.far_compliance = compliance_;
    cache_.far_base_nm = base_;
    cache_.far_base_rate = point_.base_rate;
    cache_.far_contact = place_.contact;
    cache_.far_parameter = place_.x;
    if (place_.inside && !remembered_) {
      cache_.has_last = false;
      cache_.last = point_.curve;
      cache_.u = place_.contact ? place_.x : 0;
    }
  }

  double base_;
  double compliance_;
  const ContactMedia& media_;
  VanDerWaals vdw_;
  double cut_off_;
  const LongRange& far_;
  Cache& cache_;
  const decltype(Cache::scales)& scales_;
  double radius_;
  Held held_;
  TipPlace place_;
  TipPoint point_;
  mutable LongRange::Touch touch_;
  mutable bool has_touch_ = false;
  double z_ = 0;  // the base where the walk is
  double dissipated_ = 0;
  int jumps_ = 0;
  bool remembered_ = false;
  bool refused_outside_ = false;  // in this step, by the potential
  bool refused_inside_ = false;
};

}  // namespace telenano::physics
