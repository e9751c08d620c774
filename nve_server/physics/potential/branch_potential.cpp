#include "telenano/nve_server/physics/potential/branch_potential.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"
#include "telenano/common/base/renew.h"

namespace telenano::physics {
namespace {

constexpr double kBelowNominal = 4.5;  // in ln R: 1/90
constexpr double kAboveNominal = 6.4;  // 600
constexpr double kPiece = 0.02;        // of ρ: cubics are then within 1e-10 of E
constexpr double kFoldInContact =
    0.9379474572107123;              // λ from which on the fold of overlap is (maugis_dugdale.cpp)
constexpr double kSlopeStep = 1e-3;  // of ρ: five-point differences err by some 1e-12
// Of ρ, of laws whose own form goes with λ: truncation 1e-8, rounding of the second differences 1e-6.
constexpr double kModelStep = 2e-4;
constexpr double kAtFold_nm = 1e-7;  // the borders' own error, and more

constexpr double kBiasSoftening_nm = 0.35;
constexpr double kBiasGrowth = 0.6;

/// What the law's curve leaves open: M and M' of the class comment.
struct Moment {
  double value = 0;
  double by_lambda = 0;
};

Moment moment_of(const MaugisDugdale& curve, const CurvePoint& p) noexcept {
  Moment m;
  m.value = curve.radius_moment(p);
  if (!p.contact) {
    m.by_lambda = m.value;  // P' = P, and M = −P²/(2πλ)
    return m;
  }
  // M = A³ (Δ/2 − 3/10 A²) − N, N = λ C⁴ (θ − sin 4θ/4)/4; at constant θ both radii change alike.
  const double a = p.contact_radius;
  const double a_rate = p.contact_radius_by_lambda;
  const double disc = a * a * (0.5 * p.overlap - 0.3 * a * a);
  const double annulus = a * disc - m.value;
  const double relative = a > 0 ? a_rate / a : 0.0;
  m.by_lambda = 3.0 * disc * a_rate + a * a * a * (0.5 * p.overlap_by_lambda - 0.6 * a * a_rate) -
                annulus * (1.0 + 4.0 * relative);
  return m;
}

template <class Curve>
Moment moment_of(const Curve& /*curve*/, const CurvePoint& p) noexcept {
  return {(4.0 / 3.0) * p.energy - p.overlap * p.load / 3.0, 0.0};
}

double cubic(const double (&c)[4], double t) noexcept {
  return c[0] + t * (c[1] + t * (c[2] + t * c[3]));
}

void hermite(double y0, double slope0, double y1, double slope1, double (&c)[4]) noexcept {
  const double rise = y1 - y0;
  c[0] = y0;
  c[1] = slope0;
  c[2] = 3.0 * rise - 2.0 * slope0 - slope1;
  c[3] = slope0 + slope1 - 2.0 * rise;
}

/// Through values at 0, 1/3, 2/3, 1.
void through(double a, double b, double c, double d, double (&out)[4]) noexcept {
  out[0] = a;
  out[1] = -5.5 * a + 9.0 * b - 4.5 * c + d;
  out[2] = 9.0 * a - 22.5 * b + 18.0 * c - 4.5 * d;
  out[3] = -4.5 * a + 13.5 * b - 13.5 * c + 4.5 * d;
}

TipShape shape_of(const LongRangeParameters& p) noexcept {  // checked by the law
  TipShape shape;
  if (!(p.cone_height_nm > 0)) return shape;
  const SinCos angle = det_sin_cos(p.cone_half_angle_deg * (kPi / 180.0));
  shape.half_angle_sin = angle.sin;
  shape.half_angle_cos = angle.cos;
  shape.height_nm = p.cone_height_nm;
  return shape;
}

/// The curve of a law at one λ, handed to `use`.
template <class Use>
auto with_curve(const TipSampleParameters& p, double lambda, const Use& use) {
  switch (p.model) {
    case ContactLaw::kHertz:
      return use(HertzianCurve(lambda, 0.0));
    case ContactLaw::kDmt:
      return use(HertzianCurve(lambda, 2.0));
    case ContactLaw::kJkr:
    case ContactLaw::kSchwarz:
    case ContactLaw::kCarpickOgletreeSalmeron:
    case ContactLaw::kPietrementTroyon:
      return use(AdhesiveCurve(lambda, closed_form_coefficients(p.model, lambda), p.van_der_waals));
    case ContactLaw::kMaugisDugdale:
      break;
  }
  return use(MaugisDugdale(lambda));
}

}  // namespace

BranchPotential::BranchPotential(const TipSampleLaw& law, double nominal_radius_nm)
    : BranchPotential(law, nominal_radius_nm, false) {
  const LongRangeParameters& far = law_.parameters().long_range;
  const double coarsest = 0.25 * nominal_radius_nm;
  bias_softening_ = {std::min(kBiasSoftening_nm, 0.5 * coarsest), coarsest, 0.0, kBiasGrowth, 0.0};
  const Electrostatic field(far.tip_bias_v, shape_of(far));
  if (field.active()) {
    bias_.emplace([&](double gap, double radius) { return field.energy_aj(gap, radius); }, cut_off_nm_,
                  first_, greatest_log_radius());
  }
  if (!law_.long_range().has_bridge()) return;
  bridge_ = BridgePotential(law_.long_range().capillary(), nominal_radius_nm);
  wet_.reset(new BranchPotential(law, nominal_radius_nm, true));
}

BranchPotential::BranchPotential(const TipSampleLaw& law, double nominal_radius_nm, bool wet)
    : law_(law),
      medium_(law.media().of(wet)),
      unit_(medium_.scales(1.0)),
      cut_off_nm_(law.parameters().equilibrium_distance_nm),
      model_moves_(law.parameters().model == ContactLaw::kSchwarz ||
                   law.parameters().model == ContactLaw::kCarpickOgletreeSalmeron ||
                   law.parameters().model == ContactLaw::kPietrementTroyon) {
  const TipSampleParameters& p = law_.parameters();
  if (!(std::isfinite(nominal_radius_nm) && nominal_radius_nm > 0)) {
    throw UserError("potential of tip and sample: the radius must be positive and finite (nm), not " +
                    std::to_string(nominal_radius_nm));
  }
  const double nominal = det_log(nominal_radius_nm);
  const double last = nominal + kAboveNominal;
  first_ = nominal - kBelowNominal;
  step_ = kPiece;
  // A knot where the crossing ceases to be used both ways, and one where the fold comes to lie in contact.
  if (at_radius(first_).reversible && !at_radius(last).reversible) {
    double low = first_;
    double high = last;
    for (int i = 0; i < 60; ++i) {
      const double middle = 0.5 * (low + high);
      (at_radius(middle).reversible ? low : high) = middle;
    }
    if (p.model == ContactLaw::kMaugisDugdale) {
      const double apart = 3.0 * det_log(kFoldInContact / medium_.scales(det_exp(low)).lambda);
      step_ = apart / std::ceil(apart / kPiece);
    }
    first_ = low - step_ * std::ceil((low - first_) / step_);
  }
  per_step_ = 1.0 / step_;
  const auto count = static_cast<std::size_t>(std::ceil((last - first_) / step_));
  pieces_.resize(count);
  constexpr double kWithin = 1e-9;  // of a step: this side of a knot
  for (std::size_t i = 0; i < count; ++i) {
    const double from = first_ + step_ * static_cast<double>(i);
    const auto at = [&](double t) { return at_radius(from + step_ * t); };
    const AtRadius a = at(kWithin);
    const AtRadius b = at(1.0 / 3.0);
    const AtRadius c = at(2.0 / 3.0);
    const AtRadius d = at(1.0 - kWithin);
    Piece& piece = pieces_[i];
    through(a.enter_nm, b.enter_nm, c.enter_nm, d.enter_nm, piece.enter);
    through(a.leave_nm, b.leave_nm, c.leave_nm, d.leave_nm, piece.leave);
    piece.reversible = b.reversible;
    piece.cube_root = det_exp(from * (1.0 / 3.0));
    const AtRadius start = at(0.0);
    hermite(start.offset_aj, step_ * offset_slope(from), at_radius(from + step_).offset_aj,
            step_ * offset_slope(from + step_), piece.offset);
  }
  const double hamaker = medium_.van_der_waals().hamaker_aj;
  const TipVanDerWaals far(hamaker, p.long_range.retardation_nm, shape_of(p.long_range));
  if (hamaker > 0 && far.active()) {
    far_.emplace([&](double gap, double radius) { return far.correction_energy_aj(gap, radius); },
                 cut_off_nm_, first_, last);
  }
  if (!law_.long_range().has_bridge()) return;
  for (std::size_t i = 0; i < count; ++i) {
    const double from = first_ + step_ * static_cast<double>(i);
    const auto at = [&](double t) {
      CurveHint hint;
      PotentialJet jet;
      ContactSize size;
      return inside(0.0, from + step_ * t, hint, jet, size) ? jet.energy_aj : 0.0;
    };
    through(at(0.0), at(1.0 / 3.0), at(2.0 / 3.0), at(1.0), pieces_[i].touch);
  }
}

BranchPotential::AtRadius BranchPotential::at_radius(double log_radius) const {
  const TipSampleParameters& p = law_.parameters();
  const ContactScales s = medium_.scales(det_exp(log_radius));
  return with_curve(p, s.lambda, [&](const auto& curve) {
    AtRadius out;
    if (p.van_der_waals) {
      const OutsideLaw outside(s.lambda);
      const Parting parting = find_parting(curve, outside);
      out.reversible = parting.reversible;
      out.leave_nm = parting.end.overlap * s.overlap_nm;
      out.enter_nm =
          parting.reversible ? out.leave_nm : find_handover(curve, outside).inside.overlap * s.overlap_nm;
      out.offset_aj = parting.energy_offset * s.energy_aj;
    } else {
      out.leave_nm = curve.fold({1.0, 0.0}).overlap * s.overlap_nm;
      out.enter_nm = -curve.range() * s.overlap_nm;
      out.reversible = p.model == ContactLaw::kHertz;
    }
    return out;
  });
}

double BranchPotential::offset_slope(double log_radius) const {
  const TipSampleParameters& p = law_.parameters();
  if (!p.van_der_waals) return 0;
  if (p.model == ContactLaw::kMaugisDugdale) {
    const ContactScales s = medium_.scales(det_exp(log_radius));
    const MaugisDugdale curve(s.lambda);
    const OutsideLaw outside(s.lambda);
    return offset_moment(curve, find_parting(curve, outside), outside) * s.energy_aj;
  }
  const auto offset = [&](int steps) { return at_radius(log_radius + steps * kSlopeStep).offset_aj; };
  return (8.0 * (offset(1) - offset(-1)) - (offset(2) - offset(-2))) / (12.0 * kSlopeStep);
}

BranchPotential::Place BranchPotential::place(double log_radius) const noexcept {
  const auto count = static_cast<std::ptrdiff_t>(pieces_.size());
  const double at = std::clamp((log_radius - first_) * per_step_, 0.0, static_cast<double>(count));
  const std::ptrdiff_t piece = std::min(static_cast<std::ptrdiff_t>(at), count - 1);
  return {&pieces_[static_cast<std::size_t>(piece)], at - static_cast<double>(piece)};
}

// Within a piece by the exponential's series, of which 1e-17 is left out.
double BranchPotential::cube_root(const Place& at, double log_radius) const noexcept {
  const double beyond = log_radius - first_;
  if (!(beyond >= 0.0 && at.t < 1.0)) return det_exp(log_radius * (1.0 / 3.0));
  const double x = at.t * step_ * (1.0 / 3.0);
  const double x2 = x * x;
  const double high = (1.0 / 24.0 + x * (1.0 / 120.0)) + x2 * (1.0 / 720.0);
  return at.piece->cube_root * ((1.0 + x) + x2 * ((0.5 + x * (1.0 / 6.0)) + x2 * high));
}

BranchPotential::Borders BranchPotential::borders(const Place& at) const noexcept {
  return {cubic(at.piece->enter, at.t), cubic(at.piece->leave, at.t), at.piece->reversible};
}

double BranchPotential::touch_energy_aj(double log_radius) const noexcept {
  const Place at = place(log_radius);
  return cubic(at.piece->touch, at.t);
}

void BranchPotential::outside(double overlap_nm, double log_radius, PotentialJet& jet) const noexcept {
  renew(jet);
  const VanDerWaals& attraction = medium_.van_der_waals();
  if (attraction.hamaker_aj > 0) {
    const double radius = det_exp(log_radius);
    const double per_gap = 1.0 / (cut_off_nm_ - overlap_nm);
    jet.energy_aj = -attraction.hamaker_aj * radius * per_gap / 6.0;
    jet.force_nn = jet.energy_aj * per_gap;
    jet.stiffness_n_m = 2.0 * jet.force_nn * per_gap;
    jet.by_radius_aj = jet.by_radius_twice_aj = jet.energy_aj;
    jet.mixed_nn = jet.force_nn;
    if (far_) far_->add(overlap_nm, log_radius, radius, jet);
  }
}

bool BranchPotential::on_law(double overlap_nm, double log_radius, double root, CurveHint& hint,
                             PotentialJet& jet, ContactSize& size) const noexcept {
  const double square = root * root;
  const ContactScales s{unit_.length_nm * square, unit_.overlap_nm * root, unit_.force_nn * (square * root),
                        unit_.energy_aj * (square * square), unit_.lambda * root};
  return with_curve(law_.parameters(), s.lambda, [&](const auto& curve) {
    return on_curve(curve, s, overlap_nm, log_radius, hint, jet, size);
  });
}

bool BranchPotential::by_differences(double overlap_nm, double log_radius, const CurveHint& hint,
                                     PotentialJet& jet, ContactSize& size) const noexcept {
  struct Side {
    PotentialJet jet;
    ContactSize size;
    bool there = false;
  };
  const auto at = [&](int steps) {
    Side side;
    CurveHint near = hint;
    const double at_side = log_radius + steps * kModelStep;
    side.there = on_law(overlap_nm, at_side, det_exp(at_side / 3.0), near, side.jet, side.size);
    return side;
  };
  const Side here{jet, size, true}, up = at(1), down = at(-1);
  const auto differences = [&](const auto& of, double& first, double* second) {
    const double per = 1.0 / kModelStep;
    if (up.there && down.there) {
      first = 0.5 * per * (of(up) - of(down));
      if (second) *second = per * per * (of(up) - 2.0 * of(here) + of(down));
      return true;
    }
    // Beside the fold: from the side that has the state.
    const double side = up.there ? 1.0 : -1.0;
    const Side& one = up.there ? up : down;
    const Side two = at(up.there ? 2 : -2);
    if (!one.there || !two.there) return false;
    first = 0.5 * side * per * (4.0 * of(one) - 3.0 * of(here) - of(two));
    if (second) *second = per * per * (of(here) - 2.0 * of(one) + of(two));
    return true;
  };
  return differences([](const Side& s) { return s.jet.energy_aj; }, jet.by_radius_aj,
                     &jet.by_radius_twice_aj) &&
         differences([](const Side& s) { return s.jet.force_nn; }, jet.mixed_nn, nullptr) &&
         differences([](const Side& s) { return s.size.square_nm2; }, size.by_log_radius_nm2, nullptr);
}

bool BranchPotential::inside(const Place& at, double overlap_nm, double log_radius, CurveHint& hint,
                             PotentialJet& jet, ContactSize& size) const noexcept {
  const double root = cube_root(at, log_radius);
  if (!on_law(overlap_nm, log_radius, root, hint, jet, size)) return false;
  if (model_moves_ && !by_differences(overlap_nm, log_radius, hint, jet, size)) return false;
  const double(&c)[4] = at.piece->offset;
  jet.energy_aj += cubic(c, at.t);
  jet.by_radius_aj += (c[1] + at.t * (2.0 * c[2] + 3.0 * at.t * c[3])) * per_step_;
  jet.by_radius_twice_aj += (2.0 * c[2] + 6.0 * at.t * c[3]) * (per_step_ * per_step_);
  if (far_) far_->add(overlap_nm, log_radius, root * root * root, jet);
  return true;
}

template <class Curve>
bool BranchPotential::on_curve(const Curve& curve, const ContactScales& s, double overlap_nm,
                               double log_radius, CurveHint& hint, PotentialJet& jet,
                               ContactSize& size) const noexcept {
  double guess = hint.parameter;
  if (guess > 0) {
    const double deeper = overlap_nm - hint.overlap_nm;
    const double moved = deeper * (hint.by_overlap_per_nm + 0.5 * deeper * hint.by_overlap_twice_per_nm2) +
                         hint.by_log_radius * (log_radius - hint.log_radius);
    if (std::fabs(moved) < 0.3 * guess) guess += moved;
  }
  const double per_overlap = 1.0 / s.overlap_nm;
  const double overlap = overlap_nm * per_overlap;
  const CurveSolution found = curve.solve(overlap, {1.0, 0.0}, guess);
  const CurvePoint& p = found.point;
  if (found.status != CurveStatus::kOk && !((p.overlap - overlap) * s.overlap_nm < kAtFold_nm)) return false;
  if (!(p.overlap_rate > 0)) return false;
  const double per_rate = 1.0 / p.overlap_rate;
  const double slope = p.load_rate * per_rate;
  const double shifted = p.overlap_by_lambda + p.overlap;
  constexpr double kThird = 1.0 / 3.0;
  const double mixed = p.load + (p.load_by_lambda - slope * shifted) * kThird;
  const Moment moment = moment_of(curve, p);
  jet.energy_aj = s.energy_aj * p.energy;
  jet.force_nn = s.force_nn * p.load;
  jet.by_radius_aj = s.energy_aj * moment.value;
  jet.stiffness_n_m = s.force_nn * per_overlap * slope;
  jet.mixed_nn = s.force_nn * mixed;
  jet.by_radius_twice_aj =
      s.energy_aj * ((4.0 / 3.0) * moment.value + (moment.by_lambda - mixed * shifted) * kThird);
  if (!p.contact) {
    hint = {};
    size = {};
    return true;
  }
  const double a = p.contact_radius;
  const double both = a > 0 ? a * p.contact_radius_rate * per_rate : 0.0;
  const double length2 = s.length_nm * s.length_nm;
  size.square_nm2 = length2 * a * a;
  size.by_overlap_nm = 2.0 * both * length2 * per_overlap;
  size.by_log_radius_nm2 =
      length2 * ((4.0 / 3.0) * a * a + (2.0 / 3.0) * (a * p.contact_radius_by_lambda - both * shifted));
  const double per_nm = per_rate * per_overlap;
  hint = {overlap_nm,
          log_radius,
          p.parameter,
          per_nm,
          -p.overlap_bend * per_nm * per_nm * per_rate,
          -shifted * per_rate * kThird};
  return true;
}

void BranchPotential::add_bias(double overlap_nm, double log_radius, PotentialJet& jet) const noexcept {
  if (bias_) bias_->add(overlap_nm, log_radius, det_exp(log_radius), jet);
}

}  // namespace telenano::physics
