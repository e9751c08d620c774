#include "telenano/nve_server/physics/law/tip_sample_law.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/law/joined_step.h"
#include "telenano/nve_server/physics/law/long_range_step.h"

namespace telenano::physics {
namespace {

// Where tables are tested, with a margin: far outside, the curve's own scales leave the table's grid.
constexpr double kLeastTabulated = 1e-4;
constexpr double kGreatestTabulated = 1e5;

constexpr double kLargest = 1e30;  // dimensionless arguments beyond this are as good as infinite

ContactMedium medium_of(const TipSampleParameters& p, double work_of_adhesion_n_m) noexcept {
  return {work_of_adhesion_n_m, p.contact_modulus_gpa, p.equilibrium_distance_nm, p.van_der_waals};
}

ContactMedia media_of(const TipSampleParameters& p) noexcept {
  const double dry = p.work_of_adhesion_n_m;
  const double wet = std::max(dry - Capillary::adhesion_n_m(p.long_range.capillary), kLeastWetShare * dry);
  return {medium_of(p, dry), medium_of(p, wet)};
}

DisplacedAttraction displaced_in(const TipSampleParameters& p, const ContactMedia& media) noexcept {
  return {media.dry.work_of_adhesion_n_m() - media.wet.work_of_adhesion_n_m(), p.equilibrium_distance_nm,
          p.van_der_waals};
}

void require_positive(double value, const char* what, const char* unit) {
  if (std::isfinite(value) && value > 0) return;
  throw UserError(std::string("tip-sample law: ") + what + " must be positive and finite (" + unit +
                  "), not " + std::to_string(value));
}

struct Losses {
  double dissipated = 0;
  int jumps = 0;
};

template <ContactCurve Curve>
Losses step_on(const Curve& curve, double z, double compliance, bool van_der_waals, Branch branch,
               TipSampleCache& cache, Equilibrium& out) noexcept {
  JoinedStep<Curve> step(curve, z, compliance, van_der_waals, cache);
  step.run(out, branch);
  return {step.dissipated(), step.jumps()};
}

}  // namespace

TipSampleLaw::TipSampleLaw(const TipSampleParameters& parameters, double nominal_radius_nm)
    : parameters_(parameters),
      media_(media_of(parameters)),
      long_range_(parameters.long_range, media_.dry.van_der_waals().hamaker_aj,
                  parameters.equilibrium_distance_nm, displaced_in(parameters, media_)) {
  require_positive(parameters.contact_modulus_gpa, "contact modulus K = 4E*/3", "GPa");
  require_positive(parameters.work_of_adhesion_n_m, "work of adhesion", "N/m");
  require_positive(parameters.equilibrium_distance_nm, "equilibrium distance", "nm");
  if (parameters.model == ContactLaw::kHertz && parameters.van_der_waals) {
    throw UserError(
        "tip-sample law: hertz has no adhesion, so van der Waals cannot be joined to it; dmt is that law");
  }
  if (long_range_.active() &&
      (parameters.model != ContactLaw::kMaugisDugdale || parameters.method != MaugisMethod::kDirect)) {
    throw UserError(
        "tip-sample law: retardation, cone, electrostatic and capillary forces go with maugis-dugdale by the "
        "direct "
        "method");
  }
  MaugisDugdale(1.0).fold({1.0, 0.0});  // makes the table of folds, so that no step has to
  if (parameters.method == MaugisMethod::kTable) {
    if (parameters.model != ContactLaw::kMaugisDugdale) {
      throw UserError("tip-sample law: only maugis-dugdale has a table; the other laws are closed forms");
    }
    require_positive(nominal_radius_nm, "radius of the table", "nm");
    const double lambda = scales(nominal_radius_nm).lambda;
    if (!(lambda >= kLeastTabulated && lambda <= kGreatestTabulated)) {
      throw UserError("tip-sample law: no table for lambda = " + std::to_string(lambda) +
                      ", expected 1e-4 to 1e5: use the direct method");
    }
    table_ = std::make_shared<const MaugisTable>(lambda);
  }
}

ContactScales TipSampleLaw::scales(double radius_nm) const noexcept {
  return media_.dry.scales(radius_nm);
}

double TipSampleLaw::attraction_bound_nn(double radius_nm) const noexcept {
  const double contact = 2.0 * kPi * radius_nm;
  const double dry = contact * media_.dry.work_of_adhesion_n_m();
  if (!long_range_.active()) return dry;
  const auto far = [&](const BridgeState& bridge) {
    return std::max(0.0, -long_range_.evaluate_open(0.0, radius_nm, bridge).force_nn);
  };
  const BridgeState bridge = long_range_.capillary().formed(radius_nm);
  if (!bridge.present) return dry + far({});
  return std::max(dry + far({}), contact * media_.wet.work_of_adhesion_n_m() + far(bridge));
}

double TipSampleLaw::pull_off_nn(double radius_nm) const noexcept {
  const ContactScales s = scales(radius_nm);
  if (parameters_.model == ContactLaw::kMaugisDugdale)
    return -MaugisDugdale(s.lambda).fold({0.0, 1.0}).load * s.force_nn;
  return closed_form_coefficients(parameters_.model, s.lambda).pull_off * s.force_nn;
}

void TipSampleLaw::prepare(double radius_nm, bool wet, TipSampleCache& cache) const noexcept {
  if (cache.wet != wet) {
    enter(media_, wet, radius_nm, cache);
    return;
  }
  if (cache.radius_nm == radius_nm) return;
  cache.radius_nm = radius_nm;
  cache.scales = media_.of(wet).scales(radius_nm);
  switch (parameters_.model) {
    case ContactLaw::kHertz:
    case ContactLaw::kDmt:
      break;  // made at each step, of two numbers
    case ContactLaw::kMaugisDugdale: {
      const bool tabulated = table_ && table_->lambda() == cache.scales.lambda;
      if (!tabulated) cache.curve = MaugisDugdale(cache.scales.lambda);
      if (tabulated != cache.tabulated) {  // another parameter of the curve: nothing to extrapolate from
        cache.tabulated = tabulated;
        cache.u = 0;
        cache.has_last = false;
        cache.handover_ratio[0] = cache.handover_ratio[1] = 0;
      }
      break;
    }
    case ContactLaw::kJkr:
    case ContactLaw::kCarpickOgletreeSalmeron:
    case ContactLaw::kPietrementTroyon:
    case ContactLaw::kSchwarz:
      cache.adhesive =
          AdhesiveCurve(cache.scales.lambda, closed_form_coefficients(parameters_.model, cache.scales.lambda),
                        parameters_.van_der_waals);
  }
  cache.outside = OutsideLaw(cache.scales.lambda);
  cache.has_handover = cache.has_parting = false;
}

void TipSampleLaw::derive(TipSampleCache& cache) const noexcept {
  if (!(cache.radius_nm > 0)) return;
  TipSampleCache made;
  made.wet = cache.wet;
  prepare(cache.radius_nm, cache.wet, made);
  cache.scales = made.scales;
  cache.curve = made.curve;
  cache.adhesive = made.adhesive;
  cache.tabulated = made.tabulated;
  cache.outside = made.outside;
}

Equilibrium TipSampleLaw::advance(double base_overlap_nm, double compliance_nm_nn, double radius_nm,
                                  TipSampleState& state) const noexcept {
  return advance(base_overlap_nm, compliance_nm_nn, radius_nm, state, true);
}

Equilibrium TipSampleLaw::try_advance(double base_overlap_nm, double compliance_nm_nn, double radius_nm,
                                      const TipSampleState& from, TipSampleState& again) const noexcept {
  // The curve's last state is a guess and no more. All else that is remembered says where the tip was.
  const TipSampleCache& last = again.cache;
  if (last.has_last && last.tabulated == from.cache.tabulated && last.wet == from.cache.wet) {
    const CurvePoint point = last.last;
    const double lambda = last.lambda;
    again = from;
    again.cache.has_last = true;
    again.cache.last = point;
    again.cache.lambda = lambda;
    again.cache.u = point.parameter;
  } else {
    again = from;
  }
  return advance(base_overlap_nm, compliance_nm_nn, radius_nm, again, false);
}

void TipSampleLaw::add_joining_energy(Equilibrium& eq, TipSampleState& again) const noexcept {
  const bool inside = eq.branch == Branch::kContact || eq.branch == Branch::kNonContact;
  if (!joins_later() || !inside) return;
  eq.potential_aj +=
      cached_parting(again.cache.curve, again.cache).energy_offset * again.cache.scales.energy_aj;
}

Equilibrium TipSampleLaw::advance(double base_overlap_nm, double compliance_nm_nn, double radius_nm,
                                  TipSampleState& state, bool join_energy) const noexcept {
  Equilibrium out;
  if (!std::isfinite(base_overlap_nm) || !std::isfinite(compliance_nm_nn) || !std::isfinite(radius_nm) ||
      !(compliance_nm_nn >= 0) || !(radius_nm > 0)) {
    out.status = SolveStatus::kNonFinite;
    return out;
  }
  TipSampleCache& cache = state.cache;
  prepare(radius_nm, long_range_.has_bridge() && state.bridge.present, cache);
  const ContactScales& s = cache.scales;
  const double z = base_overlap_nm / s.overlap_nm;
  const double compliance = compliance_nm_nn * (s.force_nn / s.overlap_nm);
  if (!(std::fabs(z) < kLargest && compliance < kLargest && s.lambda < kLargest &&
        s.lambda > 1.0 / kLargest)) {
    out.status = SolveStatus::kNonFinite;
    return out;
  }
  if (long_range_.active()) return advance_extended(base_overlap_nm, compliance_nm_nn, state, join_energy);
  Losses losses;
  const bool vdw = parameters_.van_der_waals;
  switch (parameters_.model) {
    case ContactLaw::kMaugisDugdale:
      losses = cache.tabulated ? step_on(*table_, z, compliance, vdw, state.branch, cache, out)
                               : step_on(cache.curve, z, compliance, vdw, state.branch, cache, out);
      break;
    case ContactLaw::kHertz:
      losses = step_on(HertzianCurve(s.lambda, 0.0), z, compliance, vdw, state.branch, cache, out);
      break;
    case ContactLaw::kDmt:
      losses = step_on(HertzianCurve(s.lambda, 2.0), z, compliance, vdw, state.branch, cache, out);
      break;
    case ContactLaw::kJkr:
    case ContactLaw::kCarpickOgletreeSalmeron:
    case ContactLaw::kPietrementTroyon:
    case ContactLaw::kSchwarz:
      losses = step_on(cache.adhesive, z, compliance, vdw, state.branch, cache, out);
      break;
  }
  if (!std::isfinite(out.force_nn) ||
      !std::isfinite(out.potential_aj)) {  // scales beyond the range of numbers
    cache = TipSampleCache{};
    Equilibrium none;
    none.status = SolveStatus::kNonFinite;
    return none;
  }
  if (compliance == 0 || out.branch == Branch::kFree) out.overlap_nm = base_overlap_nm;
  out.dissipated_aj = losses.dissipated * s.energy_aj;
  out.jumps = losses.jumps;
  state.branch = out.branch;
  state.overlap_nm = out.overlap_nm;
  state.warm = cache.u;
  return out;
}

Equilibrium TipSampleLaw::advance_extended(double base_overlap_nm, double compliance_nm_nn,
                                           TipSampleState& state, bool join_energy) const noexcept {
  TipSampleCache& cache = state.cache;
  LongRangeStep step(base_overlap_nm, compliance_nm_nn, media_, parameters_.equilibrium_distance_nm,
                     long_range_, cache);
  const bool inside = state.branch == Branch::kContact || state.branch == Branch::kNonContact;
  const bool converged = step.run(inside, state.overlap_nm, state.bridge);
  const TipPlace& place = step.place();
  const TipPoint& point = step.point();
  Equilibrium out;
  out.force_nn = point.force_nn;
  out.potential_aj = step.potential_before_joining_aj();
  if (!converged || !std::isfinite(out.force_nn) || !std::isfinite(out.potential_aj)) {
    cache = TipSampleCache{};
    Equilibrium none;
    none.status = converged ? SolveStatus::kNonFinite : SolveStatus::kNotConverged;
    return none;
  }
  const Branch inner = place.contact ? Branch::kContact : Branch::kNonContact;
  const Branch outer = parameters_.van_der_waals ? Branch::kVanDerWaals : Branch::kFree;
  out.branch = place.inside ? inner : outer;
  if (join_energy) add_joining_energy(out, state);
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
