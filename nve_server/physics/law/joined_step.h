#pragma once

#include <algorithm>
#include <limits>

#include "telenano/nve_server/physics/contact/joined_law.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "telenano/nve_server/physics/law/warm_start.h"

namespace telenano::physics {

inline constexpr double kSteepest = 1e12;  // stands for the infinite slope at a fold: callers stay finite

/// One step of a law inside joined to van der Waals outside (or to nothing), in dimensionless terms: the
/// rules are those of TipSampleLaw, for any curve.
template <ContactCurve Curve>
class JoinedStep {
 public:
  JoinedStep(const Curve& curve, double z, double compliance, bool van_der_waals,
             TipSampleCache& cache) noexcept
      : curve_(curve),
        z_(z),
        compliance_(compliance),
        held_{1.0, compliance},
        van_der_waals_(van_der_waals),
        cache_(cache) {}

  void run(Equilibrium& out, Branch branch) noexcept {
    const bool inside = branch == Branch::kContact || branch == Branch::kNonContact;
    if (inside ? stays_inside() : !stays_outside()) {
      write_inside(out);
    } else {
      write_outside(out);
    }
  }

  double dissipated() const noexcept { return dissipated_; }
  int jumps() const noexcept { return jumps_; }
  const CurveSolution& solution() const noexcept { return solution_; }

 private:
  // A table has both, once for all who share it.
  const Handover& handover() noexcept {
    if constexpr (requires { curve_.handover(); }) {
      return curve_.handover();
    } else {
      return cached_handover(curve_, cache_);
    }
  }
  const Parting& parting() noexcept {
    if constexpr (requires { curve_.parting(); }) {
      return curve_.parting();
    } else {
      return cached_parting(curve_, cache_);
    }
  }

  double offset() noexcept { return van_der_waals_ ? parting().energy_offset : 0.0; }
  double energy(const CurvePoint& p) noexcept {
    return p.energy + offset() + 0.5 * compliance_ * p.load * p.load;
  }
  double energy(const OutsidePoint& p) const noexcept {
    return p.energy + 0.5 * compliance_ * p.load * p.load;
  }

  void lose(double before, double after) noexcept {
    ++jumps_;
    dissipated_ += std::max(0.0, before - after);
  }

  /// From `p` to the stable state outside that the same base has.
  void leave(const CurvePoint& p) noexcept {
    lose(energy(p), energy(cache_.outside.solve(p.held(held_), compliance_)));
  }

  void solve_inside(double z) noexcept { solve_warm(curve_, cache_, z, held_, solution_); }

  /// False when the tip goes in; it is then solved inside at z.
  bool stays_outside() noexcept {
    if (!van_der_waals_) {
      // Two ulp of slack: at Delta = -H0, however the caller rounded it, the tip is still free.
      const double edge = -curve_.range() * (1.0 - 2.0 * std::numeric_limits<double>::epsilon());
      if (z_ <= edge) return true;
      cache_.u = 0;
      const double base = -curve_.range();
      const CurvePoint p = curve_.solve(base, held_).point;
      if (p.load != 0) lose(0.0, energy(p));
    } else {
      const bool held_outside = cache_.outside.stable(z_, compliance_);
      if (held_outside) {
        outside_ = cache_.outside.solve(z_, compliance_);
        if (outside_.gap >= kNoHandoverGap || outside_.gap >= handover().gap) return true;
      }
      const Handover& h = handover();
      const double jump_gap = cache_.outside.jump_gap(compliance_);
      const bool smooth = jump_gap <= h.gap && h.inside.overlap_rate >= 0 && h.inside.held_rate(held_) >= 0;
      cache_.u = h.inside.contact ? h.inside.parameter : 0;
      if (smooth) {
        // Continuous in the force; in the potential only if the same way leads out again.
        if (!h.reversible)
          dissipated_ += std::max(0.0, energy(cache_.outside.at_gap(h.gap)) - energy(h.inside));
      } else {
        const OutsidePoint edge = cache_.outside.at_gap(std::max(jump_gap, h.gap));
        lose(energy(edge), energy(curve_.solve(edge.overlap + compliance_ * edge.load, held_).point));
      }
    }
    cache_.has_last = false;
    solve_inside(z_);
    return false;
  }

  /// False when the tip goes out; it is then solved outside at z.
  bool stays_inside() noexcept {
    solve_inside(z_);
    const CurvePoint& p = solution_.point;
    const bool lost = solution_.status == CurveStatus::kNoState;
    if (!van_der_waals_) {
      if (lost && p.load != 0) lose(energy(p), 0.0);
      return !lost;
    }
    const Parting& h = parting();
    const bool beyond = h.reversible && p.parameter <= h.end.parameter;
    if (!lost && !beyond) return true;
    if (!beyond) {
      leave(p);
    } else if (cache_.outside.jump_gap(compliance_) > h.gap) {
      leave(h.end);  // van der Waals, steeper than the law inside, is not stable where they meet
    }
    outside_ = cache_.outside.solve(z_, compliance_);
    return false;
  }

  void write_inside(Equilibrium& out) noexcept {
    const CurvePoint& p = solution_.point;
    const ContactScales& s = cache_.scales;
    out.status =
        solution_.status == CurveStatus::kNotConverged ? SolveStatus::kNotConverged : SolveStatus::kOk;
    out.branch = p.contact ? Branch::kContact : Branch::kNonContact;
    out.overlap_nm = p.overlap * s.overlap_nm;
    out.force_nn = p.load * s.force_nn;
    const double slope = p.overlap_rate > 0 ? p.load_rate / p.overlap_rate : -kSteepest;
    out.stiffness_n_m = std::max(slope, -kSteepest) * (s.force_nn / s.overlap_nm);
    out.contact_radius_nm = p.contact_radius * s.length_nm;
    out.potential_aj = (p.energy + offset()) * s.energy_aj;
    remember(curve_, cache_, p);
  }

  void write_outside(Equilibrium& out) noexcept {
    const ContactScales& s = cache_.scales;
    if (!van_der_waals_) {
      out.branch = Branch::kFree;
      return;
    }
    out.branch = Branch::kVanDerWaals;
    out.overlap_nm = outside_.overlap * s.overlap_nm;
    out.force_nn = outside_.load * s.force_nn;
    out.stiffness_n_m = outside_.slope * (s.force_nn / s.overlap_nm);
    out.potential_aj = outside_.energy * s.energy_aj;
  }

  const Curve& curve_;
  double z_;
  double compliance_;
  Held held_;
  bool van_der_waals_;
  TipSampleCache& cache_;
  CurveSolution solution_;
  OutsidePoint outside_;
  double dissipated_ = 0;
  int jumps_ = 0;
};

}  // namespace telenano::physics
