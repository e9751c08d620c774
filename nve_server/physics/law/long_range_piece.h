#pragma once

#include <algorithm>

#include "telenano/nve_server/physics/law/contact_medium.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "telenano/nve_server/physics/law/warm_start.h"
#include "telenano/nve_server/physics/long_range/long_range.h"

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

/// The tip on one smooth piece of the law with long-range terms G (long_range.h), on a spring of compliance c:
/// the total law there and its potential. With the bridge the medium changes (contact_medium.h): the curve,
/// its scales and van der Waals are other ones.
class LongRangePiece {
 public:
  /// The cache is in the medium of the bridge that begin() is given.
  LongRangePiece(double compliance_nm_nn, const ContactMedia& media, double cut_off_nm,
                 const LongRange& long_range, TipSampleCache& cache) noexcept
      : compliance_(compliance_nm_nn),
        media_(media),
        vdw_(media.of(cache.wet).van_der_waals()),
        cut_off_(cut_off_nm),
        far_(long_range),
        cache_(cache),
        scales_(cache.scales),
        radius_(cache.radius_nm),
        held_(held_now()) {}

  /// Where the tip was before the step.
  void begin(bool inside, double overlap_nm, const BridgeState& bridge) noexcept {
    place_.inside = inside;
    place_.bridge = far_.has_bridge() ? bridge : BridgeState{};
    place_.pressed = inside && overlap_nm >= 0;
  }

  const TipPlace& place() const noexcept { return place_; }
  const TipPoint& point() const noexcept { return point_; }

  double compliance_nm_nn() const noexcept { return compliance_; }
  double cut_off_nm() const noexcept { return cut_off_; }
  double radius_nm() const noexcept { return radius_; }
  const LongRange& long_range() const noexcept { return far_; }
  const VanDerWaals& van_der_waals() const noexcept { return vdw_; }
  bool has_van_der_waals() const noexcept { return vdw_.hamaker_aj > 0; }
  bool rigid() const noexcept { return compliance_ == 0; }
  TipSampleCache& cache() noexcept { return cache_; }
  const MaugisDugdale& curve() const noexcept { return cache_.curve; }
  const ContactScales& scales() const noexcept { return scales_; }
  const Held& held() const noexcept { return held_; }
  const Handover& handover() noexcept { return cached_handover(cache_.curve, cache_); }
  const Parting& parting() noexcept { return cached_parting(cache_.curve, cache_); }

  /// The law on the present piece.
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
  bool stable(const TipPoint& t) const noexcept { return t.overlap_rate > 0 && t.base_rate > 0; }

  /// G at touch, with the present bridge; what makes or breaks one forgets it.
  const LongRange::Touch& touch() const noexcept {
    if (!has_touch_) {
      touch_ = far_.at_touch(radius_, place_.bridge);
      has_touch_ = true;
    }
    return touch_;
  }

  CurvePoint on_curve(double overlap_nm) const noexcept {
    return cache_.curve.solve(overlap_nm / scales_.overlap_nm, {1.0, 0.0}, cache_.u).point;
  }

  double potential_aj(const TipPoint& t) noexcept {
    return potential_aj(t, place_.inside && has_van_der_waals() ? parting().energy_offset : 0.0);
  }
  /// `offset`: what the way inside adds to the curve's energy, without dimensions.
  double potential_aj(const TipPoint& t, double offset) noexcept {
    double energy = t.overlap_nm < 0 ? far_.energy_aj(t.overlap_nm, radius_, place_.bridge)
                                     : touch().energy_aj + t.overlap_nm * touch().force_nn;
    if (!place_.inside) return energy + vdw_.energy_aj(radius_, cut_off_ - t.overlap_nm);
    return energy + (t.curve.energy + offset) * scales_.energy_aj;
  }
  /// With the spring's, the base at z.
  double energy_aj(const TipPoint& t, double z) noexcept {
    const double stretch = z - t.overlap_nm;
    return potential_aj(t) + (rigid() ? 0.0 : 0.5 * stretch * stretch / compliance_);
  }

  // ---- Moves along the piece.

  void put(double x) noexcept { put(x, at(x)); }
  /// `t`: the law at x, where that is known.
  void put(double x, const TipPoint& t) noexcept {
    place_.x = x;
    point_ = t;
  }
  /// Pressed: a balance on the curve beside a constant force.
  void put_pressed(const CurvePoint& p, double far_force_nn) noexcept {
    place_.contact = p.contact;
    place_.x = p.parameter;
    point_.curve = p;
    point_.overlap_nm = p.overlap * scales_.overlap_nm;
    point_.overlap_rate = p.overlap_rate * scales_.overlap_nm;
    point_.force_nn = p.load * scales_.force_nn + far_force_nn;
    point_.force_rate = p.load_rate * scales_.force_nn;
    point_.base_nm = point_.overlap_nm + compliance_ * point_.force_nn;
    point_.base_rate = point_.overlap_rate + compliance_ * point_.force_rate;
  }

  // ---- Moves to another piece.

  void put(const CurvePoint& p) noexcept {
    place_.inside = true;
    place_.contact = p.contact;
    put(p.parameter);
  }
  void put_outside(double overlap_nm) noexcept {
    place_.inside = place_.contact = place_.pressed = false;
    put(overlap_nm);
  }
  void set_contact(bool contact) noexcept { place_.contact = contact; }
  void set_pressed(bool pressed) noexcept { place_.pressed = pressed; }
  /// Makes or breaks a bridge, and changes the medium by it. The tip is still to be put somewhere.
  void put(const BridgeState& bridge) noexcept {
    place_.bridge = bridge;
    has_touch_ = false;
    if (bridge.present == cache_.wet) return;
    enter(media_, bridge.present, radius_, cache_);
    vdw_ = media_.of(bridge.present).van_der_waals();
    held_ = held_now();
  }
  /// Back to where it was, after the bridge has been put back.
  void restore(const TipPlace& place, const TipPoint& point) noexcept {
    place_ = place;
    point_ = point;
  }

 private:
  Held held_now() const noexcept { return {1.0, compliance_ * (scales_.force_nn / scales_.overlap_nm)}; }

  double compliance_;
  const ContactMedia& media_;
  VanDerWaals vdw_;
  double cut_off_;
  const LongRange& far_;
  TipSampleCache& cache_;
  const ContactScales& scales_;
  double radius_;
  Held held_;
  TipPlace place_;
  TipPoint point_;
  mutable LongRange::Touch touch_;
  mutable bool has_touch_ = false;
};

}  // namespace telenano::physics
