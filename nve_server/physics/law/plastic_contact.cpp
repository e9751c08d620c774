#include "telenano/nve_server/physics/law/plastic_contact.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/error.h"

namespace telenano::physics {
namespace {

constexpr double kLevelYieldSlack =
    1e-9;  // of πHa*²: what was left by a flow must not flow again by rounding
constexpr double kLevelFlowDone = 1e-11;  // of πHa*², well within that slack
constexpr int kMaxTrials = 100;           // of the root in a*: some 4 are usual
constexpr int kMaxDoublings = 120;        // to bracket it
constexpr int kMaxLineTrials = 40;        // to find a state on the line of flow
constexpr double kLineDone = 1e-11;       // of πHa*²
constexpr double kPieceRatio = 1.5;       // of a*, for the quadrature
constexpr double kShortRatio = 1.002;  // of a*: the trapezium's own error is 1e-7 of the piece's work there

}  // namespace

struct PlasticContact::LineState {
  double overlap_nm = 0;  // against the surface with the flow
  double force_nn = 0;
  double potential_aj = 0;
};

PlasticContact::PlasticContact(const TipSampleLaw& law, double hardness_gpa)
    : law_(law),
      hardness_gpa_(hardness_gpa),
      strain_(kPi * hardness_gpa / law.parameters().contact_modulus_gpa) {
  if (!(std::isfinite(hardness_gpa) && hardness_gpa > 0.0)) {
    throw UserError("plastic contact: hardness must be positive and finite (GPa), not " +
                    std::to_string(hardness_gpa));
  }
  if (law.parameters().model != ContactLaw::kHertz) {
    adhesion_per_nm_ = 2.0 * kPi * law.parameters().work_of_adhesion_n_m;
  }
}

double PlasticContact::yield_force_at(double a_star, double origin) const noexcept {
  return std::max(0.0, kPi * hardness_gpa_ * a_star * a_star - adhesion_per_nm_ * origin);
}

double PlasticContact::zero_load_depth_nm(double origin) const noexcept {
  const double first = strain_ * origin;
  const double unloaded = std::sqrt(adhesion_per_nm_ * origin / (kPi * hardness_gpa_));
  return unloaded > first ? depth_nm(origin, unloaded / strain_, origin) : 0.0;
}

double PlasticContact::depth_nm(double from_radius, double to_radius, double origin) const noexcept {
  const FlowFamily family(strain_, origin, strain_ * to_radius);
  return family.depth_nm(strain_ * from_radius, strain_ * to_radius);
}

// The state during flow: the overlap at which the force is Y(a*), by Newton's method from `start`, which
// brackets itself: F rises with the overlap wherever it is not a pull.
PlasticContact::LineState PlasticContact::on_line(double a_star, const FlowFamily& family, double start,
                                                  TipSampleState& state) const noexcept {
  const double radius = family.radius_nm(a_star);
  const double a_target = family.elastic_nm(a_star);
  const double target = yield_force_at(a_target, family.origin_nm);
  const double done = kLineDone * kPi * hardness_gpa_ * a_target * a_target;
  const double longest = 0.5 * a_target * a_target / radius;  // half of Hertz's overlap
  double overlap = start;
  double low = -HUGE_VAL, high = HUGE_VAL;
  Equilibrium eq;
  for (int i = 0; i < kMaxLineTrials; ++i) {
    eq = law_.advance(overlap, 0.0, radius, state);
    if (eq.status != SolveStatus::kOk) break;
    const double error = eq.force_nn - target;
    if (std::abs(error) <= done) break;
    (error < 0.0 ? low : high) = overlap;
    double next = overlap + longest;  // pulled off, or nearly
    if (eq.branch == Branch::kContact && eq.stiffness_n_m > 0.0) {
      next = overlap + std::clamp(-error / eq.stiffness_n_m, -longest, longest);
    }
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    if (!std::isfinite(next) || next == overlap) break;
    overlap = next;
  }
  return {eq.overlap_nm, target, eq.potential_aj};
}

double PlasticContact::dissipation(double from, double to, const FlowFamily& family, const Equilibrium& end,
                                   const TipSampleState& state) const noexcept {
  TipSampleState scratch = state;
  // Start values: Hertz's overlap a*²/R_p and an adhesive part that changes slowly.
  const auto hertz = [&](double a) {
    return family.elastic_nm(a) * family.elastic_nm(a) / family.radius_nm(a);
  };
  const double end_adhesive = hertz(to) - end.overlap_nm;
  const auto line = [&](double a) { return on_line(a, family, hertz(a) - end_adhesive, scratch); };
  const LineState last{end.overlap_nm, std::max(end.force_nn, 0.0), end.potential_aj};
  // Y has a corner where it comes to be 0: no piece goes across it.
  const double corner = std::sqrt(adhesion_per_nm_ * family.origin_nm / (kPi * hardness_gpa_));
  const LineState onset = line(from);
  LineState left = onset;
  double work = 0.0;
  double a = from;
  while (a < to) {
    // ∫F dδ over the piece as Σ_j w_j F_j δ'_j: nodes (−1, −1/√5, 1/√5, 1), weights (1, 5, 5, 1)/6, δ' the
    // derivative of the cubic through the four overlaps.
    double b = a * kPieceRatio >= to ? to : a * kPieceRatio;
    if (a < corner && corner < b) b = corner;
    if (b <= corner) {  // without force: no work
      left = b == to ? last : line(b);
      a = b;
      continue;
    }
    if (b == to && b <= a * kShortRatio) {
      work +=
          0.5 * (left.force_nn + last.force_nn) * (family.depth_nm(a, b) + last.overlap_nm - left.overlap_nm);
      break;
    }
    const double half = 0.5 * (b - a);
    const double inner = 0.44721359549995793928 * half;  // 1/√5
    const double middle = a + half;
    const LineState p1 = line(middle - inner);
    const LineState p2 = line(middle + inner);
    const LineState right = b == to ? last : line(b);
    const double d[4] = {left.overlap_nm, family.depth_nm(a, middle - inner) + p1.overlap_nm,
                         family.depth_nm(a, middle + inner) + p2.overlap_nm,
                         family.depth_nm(a, b) + right.overlap_nm};
    const double f[4] = {left.force_nn, p1.force_nn, p2.force_nn, right.force_nn};
    constexpr double kRoot5 = 2.23606797749978969641;
    const double slope[4] = {
        -3.0 * d[0] + 1.25 * (1.0 + kRoot5) * d[1] + 1.25 * (1.0 - kRoot5) * d[2] + 0.5 * d[3],
        -0.25 * (1.0 + kRoot5) * d[0] + 0.5 * kRoot5 * d[2] + 0.25 * (1.0 - kRoot5) * d[3],
        0.25 * (kRoot5 - 1.0) * d[0] - 0.5 * kRoot5 * d[1] + 0.25 * (1.0 + kRoot5) * d[3],
        -0.5 * d[0] + 1.25 * (kRoot5 - 1.0) * d[1] - 1.25 * (1.0 + kRoot5) * d[2] + 3.0 * d[3]};
    work += (f[0] * slope[0] + 5.0 * (f[1] * slope[1] + f[2] * slope[2]) + f[3] * slope[3]) / 6.0;
    left = right;
    a = b;
  }
  return std::max(0.0, work - (end.potential_aj - onset.potential_aj));
}

PlasticStep PlasticContact::advance(double base_overlap, double compliance, double radius, double origin,
                                    TipSampleState& state) const noexcept {
  PlasticStep out;
  if (!(std::isfinite(origin) && origin > 0.0)) {
    out.equilibrium.status = SolveStatus::kNonFinite;
    return out;
  }
  TipSampleState elastic_state = state;
  const Equilibrium elastic = law_.advance(base_overlap, compliance, radius, elastic_state);
  out.equilibrium = elastic;
  if (elastic.status != SolveStatus::kOk) return out;
  const double from = strain_ * radius;
  const double last = std::max(from, strain_ * kMostRadii * origin);
  const FlowFamily family(strain_, origin, last);
  const double hard = kPi * hardness_gpa_;
  const double r_from = (elastic.force_nn - yield_force_at(from, origin)) / (hard * from * from);
  if (!(r_from > kLevelYieldSlack)) {
    state = elastic_state;
    return out;
  }

  // Root of r(a*): what is left of the overload, falling in a*: more flow leaves less overlap on a larger
  // radius, that bears more.
  Equilibrium eq;
  TipSampleState after;
  const auto overload = [&](double a) {
    after = elastic_state;
    eq = law_.advance(base_overlap - family.depth_nm(from, a), compliance, family.radius_nm(a), after);
    const double limit = family.elastic_nm(a);
    return (eq.force_nn - yield_force_at(limit, origin)) / (hard * limit * limit);
  };
  double low = from;
  double r_low = r_from;
  // Hertz's slopes at the onset say how far: dF/da* = (−k δ_p' + F/2R_p ε)/(1 + ck) against dY/da*.
  const double rate = from < family.first_nm ? strain_ : 2.0 * from / origin - strain_;
  const double stiffness = std::max(0.0, elastic.stiffness_n_m);
  const double falls =
      (stiffness * rate - 0.5 * elastic.force_nn / from) / (1.0 + compliance * stiffness) +
      (elastic.force_nn > 0.0 && yield_force_at(from, origin) > 0.0 ? 2.0 * hard * from : 0.0);
  const double guess = falls > 0.0 ? r_from * hard * from * from / falls : 0.1 * from;
  double high = from + std::clamp(1.05 * guess, 1e-9 * from, 2.0 * from);
  double r_high = overload(high);
  double widen = 1.01;
  for (int i = 0; i < kMaxDoublings && r_high > kLevelFlowDone; ++i) {
    low = high;
    r_low = r_high;
    high *= widen;
    widen = std::min(2.0, 1.0 + 2.0 * (widen - 1.0));
    r_high = overload(high);
  }
  // Regula falsi; the end that stays twice is weighed down (Illinois).
  double a = high;
  double r = r_high;
  int side = 0;
  for (int i = 0; i < kMaxTrials && std::abs(r) > kLevelFlowDone && high - low > 1e-15 * high; ++i) {
    a = low + (high - low) * (r_low / (r_low - r_high));
    if (!(a > low && a < high)) a = 0.5 * (low + high);
    r = overload(a);
    if (r > 0.0) {
      low = a;
      r_low = r;
      if (side > 0) r_high *= 0.5;
      side = 1;
    } else {
      high = a;
      r_high = r;
      if (side < 0) r_low *= 0.5;
      side = -1;
    }
  }
  if (eq.status != SolveStatus::kOk || !(std::abs(r) < kLevelYieldSlack)) {
    out.equilibrium = Equilibrium{};
    out.equilibrium.status =
        eq.status == SolveStatus::kNonFinite ? SolveStatus::kNonFinite : SolveStatus::kNotConverged;
    return out;
  }
  out.flow.depth_nm = family.depth_nm(from, a);
  out.flow.radius_nm = family.radius_nm(a);
  out.flow.contact_radius_nm = a;
  out.flow.dissipated_aj = dissipation(from, a, family, eq, after);
  eq.dissipated_aj = elastic.dissipated_aj + out.flow.dissipated_aj;
  eq.jumps = elastic.jumps;
  eq.overlap_nm += out.flow.depth_nm;
  eq.stiffness_n_m = kPi * hardness_gpa_ * std::min(origin, out.flow.radius_nm);
  out.equilibrium = eq;
  state = after;
  return out;
}

}  // namespace telenano::physics
