#pragma once

#include <algorithm>
#include <cmath>

#include "telenano/nve_server/physics/law/long_range_borders.h"
#include "telenano/nve_server/physics/law/long_range_piece.h"
#include "telenano/nve_server/physics/law/warm_start.h"

namespace telenano::physics {

/// The quick ways of a step with long-range terms: the new balance lies on the piece where the tip was, and
/// no border and no fold between them (long_range_balance.h). False: the walk decides.
class LongRangeQuick {
 public:
  LongRangeQuick(LongRangePiece& piece, LongRangeBorders& borders, double base_nm) noexcept
      : piece_(piece), borders_(borders), base_(base_nm) {}

  bool outside(double overlap_nm) noexcept {
    const TipSampleCache& cache = piece_.cache();
    const double cut_off = piece_.cut_off_nm();
    const double low = borders_.rupture_nm();
    double high = std::min(borders_.formation_nm(), 0.0);
    const bool near_last = at_last_radius() && at_last_compliance() && !piece_.rigid();
    double x = base_;
    if (near_last) x = overlap_nm + (base_ - cache.far_base_nm) / cache.far_base_rate;
    if (!(x < 0)) x = base_;
    if (!(x < 0)) return false;
    for (int i = 0; i < 30; ++i) {
      TipPoint t = piece_.at(x);
      if (!(t.base_rate > 0)) {
        if (x == base_) return false;
        x = base_;  // Z <= delta, and it is concave: from here Newton's method climbs to the root if there is
                    // one
        continue;
      }
      const double step = (base_ - t.base_nm) / t.base_rate;
      if (std::fabs(step) <= 1e-8 * (cut_off - x)) {  // to first order: what is left out is 1e-16
        x += step;
        if (!(x >= low && x <= high)) return false;
        if (cut_off - x < kNoHandoverGap * cut_off || !piece_.has_van_der_waals()) {
          if (x > borders_.hand_in_overlap_nm()) return false;
        }
        t.shift(step);
        piece_.put(x, t);
        return true;
      }
      x += step;
      if (!(x < 0)) return false;
    }
    return false;
  }

  /// Leaves the curve's state in the cache, too.
  bool pressed() noexcept {
    if (borders_.formation_nm() < LongRangeBorders::kInfinity) return false;
    TipSampleCache& cache = piece_.cache();
    const double force = piece_.touch().force_nn;
    const double z = (base_ - piece_.compliance_nm_nn() * force) / piece_.scales().overlap_nm;
    const CurveSolution solution = solve_warm(cache.curve, cache, z, piece_.held());
    if (solution.status != CurveStatus::kOk || !(solution.point.overlap >= 0)) return false;
    piece_.put_pressed(solution.point, force);
    remember(cache.curve, cache, solution.point);
    return true;
  }

  /// Inside and drawn out: overlap < 0.
  bool neck(double overlap_nm) noexcept {
    const TipSampleCache& cache = piece_.cache();
    double x = 0;
    if (!at_last_radius()) {
      const CurveSolution last =
          cache.curve.solve(overlap_nm / piece_.scales().overlap_nm, {1.0, 0.0}, cache.u);
      if (last.status != CurveStatus::kOk) return false;
      piece_.set_contact(last.point.contact);
      x = last.point.parameter;
    } else {
      piece_.set_contact(cache.far_contact);
      x = cache.far_parameter;
      if (at_last_compliance()) {
        const double step = (base_ - cache.far_base_nm) / cache.far_base_rate;
        if (std::fabs(step) < 0.3 * std::fabs(x)) x += step;
      }
    }
    const bool contact = piece_.place().contact;
    const double onset = cache.curve.onset_radius();
    const double low = borders_.rupture_nm();
    const double high = std::min(borders_.formation_nm(), 0.0);
    for (int i = 0; i < 12; ++i) {
      TipPoint t = piece_.at(x);
      if (!piece_.stable(t)) return false;
      const double step = (base_ - t.base_nm) / t.base_rate;
      const double size = contact ? x : x + onset;
      const bool close = std::fabs(step) <= 1e-8 * size;
      x += step;
      if (!(contact ? x > 0 : x <= 0 && x > -onset)) return false;
      if (!close) continue;
      t.shift(step);
      if (!(t.overlap_nm >= low && t.overlap_nm <= high)) return false;
      if (!contact && borders_.hands_out() && x < piece_.parting().end.parameter) return false;
      piece_.put(x, t);
      return true;
    }
    return false;
  }

 private:
  bool at_last_radius() noexcept { return piece_.cache().far_radius_nm == piece_.radius_nm(); }
  bool at_last_compliance() noexcept {
    return piece_.cache().far_compliance == piece_.compliance_nm_nn() && piece_.cache().far_base_rate > 0;
  }

  LongRangePiece& piece_;
  LongRangeBorders& borders_;
  double base_;
};

}  // namespace telenano::physics
