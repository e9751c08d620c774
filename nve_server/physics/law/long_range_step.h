#pragma once

#include <algorithm>
#include <cmath>

#include "telenano/nve_server/physics/law/long_range_balance.h"
#include "telenano/nve_server/physics/law/long_range_borders.h"
#include "telenano/nve_server/physics/law/long_range_piece.h"
#include "telenano/nve_server/physics/law/long_range_quick.h"

namespace telenano::physics {

/// One step of the law with long-range terms G (long_range.h), on a spring of compliance c.
///
/// The total law consists of smooth pieces (long_range_piece.h) between borders (long_range_borders.h). The
/// base goes from where the tip was in balance to its new place; the tip follows to the end of the piece, or
/// of its stable part. A fold or a change of force sets it free: at that base it moves with the net force,
/// through whatever pieces come, to the first balance (overdamped: never past a minimum;
/// long_range_balance.h), and what U + (Z - delta)^2/2c has lost is dissipated. Where the tip stays on its
/// piece, which is nearly always, long_range_quick.h finds the balance without this walk.
class LongRangeStep {
 public:
  /// The cache is in the medium of the bridge that run() is given.
  LongRangeStep(double base_nm, double compliance_nm_nn, const ContactMedia& media, double cut_off_nm,
                const LongRange& long_range, TipSampleCache& cache) noexcept
      : base_(base_nm), piece_(compliance_nm_nn, media, cut_off_nm, long_range, cache) {}
  LongRangeStep(const LongRangeStep&) = delete;
  LongRangeStep& operator=(const LongRangeStep&) = delete;

  /// From the overlap where the tip was, inside or outside, with or without bridge. False: not converged.
  bool run(bool inside, double overlap_nm, const BridgeState& bridge) noexcept {
    piece_.begin(inside, overlap_nm, bridge);
    const bool pressed = piece_.place().pressed;
    LongRangeQuick quick(piece_, borders_, base_);
    if (inside ? (pressed ? quick.pressed() : quick.neck(overlap_nm)) : quick.outside(overlap_nm)) {
      keep(pressed);
      return true;
    }
    if (!begin(overlap_nm) || !walk()) return false;
    keep(false);
    return true;
  }

  const TipPlace& place() const noexcept { return piece_.place(); }
  const TipPoint& point() const noexcept { return piece_.point(); }
  /// Inside less `joining_energy_aj` of the law.
  double potential_before_joining_aj() noexcept { return piece_.potential_aj(point(), 0.0); }
  double dissipated_aj() const noexcept { return dissipated_; }
  int jumps() const noexcept { return jumps_; }

 private:
  using Border = LongRangeBorder;
  using Bound = LongRangeBorders::Bound;
  static constexpr int kMostBorders = 64;  // eight pieces; more means that rounding sends the tip to and fro

  void lose(double before, double after) noexcept {
    ++jumps_;
    dissipated_ += std::max(0.0, before - after);
  }

  /// Puts the tip where it was; a state that the present radius does not have is carried to the nearest one.
  bool begin(double overlap_nm) noexcept {
    const bool inside = place().inside;
    if (piece_.long_range().has_bridge()) {
      if (place().bridge.present && overlap_nm < borders_.rupture_nm()) piece_.put(BridgeState{});
    }
    if (inside) {
      piece_.put(piece_.on_curve(overlap_nm));
    } else {
      piece_.put(std::min(overlap_nm, borders_.hand_in_overlap_nm()));
    }
    z_ = point().base_nm;
    if (piece_.rigid() || piece_.stable(point())) return true;
    z_ = base_;
    return fall(base_ >= point().base_nm ? 1 : -1, piece_.energy_aj(point(), base_));
  }

  bool walk() noexcept {
    const int direction = base_ >= z_ ? 1 : -1;
    for (int i = 0; i < kMostBorders; ++i) {
      if (z_ == base_ && i > 0 && piece_.stable(point())) return true;
      const Bound bound = borders_.next(direction);
      if (bound.border == Border::kNone) return balance_.open(base_, direction);
      TipPoint end = piece_.at(bound.x);
      double end_x = bound.x;
      const bool reached = piece_.rigid() || piece_.stable(end) || end_x == place().x;
      if (!reached) {
        end_x = balance_.fold_between(place().x, bound.x);
        end = piece_.at(end_x);
      }
      if (direction * (end.base_nm - base_) >= 0) return balance_.between(place().x, end_x, base_);
      piece_.put(end_x, end);
      z_ = end.base_nm;
      const double before = piece_.energy_aj(point(), z_);
      if (!reached) {
        if (!fall(direction, before)) return false;
        continue;
      }
      const double force = point().force_nn;
      const bool had_bridge = place().bridge.present;
      borders_.cross(bound.border);
      const double change = point().force_nn - force;
      // The handover's overlap has rounding of u_delta, up to 1e-12 of the gap in nm for the softest samples.
      const bool jumps = std::fabs(change) > 1e-9 * (std::fabs(force) + piece_.scales().force_nn);
      if (piece_.rigid()) {
        if (jumps) lose(before, piece_.energy_aj(point(), z_));
      } else if (jumps) {
        if (!fall(change < 0 ? 1 : -1, before)) return false;
      } else if (!piece_.stable(point())) {
        if (!fall(direction, before)) return false;
        continue;
      } else {
        z_ = point().base_nm;
      }
      // Continuous in the force; in the potential only if the same way leads out again (joined_law.h).
      if (!jumps && bound.border == Border::kHandIn && piece_.has_van_der_waals() &&
          !piece_.handover().reversible) {
        dissipated_ += std::max(0.0, before - piece_.energy_aj(point(), z_));
      }
      // Nor does a bridge that takes over just the force there was (rigid bodies, at touch).
      if (!jumps && place().bridge.present != had_bridge) lose(before, piece_.energy_aj(point(), z_));
    }
    return false;
  }

  /// The tip moves at the base z_ with the net force to the first balance.
  bool fall(int direction, double before) noexcept {
    for (int i = 0; i < kMostBorders; ++i) {
      const Bound bound = borders_.next(direction);
      bool found = false;
      if (bound.border == Border::kNone) {
        found = balance_.open(z_, direction);
        if (!found) return false;
      } else {
        found = balance_.first(bound.x, z_, direction);
      }
      if (found) {
        lose(before, piece_.energy_aj(point(), z_));
        return true;
      }
      piece_.put(bound.x);
      borders_.cross(bound.border);
      // Where the liquid goes the bodies attract each other more again: the net force may turn. Not for ever:
      // every change of medium has cost energy.
      if (bound.border == Border::kForm || bound.border == Border::kRupture) {
        if (direction * (z_ - point().base_nm) < 0) direction = -direction;
      }
    }
    return false;
  }

  /// For the next step's quick way. `remembered`: the curve's state is in the cache.
  void keep(bool remembered) noexcept {
    TipSampleCache& cache = piece_.cache();
    cache.far_radius_nm = piece_.radius_nm();
    cache.far_compliance = piece_.compliance_nm_nn();
    cache.far_base_nm = base_;
    cache.far_base_rate = point().base_rate;
    cache.far_contact = place().contact;
    cache.far_parameter = place().x;
    if (place().inside && !remembered) {
      cache.has_last = false;
      cache.last = point().curve;
      cache.u = place().contact ? place().x : 0;
    }
  }

  double base_;
  LongRangePiece piece_;
  LongRangeBorders borders_{piece_};
  LongRangeBalance balance_{piece_};
  double z_ = 0;  // the base where the walk is
  double dissipated_ = 0;
  int jumps_ = 0;
};

}  // namespace telenano::physics
