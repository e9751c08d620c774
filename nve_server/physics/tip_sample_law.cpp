#include "nve_server/physics/tip_sample_law.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "common/base/constants.h"
#include "common/base/det_math.h"
#include "common/base/error.h"
#include "nve_server/physics/extended_step.h"
#include "nve_server/physics/warm_start.h"

namespace telenano::physics {
namespace {

constexpr double kLargest = 1e30;   // dimensionless arguments beyond this are as good as infinite
constexpr double kSteepest = 1e12;  // stands for the infinite slope at a fold, so that callers stay finite

/// One step in dimensionless terms.
class Step {
 public:
  Step(double z, double compliance, bool van_der_waals, TipSampleCache& cache) noexcept
      : z_(z),
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
  const Handover& handover() noexcept { return cached_handover(cache_); }

  double offset() noexcept { return van_der_waals_ ? handover().energy_offset : 0.0; }
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

  void solve_inside(double z) noexcept { solution_ = solve_warm(cache_, z, held_); }

  /// False when the tip goes in; it is then solved inside at z.
  bool stays_outside() noexcept {
    if (!van_der_waals_) {
      // Two ulp of slack: at Delta = -H0, however the caller rounded it, the tip is still free.
      const double edge = -cache_.curve.range() * (1.0 - 2.0 * std::numeric_limits<double>::epsilon());
      if (z_ <= edge) return true;
      cache_.u = 0;
      const double base = -cache_.curve.range();
      lose(0.0, energy(cache_.curve.solve(base, held_).point));
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
      if (!smooth) {
        const OutsidePoint edge = cache_.outside.at_gap(std::max(jump_gap, h.gap));
        lose(energy(edge), energy(cache_.curve.solve(edge.overlap + compliance_ * edge.load, held_).point));
      }
    }
    cache_.compliance = -1;
    solve_inside(z_);
    return false;
  }

