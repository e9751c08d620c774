#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "telenano/nve_server/physics/law/long_range_piece.h"

namespace telenano::physics {

/// What ends a piece of the law with long-range terms.
enum class LongRangeBorder : std::uint8_t {
  kNone,
  kTouch,     ///< overlap 0, where G becomes constant
  kOnset,     ///< of contact
  kForm,      ///< of a bridge
  kRupture,   ///< of the bridge
  kHandIn,    ///< the handover to the curve (without van der Waals: the range of the Dugdale stress)
  kHandOut,   ///< the handover from the curve, where it is reversible
  kCurveEnd,  ///< the end of the curve, where it is not
};

/// Where the smooth pieces end, and what happens there.
///
/// The total law F(delta) has memory: outside or inside, bridge or none. It is smooth between
///   outside  the bridge's formation (going in) or rupture (going out), the handover to the curve;
///   inside   the same two, the onset of contact, the overlap 0, and on the way out the handover, if it is
///            reversible, or the end of the curve.
/// Handover, onset and overlap 0 are passed with a continuous force; the others change the force at a given
/// overlap. When a bridge changes the medium, the tip stays at its overlap, inside if the new curve has it.
/// In contact a bridge forms at overlap 0, or not at all where the potential would rise by it.
class LongRangeBorders {
 public:
  using Border = LongRangeBorder;
  struct Bound {
    Border border = Border::kNone;
    double x = 0;
  };
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();

  explicit LongRangeBorders(LongRangePiece& piece) noexcept : piece_(piece) {}

  double hand_in_overlap_nm() noexcept {
    return piece_.scales().overlap_nm *
           (piece_.has_van_der_waals() ? piece_.handover().inside.overlap : -piece_.curve().range());
  }
  /// Overlap of the bridge's formation. Outside where the films meet, in contact at overlap 0; one that is
  /// pressed dry stays so until it has been drawn out again, however the radius changes.
  double formation_nm() const noexcept {
    const TipPlace& place = piece_.place();
    if (!piece_.long_range().has_bridge() || place.bridge.present) return kInfinity;
    if (place.inside) return place.pressed || refused_inside_ ? kInfinity : 0.0;
    return refused_outside_ ? kInfinity : piece_.long_range().formation_overlap_nm(piece_.radius_nm());
  }
  double rupture_nm() const noexcept {
    const BridgeState& bridge = piece_.place().bridge;
    return bridge.present ? -bridge.rupture_gap_nm : -kInfinity;
  }
  bool hands_out() noexcept { return piece_.has_van_der_waals() && piece_.parting().reversible; }

  /// The next border of the piece from where the tip is; of two at one place the bridge's comes first.
  Bound next(int direction) noexcept {
    const TipPlace& place = piece_.place();
    const double form = formation_nm();
    const double rupture = rupture_nm();
    if (!place.inside) {
      if (direction < 0) {
        if (place.bridge.present) return {Border::kRupture, std::min(rupture, place.x)};
        return {};
      }
      const double hand = hand_in_overlap_nm();
      if (form <= hand) return {Border::kForm, std::max(form, place.x)};
      return {Border::kHandIn, std::max(hand, place.x)};
    }
    if (direction > 0) {
      if (place.pressed) {
        if (form < kInfinity) return {Border::kForm, place.x};
        return {};
      }
      Bound bound = inside_bound(Border::kTouch, 0.0, direction);
      if (form < kInfinity) bound = nearest(inside_bound(Border::kForm, form, direction), bound, direction);
      if (!place.contact) bound = nearest(bound, {Border::kOnset, 0.0}, direction);
      return bound;
    }
    Bound bound = curve_end();
    const bool has_onset = place.contact && !curve_end_in_contact();
    if (has_onset) bound = {Border::kOnset, 0.0};
    if (place.pressed) bound = nearest(inside_bound(Border::kTouch, 0.0, direction), bound, direction);
    if (place.bridge.present)
      bound = nearest(inside_bound(Border::kRupture, rupture, direction), bound, direction);
    return bound;
  }

