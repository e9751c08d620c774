#include "telenano/nve_server/physics/equilibrium/marked_potential.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/contact/flow_family.h"
#include "telenano/nve_server/physics/surface/crater.h"

namespace telenano::physics {
namespace {

constexpr double kYieldSlack = 1e-7;  // of πHa*²: what is left over flows in a later step
constexpr double kFlowDone = 1e-5;    // of πHa*²
constexpr int kMostFlows = 6;         // balances of a step that flows, the elastic one besides
constexpr double kPiece = 1.1;        // of a*
constexpr int kMostPieces = 64;
constexpr double kMostRadii = 300;  // tip radii: the potential has twice that (branch_potential.h)
constexpr double kLeastCosine = 0.1;

/// Of each grid of the fields, and of the heights.
std::vector<std::size_t> tiles_of(const ScanFields& fields, const SplineSurface& heights) {
  std::vector<std::size_t> tiles = fields.tiles_of_grids();
  tiles.push_back(heights.tiles());
  return tiles;
}

}  // namespace

/// Where a flow begins.
struct MarkedPotential::Onset {
  double radius_nm;
  double a_nm;
  double origin_nm;
  double cosine;
  double stiffness_n_m;
  Vec3 normal_w;
  FlowFamily family;
  double overload;  ///< there
};

/// Where the overload vanishes: it falls as a* grows, so between a radius that is too small and one that is too large.
struct MarkedPotential::Bracket {
  double from, r_from;  ///< where the flow begins
  double low, r_low;
  double high = HUGE_VAL, r_high = 0;

  explicit Bracket(const Onset& onset) noexcept
      : from(onset.a_nm), r_from(onset.overload), low(onset.a_nm), r_low(onset.overload) {}

