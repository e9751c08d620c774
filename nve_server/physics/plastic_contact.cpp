#include "nve_server/physics/plastic_contact.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "common/base/constants.h"
#include "common/base/error.h"

namespace telenano::physics {
namespace {

constexpr double kYieldSlack = 1e-9;   // of a*: what was left by a flow must not flow again by rounding
constexpr double kFlowDone = 1e-11;    // of a*, well within that slack
constexpr int kMaxTrials = 100;        // of the root in a*: some 8 are usual
constexpr int kMaxDoublings = 120;     // to bracket it
constexpr int kMaxLineTrials = 40;     // to find a state on the line of flow
constexpr double kLineDone = 1e-11;    // of a*
constexpr double kPieceRatio = 1.5;    // of a*, for the quadrature
constexpr double kLeastForce = 1e-12;  // of the force πHa*²: no force

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
}

double PlasticContact::depth_nm(double from_radius, double to_radius, double origin) const noexcept {
  const FlowFamily family(strain_, origin, strain_ * to_radius);
  return family.depth_nm(strain_ * from_radius, strain_ * to_radius);
}

// The state during flow: contact radius a*, or no force where a* would be at a net pull: the least overlap at
// which neither the contact radius is less than a* nor the force less than 0. The overlap is that of Hertz
// less an adhesive part that changes slowly (0 without adhesion, ∝ √a for JKR), so that δ ≈ a²/R + const
// gives the step in a (by secants after the first); in F it is Newton's, from above where F is convex.
PlasticContact::LineState PlasticContact::on_line(double a_star, const FlowFamily& family, double adhesive_nm,
                                                  TipSampleState& state) const noexcept {
  const double radius = family.radius_nm(a_star);
  const double a_target = family.elastic_nm(a_star);
  const double hertz = a_target * a_target / radius;
  const double no_force = kLeastForce * kPi * hardness_gpa_ * a_target * a_target;
  double overlap = hertz - adhesive_nm;
  double last_overlap = 0.0;
  double last_error = 0.0;
  Equilibrium eq;
  for (int i = 0; i < kMaxLineTrials; ++i) {
    eq = law_.advance(overlap, 0.0, radius, state);
    if (eq.status != SolveStatus::kOk) break;
    if (eq.force_nn < 0.0 && (eq.branch != Branch::kContact || !(eq.stiffness_n_m > 0.0))) {
      overlap += 0.5 * hertz;  // pulled off, or nearly
      continue;
    }
    const double error = hertz - eq.contact_radius_nm * eq.contact_radius_nm / radius;
    double rate = -1.0;
    if (i > 0 && overlap != last_overlap) rate = (error - last_error) / (overlap - last_overlap);
    if (!(rate < -0.2 && rate > -5.0)) rate = -1.0;
    last_overlap = overlap;
    last_error = error;
    const double to_radius = -error / rate;
    const double to_no_force = eq.stiffness_n_m > 0.0 ? -eq.force_nn / eq.stiffness_n_m : to_radius;
    if (std::abs(error) <= kLineDone * hertz && eq.force_nn >= -no_force) break;
    if (std::abs(eq.force_nn) <= no_force && error <= 0.0) break;
    overlap += std::max(to_radius, to_no_force);
  }
  return {eq.overlap_nm, std::max(eq.force_nn, 0.0), eq.potential_aj};
}

double PlasticContact::dissipation(double from, double to, const FlowFamily& family, const Equilibrium& end,
                                   const TipSampleState& state) const noexcept {
  TipSampleState scratch = state;
  const double end_a = std::max(end.contact_radius_nm, 1e-300);
  const double end_adhesive = end_a * end_a / family.radius_nm(to) - end.overlap_nm;
  const auto line = [&](double a) { return on_line(a, family, end_adhesive * std::sqrt(a / to), scratch); };
  const LineState onset = line(from);
  LineState left = onset;
  double work = 0.0;
  double a = from;
  while (a < to) {
    // ∫F dδ over the piece as Σ_j w_j F_j δ'_j: nodes (−1, −1/√5, 1/√5, 1), weights (1, 5, 5, 1)/6, δ' the
    // derivative of the cubic through the four overlaps.
    const double b = a * kPieceRatio >= to ? to : a * kPieceRatio;
    const double half = 0.5 * (b - a);
    const double inner = 0.44721359549995793928 * half;  // 1/√5
    const double middle = a + half;
    const LineState p1 = line(middle - inner);
    const LineState p2 = line(middle + inner);
    const LineState right =
        b == to ? LineState{end.overlap_nm, std::max(end.force_nn, 0.0), end.potential_aj} : line(b);
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
  if (!(elastic.contact_radius_nm > from * (1.0 + kYieldSlack) &&
        elastic.force_nn > kYieldSlack * kPi * hardness_gpa_ * from * from)) {
    state = elastic_state;
    return out;
  }

  // Root of r(a*): what is left of the overload, falling in a*: more flow leaves less overlap on a larger
  // radius.
  Equilibrium eq;
  TipSampleState after;
  const auto overload = [&](double a) {
    after = elastic_state;
    eq = law_.advance(base_overlap - family.depth_nm(from, a), compliance, family.radius_nm(a), after);
    const double limit = family.elastic_nm(a);
    return std::min(eq.contact_radius_nm / limit - 1.0, eq.force_nn / (kPi * hardness_gpa_ * limit * limit));
  };
  // Hertz: a*²/R + cπHa*² = base + what has flowed before.
  const double spent =
      from < family.first_nm ? strain_ * (from - family.first_nm) : from * (from / origin - strain_);
  const double hertz_sq = (base_overlap + spent) / (1.0 / origin + compliance * kPi * hardness_gpa_);
  double low = from;
  double r_low = std::min(elastic.contact_radius_nm / from - 1.0,
                          elastic.force_nn / (kPi * hardness_gpa_ * from * from));
  double high = std::max(hertz_sq > 0.0 ? std::sqrt(hertz_sq) : 0.0, from * (1.0 + 1e-6));
  double r_high = overload(high);
  double widen = 1.01;
  for (int i = 0; i < kMaxDoublings && r_high > 0.0; ++i) {
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
  for (int i = 0; i < kMaxTrials && std::abs(r) > kFlowDone && high - low > 1e-15 * high; ++i) {
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
  if (eq.status != SolveStatus::kOk || !(std::abs(r) < kYieldSlack)) {
    out.equilibrium = Equilibrium{};
    out.equilibrium.status =
        eq.status == SolveStatus::kNonFinite ? SolveStatus::kNonFinite : SolveStatus::kNotConverged;
    return out;
  }
  out.flow.depth_nm = family.depth_nm(from, a);
  out.flow.radius_nm = family.radius_nm(a);
  out.flow.contact_radius_nm = eq.contact_radius_nm;
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