  /// Puts the tip on the piece behind the border.
  void cross(Border border) noexcept {
    const double overlap = piece_.point().overlap_nm;
    switch (border) {
      case Border::kNone:
        return;
      case Border::kTouch:
        piece_.set_pressed(!piece_.place().pressed);
        piece_.put(piece_.place().x);
        return;
      case Border::kOnset:
        piece_.set_contact(!piece_.place().contact);
        piece_.put(0.0);
        return;
      case Border::kForm:
        form();
        return;
      case Border::kRupture:
        piece_.put(BridgeState{});
        resettle(overlap);
        return;
      case Border::kHandIn:
        piece_.put(piece_.has_van_der_waals() ? piece_.handover().inside
                                              : piece_.on_curve(hand_in_overlap_nm()));
        return;
      case Border::kHandOut:
      case Border::kCurveEnd:
        piece_.put_outside(overlap);
        return;
    }
  }

 private:
  static constexpr double kEnergyRounding = 1e-10;  // where bridges form by the balance of energies

  static Bound nearest(Bound a, Bound b, int direction) noexcept {
    if (b.border == Border::kNone) return a;
    if (a.border == Border::kNone || direction * (b.x - a.x) < 0) return b;
    return a;
  }

  /// The border at an overlap, as a parameter of the present part of the curve; none if it lies on the other.
  Bound inside_bound(Border border, double overlap_nm, int direction) noexcept {
    const double here = piece_.place().x;
    if (direction * (overlap_nm - piece_.point().overlap_nm) <= 0) return {border, here};
    const CurveSolution s =
        piece_.curve().solve(overlap_nm / piece_.scales().overlap_nm, {1.0, 0.0}, piece_.cache().u);
    if (s.status == CurveStatus::kNoState || s.point.contact != piece_.place().contact) return {};
    const double x = s.point.parameter;
    return {border, direction * (x - here) < 0 ? here : x};
  }

  const CurvePoint& rigid_fold() noexcept {
    TipSampleCache& cache = piece_.cache();
    if (cache.fold_radius_nm != piece_.radius_nm()) {
      cache.rigid_fold = cache.curve.fold({1.0, 0.0});
      cache.fold_radius_nm = piece_.radius_nm();
    }
    return cache.rigid_fold;
  }
  bool curve_end_in_contact() noexcept {
    return hands_out() ? piece_.parting().end.contact : rigid_fold().contact;
  }
  Bound curve_end() noexcept {
    const double here = piece_.place().x;
    if (hands_out()) return {Border::kHandOut, std::min(piece_.parting().end.parameter, here)};
    return {Border::kCurveEnd, std::min(rigid_fold().parameter, here)};
  }

  /// The same overlap after the medium has changed: inside if the curve has it, outside if it lies before the
  /// handover.
  void resettle(double overlap_nm) noexcept {
    if (piece_.place().inside) {
      const CurveSolution s = piece_.curve().solve(overlap_nm / piece_.scales().overlap_nm, {1.0, 0.0}, 0);
      const bool beyond = hands_out() && s.point.parameter <= piece_.parting().end.parameter;
      if (s.status == CurveStatus::kOk && !beyond) {
        piece_.put(s.point);
        return;
      }
      piece_.put_outside(overlap_nm);
    } else if (overlap_nm >= hand_in_overlap_nm()) {
      piece_.put(piece_.on_curve(overlap_nm));
    } else {
      piece_.put(overlap_nm);
    }
  }

  /// The bridge forms where the potential falls by it; else the tip goes on without.
  void form() noexcept {
    const TipPlace place = piece_.place();
    const TipPoint point = piece_.point();
    const double radius_nm = piece_.radius_nm();
    const double before = piece_.potential_aj(point);
    const double gap = place.inside ? 0.0 : -piece_.long_range().formation_overlap_nm(radius_nm);
    piece_.put(piece_.long_range().capillary().formed_at(gap, radius_nm));
    resettle(point.overlap_nm);
    const double after = piece_.potential_aj(piece_.point());
    if (after <= before + kEnergyRounding * (std::fabs(before) + std::fabs(after))) return;
    piece_.put(BridgeState{});
    piece_.restore(place, point);
    (place.inside ? refused_inside_ : refused_outside_) = true;
  }

  LongRangePiece& piece_;
  bool refused_outside_ = false;  // in this step, by the potential
  bool refused_inside_ = false;
};

}  // namespace telenano::physics