  /// The radius to try after `a`, which left this overload.
  double after(double a, double overload) noexcept {
    if (overload > 0.0) {
      low = a;
      r_low = overload;
    } else {
      high = a;
      r_high = overload;
    }
    if (high < HUGE_VAL) {
      const double next = low + (high - low) * (r_low / (r_low - r_high));
      return next > low && next < high ? next : 0.5 * (low + high);
    }
    return a + std::clamp(1.5 * (a - from) * overload / std::max(1e-12, r_from - overload), 0.1 * (a - from),
                          2.0 * (a - from));
  }
};

MarkedPotential::MarkedPotential(const ScanFields& unmarked, const SplineSurface& heights,
                                 const PotentialEquilibrium& scene,
                                 const std::optional<FrictionParameters>& friction, double hardness_gpa,
                                 double pile_up)
    : fields_(std::make_shared<Yielding>(unmarked)),
      heights_(heights),
      plastic_(scene.potential().law(), hardness_gpa),
      equilibrium_(fields_, scene.shared_potential(), friction),
      tip_radius_nm_(unmarked.tip_radius_nm()),
      last_radius_nm_(kMostRadii * unmarked.tip_radius_nm()),
      pile_up_(pile_up),
      strokes_(tiles_of(fields_->ground, heights_)) {
  fields_->ground.keep_strokes_in(&strokes_);
  heights_.keep_strokes_in(&strokes_, fields_->ground.grid_count());
  if (!(pile_up >= 0.0 && pile_up <= 1.0)) {
    throw UserError("marks: pile-up must be within 0 and 1, not " + std::to_string(pile_up));
  }
}

void MarkedPotential::flow_to(double a, const Onset& onset, const Vec3& free_end, const Compliance& c,
                              const PotentialState& from, Trial& trial) noexcept {
  const double depth = onset.family.depth_nm(onset.a_nm, a);
  trial.a_nm = a;
  trial.cosine = onset.cosine;
  trial.lowered_nm = depth / onset.cosine;
  fields_->lowered_nm = trial.lowered_nm;
  fields_->log_radius_rise = det_log(onset.family.radius_nm(a) / onset.radius_nm);
  // The tip goes after the ground.
  const Vec3 give = c * onset.normal_w;
  const double k = std::max(0.0, onset.stiffness_n_m);
  const Vec3 jolt = -give * (k * depth / (1.0 + k * onset.normal_w.dot(give)));
  trial.state = from;
  trial.solution = equilibrium_.advance(free_end, c, trial.state, jolt);
  trial.overload = overload(trial.solution, onset.origin_nm);
}

// F − Y(a*), over πHa*². F = ∂U/∂δ, which the law of one contact has; on a slope that only marks have made,
// or on several feet, |∇δ| is not 1.
double MarkedPotential::overload(const TipSolution& solution, double origin) const noexcept {
  ContactJet at;
  fields_->contact_at(solution.apex_w_nm, at);
  const double force = solution.normal_force_nn / std::max(at.overlap_grad.norm(), kLeastCosine);
  const double a = plastic_.yield_radius_nm(solution.radius_nm);
  return (force - plastic_.yield_force_nn(solution.radius_nm, origin)) /
         (kPi * plastic_.hardness_gpa() * a * a);
}

// Nothing where the contact bears its load without flow.
std::optional<MarkedPotential::Onset> MarkedPotential::onset_of(const TipSolution& elastic) const noexcept {
  if (elastic.under_way || !(elastic.normal_force_nn > 0.0) || !(elastic.contact_radius_nm > 0.0)) return {};
  const double from = plastic_.yield_radius_nm(elastic.radius_nm);
  double cosine, unmarked;
  fields_->ground.ground_at(elastic.apex_w_nm, cosine, unmarked);
  const double origin = det_exp(unmarked);
  const double too_much = overload(elastic, origin);
  if (!(too_much > kYieldSlack)) return {};
  const double last =
      std::max(from, plastic_.strain() * std::min(last_radius_nm_, PlasticContact::kMostRadii * origin));
  return Onset{elastic.radius_nm,
               from,
               origin,
               std::max(cosine, kLeastCosine),
               elastic.stiffness_n_m,
               elastic.normal_w.normalized(),
               FlowFamily(plastic_.strain(), origin, last),
               too_much};
}

// A first guess of the a* that bears the load: Hertz's slopes at the onset say how far (plastic_contact.cpp).
double MarkedPotential::first_radius_nm(const Onset& onset, const Compliance& c) const noexcept {
  const double from = onset.a_nm, origin = onset.origin_nm;
  const double hard = kPi * plastic_.hardness_gpa();
  const double rate =
      from < onset.family.first_nm ? plastic_.strain() : 2.0 * from / origin - plastic_.strain();
  const double k = std::max(0.0, onset.stiffness_n_m);
  const double soft = 1.0 + k * onset.normal_w.dot(c * onset.normal_w);
  const double falls = (k * rate - 0.5 * elastic_.solution.normal_force_nn / from) / soft + 2.0 * hard * from;
  const double guess = falls > 0.0 ? onset.overload * hard * from * from / falls : 0.1 * from;
  return from + std::clamp(guess, 1e-9 * from, 0.5 * from);
}

// Lets the ground flow until it bears the tip; the fields stay as they were. Null: no trial found a balance.
const MarkedPotential::Trial* MarkedPotential::flow(const Onset& onset, const Vec3& free_end,
                                                    const Compliance& c,
                                                    const PotentialState& from) noexcept {
  Bracket bracket(onset);
  double a = first_radius_nm(onset, c);
  const Trial* kept = nullptr;
  int now = 0;
  for (int i = 0; i < kMostFlows; ++i) {
    Trial& trial = trials_[now];
    flow_to(a, onset, free_end, c, from, trial);
    if (trial.solution.status != SolveStatus::kOk) break;
    kept = &trial;
    now = 1 - now;
    if (trial.solution.under_way || std::abs(trial.overload) <= kFlowDone) break;
    a = bracket.after(a, trial.overload);
  }
  fields_->lowered_nm = fields_->log_radius_rise = 0;
  return kept;
}

// Where and how the ground flowed, for accept() and who reports it.
void MarkedPotential::tell_flow(const Onset& onset, const Trial& kept, TipSolution& solution) const noexcept {
  PlasticFlow& flow = solution.yielded.flow;
  flow.depth_nm = kept.lowered_nm * onset.cosine;
  flow.contact_radius_nm = kept.a_nm;
  flow.radius_nm = onset.family.radius_nm(kept.a_nm);
  solution.yielded.from_radius_nm = onset.radius_nm;
  solution.yielded.origin_radius_nm = onset.origin_nm;
  const Vec3 normal = solution.normal_w.normalized();
  solution.yielded.at_w_nm = solution.apex_w_nm + tip_radius_nm_ * (Vec3::UnitZ() - normal);
  if (solution.normal_force_nn > 0.0) {
    solution.stiffness_n_m = kPi * plastic_.hardness_gpa() * std::min(onset.origin_nm, flow.radius_nm);
  }
}

// What a step that flowed has lost (see Energy). By the descent alone where the step before says nothing of this one's work.
double MarkedPotential::lost_aj(const TipSolution& solution) const noexcept {
  const double by_descent = solution.dissipated_aj;
  if (!last_.known || last_.under_way || solution.under_way) return std::max(0.0, by_descent);
  const double work =
      -0.5 * (last_.force_w_nn + solution.force_w_nn).dot(solution.apex_w_nm - last_.apex_w_nm);
  double lost = work - (solution.potential_aj - last_.potential_aj) -
                (solution.friction_stored_aj - last_.friction_stored_aj) - solution.friction_dissipated_aj;
  if (solution.jumps > 0) lost = std::max(lost, by_descent);
  return std::max(0.0, lost);
}

TipSolution MarkedPotential::advance(const Vec3& free_end, const Compliance& c,
                                     PotentialState& state) noexcept {
  fields_->lowered_nm = fields_->log_radius_rise = 0;
  pending_lowered_nm_ = 0;
  elastic_.state = state;
  elastic_.solution = equilibrium_.advance(free_end, c, elastic_.state);
  const TipSolution& elastic = elastic_.solution;
  if (elastic.status != SolveStatus::kOk) return elastic;
  std::optional<Onset> onset;
  if (state.started) onset = onset_of(elastic);
  const Trial* const flowed = onset ? flow(*onset, free_end, c, state) : nullptr;
  if (flowed == nullptr) {
    state = elastic_.state;
    return elastic;
  }
  TipSolution solution = flowed->solution;
  state = flowed->state;
  pending_lowered_nm_ = flowed->lowered_nm;
  tell_flow(*onset, *flowed, solution);
  solution.dissipated_aj = lost_aj(solution);
  solution.yielded.flow.dissipated_aj = solution.dissipated_aj;
  return solution;
}

bool MarkedPotential::exchange_stroke() noexcept {
  if (strokes_.empty()) return false;
  const std::size_t of_heights = fields_->ground.grid_count();
  strokes_.each_of_last([&](std::size_t grid, std::size_t tile, double* values) {
    if (grid == of_heights) {
      heights_.exchange_tile(tile, values);
    } else {
      fields_->ground.exchange_tile(grid, tile, values);
    }
  });
  return true;
}

void MarkedPotential::keep_undone() noexcept {
  heights_.settle(strokes_.marked_before());
  strokes_.drop_last();
  last_ = {};
  in_stroke_ = false;
  if (journal_ != nullptr) journal_->on_undo();
}

void MarkedPotential::accept(const TipSolution& accepted) noexcept {
  last_ = {true,
           accepted.under_way,
           accepted.force_w_nn,
           accepted.apex_w_nm,
           accepted.potential_aj,
           accepted.friction_stored_aj};
  if (!(accepted.contact_radius_nm > 0.0)) in_stroke_ = false;
  const TipFlow& yielded = accepted.yielded;
  const PlasticFlow& flow = yielded.flow;
  if (!(pending_lowered_nm_ > 0.0) || !(flow.depth_nm > 0.0)) return;
  ++marks_;
  if (!in_stroke_) {
    in_stroke_ = true;
    strokes_.begin(heights_.marked(), maker_);
    if (journal_ != nullptr) journal_->on_stroke();
  }
  const double per_depth = pending_lowered_nm_ / flow.depth_nm;
  pending_lowered_nm_ = 0;
  const double ratio = flow.radius_nm / yielded.from_radius_nm;
  double left = flow.depth_nm;
  double radius = yielded.from_radius_nm;
  for (int piece = 0; piece < kMostPieces && left > 0.0; ++piece) {
    // The last piece takes what is left, so that the depth is exact.
    const bool last = piece + 1 == kMostPieces || radius * kPiece >= flow.radius_nm || !(ratio > 1.0);
    const double to = last ? flow.radius_nm : radius * kPiece;
    const double depth =
        last ? left : std::min(left, plastic_.depth_nm(radius, to, yielded.origin_radius_nm));
    const double a = last ? flow.contact_radius_nm : plastic_.yield_radius_nm(to);
    FieldMark pressed;
    pressed.x_nm = accepted.apex_w_nm.x();
    pressed.y_nm = accepted.apex_w_nm.y();
    pressed.depth_nm = depth * per_depth;
    pressed.radius_nm = a / std::sqrt(kCraterShare);
    pressed.log_radius_rise = det_log(to / radius);
    pressed.strain = plastic_.strain();
    pressed.last_radius_nm = last_radius_nm_;
    pressed.pile_up = pile_up_;
    fields_->ground.press(pressed);
    Mark mark;
    mark.x_nm = yielded.at_w_nm.x();
    mark.y_nm = yielded.at_w_nm.y();
    mark.depth_nm = pressed.depth_nm;
    mark.radius_nm = pressed.radius_nm;
    mark.pile_up = pile_up_;
    heights_.press(mark);
    if (journal_ != nullptr) journal_->on_mark(mark);
    left -= depth;
    radius = to;
    if (last) break;
  }
}

}  // namespace telenano::physics