  /// False when the tip goes out; it is then solved outside at z.
  bool stays_inside() noexcept {
    solve_inside(z_);
    const CurvePoint& p = solution_.point;
    const bool lost = solution_.status == CurveStatus::kNoState;
    bool smooth = false;
    if (van_der_waals_ && !p.contact) {
      const Handover& h = handover();
      smooth = h.reversible && p.outer_radius < h.inside.outer_radius;
    }
    if (!lost && !smooth) return true;
    if (!smooth) {
      const double base = p.held(held_);
      lose(energy(p), van_der_waals_ ? energy(cache_.outside.solve(base, compliance_)) : 0.0);
    }
    if (van_der_waals_) outside_ = cache_.outside.solve(z_, compliance_);
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
    remember(cache_, z_, held_, p);
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

VanDerWaals outside_of(const TipSampleParameters& p) noexcept {
  if (!p.van_der_waals) return {};
  return VanDerWaals::from_adhesion(p.work_of_adhesion_n_m, p.equilibrium_distance_nm);
}

void require_positive(double value, const char* what, const char* unit) {
  if (std::isfinite(value) && value > 0) return;
  throw UserError(std::string("tip-sample law: ") + what + " must be positive and finite (" + unit +
                  "), not " + std::to_string(value));
}

}  // namespace

TipSampleLaw::TipSampleLaw(const TipSampleParameters& parameters)
    : parameters_(parameters),
      van_der_waals_(outside_of(parameters)),
      long_range_(parameters.long_range, van_der_waals_.hamaker_aj, parameters.equilibrium_distance_nm) {
  require_positive(parameters.contact_modulus_gpa, "contact modulus K = 4E*/3", "GPa");
  require_positive(parameters.work_of_adhesion_n_m, "work of adhesion", "N/m");
  require_positive(parameters.equilibrium_distance_nm, "equilibrium distance", "nm");
  cbrt_ = det_cbrt(kPi * parameters.work_of_adhesion_n_m / parameters.contact_modulus_gpa);
  // sigma0 = 16/(9 sqrt(3)) w/z0 (the greatest stress of the Lennard-Jones law)
  sigma0_over_w_ = 16.0 / (9.0 * std::sqrt(3.0)) / parameters.equilibrium_distance_nm;
}

ContactScales TipSampleLaw::scales(double radius_nm) const noexcept {
  const double r = det_cbrt(radius_nm);
  ContactScales s;
  s.length_nm = cbrt_ * r * r;
  s.overlap_nm = cbrt_ * cbrt_ * r;
  s.force_nn = kPi * parameters_.work_of_adhesion_n_m * radius_nm;
  s.energy_aj = s.force_nn * s.overlap_nm;
  s.lambda = (2.0 / kPi) * sigma0_over_w_ * s.overlap_nm;
  return s;
}

double TipSampleLaw::pull_off_nn(double radius_nm) const noexcept {
  const ContactScales s = scales(radius_nm);
  return -MaugisDugdale(s.lambda).fold({0.0, 1.0}).load * s.force_nn;
}

void TipSampleLaw::prepare(double radius_nm, TipSampleCache& cache) const noexcept {
  if (cache.radius_nm == radius_nm) return;
  cache.radius_nm = radius_nm;
  cache.scales = scales(radius_nm);
  cache.curve = MaugisDugdale(cache.scales.lambda);
  cache.outside = OutsideLaw(cache.scales.lambda);
  cache.has_handover = false;
}

Equilibrium TipSampleLaw::advance(double base_overlap_nm, double compliance_nm_nn, double radius_nm,
                                  TipSampleState& state) const noexcept {
  Equilibrium out;
  if (!std::isfinite(base_overlap_nm) || !std::isfinite(compliance_nm_nn) || !std::isfinite(radius_nm) ||
      !(compliance_nm_nn >= 0) || !(radius_nm > 0)) {
    out.status = SolveStatus::kNonFinite;
    return out;
  }
  TipSampleCache& cache = state.cache;
  prepare(radius_nm, cache);
  const ContactScales& s = cache.scales;
  const double z = base_overlap_nm / s.overlap_nm;
  const double compliance = compliance_nm_nn * (s.force_nn / s.overlap_nm);
  if (!(std::fabs(z) < kLargest && compliance < kLargest && s.lambda < kLargest &&
        s.lambda > 1.0 / kLargest)) {
    out.status = SolveStatus::kNonFinite;
    return out;
  }
  if (long_range_.active()) return advance_extended(base_overlap_nm, compliance_nm_nn, state);
  Step step(z, compliance, parameters_.van_der_waals, cache);
  step.run(out, state.branch);
  if (!std::isfinite(out.force_nn) ||
      !std::isfinite(out.potential_aj)) {  // scales beyond the range of numbers
    cache = TipSampleCache{};
    Equilibrium none;
    none.status = SolveStatus::kNonFinite;
    return none;
  }
  if (compliance == 0 || out.branch == Branch::kFree) out.overlap_nm = base_overlap_nm;
  out.dissipated_aj = step.dissipated() * s.energy_aj;
  out.jumps = step.jumps();
  state.branch = out.branch;
  state.overlap_nm = out.overlap_nm;
  state.warm = cache.u;
  return out;
}

Equilibrium TipSampleLaw::advance_extended(double base_overlap_nm, double compliance_nm_nn,
                                           TipSampleState& state) const noexcept {
  TipSampleCache& cache = state.cache;
  ExtendedStep step(base_overlap_nm, compliance_nm_nn, van_der_waals_, parameters_.equilibrium_distance_nm,
                    long_range_, cache);
  const bool inside = state.branch == Branch::kContact || state.branch == Branch::kNonContact;
  const bool converged = step.run(inside, state.overlap_nm, state.bridge);
  const TipPlace& place = step.place();
  const TipPoint& point = step.point();
  Equilibrium out;
  out.force_nn = point.force_nn;
  out.potential_aj = step.potential_aj();
  if (!converged || !std::isfinite(out.force_nn) || !std::isfinite(out.potential_aj)) {
    cache = TipSampleCache{};
    Equilibrium none;
    none.status = converged ? SolveStatus::kNonFinite : SolveStatus::kNotConverged;
    return none;
  }
  const Branch inner = place.contact ? Branch::kContact : Branch::kNonContact;
  const Branch outer = parameters_.van_der_waals ? Branch::kVanDerWaals : Branch::kFree;
  out.branch = place.inside ? inner : outer;
  out.overlap_nm = compliance_nm_nn == 0 ? base_overlap_nm : point.overlap_nm;
  const double steepest = kSteepest * (cache.scales.force_nn / cache.scales.overlap_nm);
  out.stiffness_n_m =
      point.overlap_rate > 0 ? std::max(point.force_rate / point.overlap_rate, -steepest) : -steepest;
  out.contact_radius_nm = place.contact ? point.curve.contact_radius * cache.scales.length_nm : 0.0;
  out.dissipated_aj = step.dissipated_aj();
  out.jumps = step.jumps();
  out.bridge = place.bridge.present;
  state.branch = out.branch;
  state.overlap_nm = out.overlap_nm;
  state.bridge = place.bridge;
  state.warm = cache.u;
  return out;
}

}  // namespace telenano::physics
