#include "telenano/nve_server/physics/equilibrium/potential_walk.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/numerics/small_matrix.h"

namespace telenano::physics {
namespace {

constexpr int kMostFollowed = 8;    // evaluations of one attempt
constexpr double kStepDone = 1e-9;  // nm
// Below which Newton's convergence is taken to be quadratic, nm: seen in this step, and seen in one before.
constexpr double kForeseen = 3e-5;
constexpr double kForeseenByRate = 1e-4;
// A rate of convergence that is remembered: for how much more it is taken, and how much a step not looked at
// adds, so that at most some ten in turn end by it.
constexpr double kRateMargin = 2.0;
constexpr double kRateAges = 1.3;
constexpr double kLeastSeen = 1e-7;       // nm: from shorter steps on rounding hides the next
constexpr double kNoise = 1e-8;           // nm, below which steps need not contract any more
constexpr double kContraction = 0.6;      // of each step against the last
constexpr double kPredictorError = 0.5;   // of the free end's move
constexpr double kPredictorLeast = 0.02;  // nm
constexpr double kNear = 1e-4;            // nm from a minimum: E's own rounding says no more
constexpr double kFirstReach = 0.3;       // nm, of the trust region
constexpr double kMostReach = 1.0;        // and of the gap outside:
constexpr double kReachOfGap = 0.5;
constexpr double kLeastReach = 1e-13;
constexpr int kMostRounds = 3;
constexpr double kSameStiffness = 1e-6;

// The step of length `reach` that lowers the quadratic model most: −(H + μ)⁻¹ g, μ found by halving, which
// need not be exact.
Vec3 within_reach(const Mat3& h, const Vec3& g, double reach) noexcept {
  const Eigen::SelfAdjointEigenSolver<Mat3> eigen(h);
  const Vec3 values = eigen.eigenvalues();
  const Vec3 along = eigen.eigenvectors().transpose() * g;
  const auto step = [&](double mu) {
    Vec3 s;
    for (int i = 0; i < 3; ++i) {
      const double k = values[i] + mu;
      s[i] = k > 0.0 ? -along[i] / k : 0.0;
    }
    return s;
  };
  const double least = std::max(0.0, -values[0]);
  double low = least;
  double high = least + g.norm() / reach;
  for (int i = 0; i < 24; ++i) {
    const double middle = 0.5 * (low + high);
    (step(middle).norm() > reach ? low : high) = middle;
  }
  Vec3 s = step(high);
  const double length = s.norm();
  if (values[0] < 0.0 && length < 0.9 * reach) {  // nothing pulls along the way that falls most
    const double more = std::sqrt(reach * reach - length * length);
    s[0] += along[0] > 0.0 ? -more : more;
  }
  return eigen.eigenvectors() * s;
}

}  // namespace

PotentialWalk::PotentialWalk(const TipPotential& potential, const std::optional<Friction>& friction,
                             const PotentialState& from) noexcept
    : potential_(potential),
      friction_(friction),
      springs_(from.springs),
      x_(from.free_end_w_nm),
      p_(from.apex_w_nm),
      branch_(from.branch),
      hint_(from.hint),
      follow_(from.follow),
      convergence_(from.convergence_per_nm),
      bristle_(from.bristle),
      broken_(from.broken_away),
      most_(PotentialEquilibrium::kMostEvaluations) {}

void PotentialWalk::place(const Vec3& x) noexcept {
  x_ = p_ = x;
  branch_ = {};
}

bool PotentialWalk::follow(const Vec3& to_x, const Vec3& bend) noexcept {
  const Vec3 move = to_x - x_;
  Vec3 q = p_ + follow_ * move + bend;
  if (springs_.rank < 3) q += springs_.rigid_part(to_x - x_ - (q - p_));
  PotentialBranch branch = branch_;
  CurveHint hint = hint_;
  PotentialSample& at = at_;  // who comes after a failure looks again
  double last = 0;
  bool crossed = false;
  RubbedContact touch;
  FrictionStep rub, rest;
  for (int i = 0; i < kMostFollowed && evaluations_ < most_; ++i) {
    const BranchEnd end = sample(q, branch, hint, at);
    if (end != BranchEnd::kNone) {
      // Across a border that is used both ways: had the tip been where it is so, too?
      if (end != BranchEnd::kContact || crossed || !at.reversible || !was_reversible()) return false;
      crossed = true;
      branch.inside = !branch.inside;
      last = 0;
      continue;
    }
    Vec3 g = springs_.gradient(q - to_x, at.gradient_nn);
    Mat3 inverse;
    const bool rubs = friction_ && at.size.square_nm2 > 0.0;
    if (rubs) {
      rubbed_contact(at, touch);
      friction_->move(bristle_, touch.normal, q - p_, touch.radius, touch.load, false, rub);
      g -= springs_.to_frame(rub.force_w_nn);
      if (!positive_definite(springs_.hessian(at.hessian_n_m + rub.stiffness_n_m))) return false;
      inverse = inverse_of(springs_.hessian(at.hessian_n_m + rubbing_tangent(touch, rub, q - p_)));
    } else if (!invert_positive(springs_.hessian(at.hessian_n_m), inverse)) {
      return false;
    }
    const Vec3 step = -(inverse * g);
    const double length = step.norm();
    if (!(last > 0.0)) {
      if (!(length <= kPredictorError * (move.norm() + bend.norm()) + kPredictorLeast)) return false;
    } else if (!(length <= kContraction * last || length < kNoise)) {
      return false;
    }
    if (last > kLeastSeen) convergence_ = length / (last * last);
    const bool foreseen =
        last > 0.0 && length < kForeseen && length * length * length < kStepDone * last * last;
    const bool by_rate = !(last > 0.0) && length < kForeseenByRate && convergence_ > 0.0 &&
                         kRateMargin * convergence_ * length * length < kStepDone;
    const bool done = length < kStepDone || foreseen || by_rate || (last > 0.0 && length < kNoise);
    const Vec3 step_w = springs_.to_world(step);
    if (done && rubs) {
      friction_->move_once(bristle_, (touch.normal + touch.turn * step_w).normalized(), q + step_w - p_,
                           std::max(0.0, touch.radius + touch.radius_grad.dot(step_w)),
                           touch.load + touch.load_grad.dot(step_w), false, rest);
    }
    // The kink where a contact begins to slide is nothing that a rate foresees.
    if (done && !(by_rate && rubs && rest.sliding != rub.sliding)) {
      if (by_rate) convergence_ *= kRateAges;
      if (rubs && rub.sliding && may_stick_and_slip()) return false;  // it breaks away
      x_ = to_x;
      branch_ = branch;
      hint_ = hint;
      settle(q, step_w, at, inverse);
      if (rubs) {
        force_ += rest.force_w_nn;
        rest_on(rest, rest.after);
      } else if (friction_) {
        rest_on({}, FrictionState{});
      }
      return true;
    }
    last = length;
    q += step_w;
  }
  return false;
}

void PotentialWalk::hold(const Vec3& to_x) noexcept {
  if (springs_.rank < 3) p_ += springs_.rigid_part(to_x - x_);
  x_ = to_x;
  balanced_ = false;
}

bool PotentialWalk::descend() noexcept {
  balanced_ = false;
  if (!look()) return false;
  if (!friction_) return fall();
  bool found = false;
  for (int round = 0; round < kMostRounds; ++round) {
    const double k = bristle_.stiffness_n_m;
    hold_friction();
    found = fall();
    const bool slipped = let_go();
    if (!found) break;
    if (slipped && !broken_ && may_stick_and_slip()) {
      // At the static limit it has let go: on to where the kinetic one holds it.
      broken_ = true;
      if (spent()) {
        balanced_ = found = false;
        break;
      }
      round = -1;
      continue;
    }
    if (std::abs(bristle_.stiffness_n_m - k) <= kSameStiffness * k) break;
  }
  if (found) broken_ = false;
  return found;
}

/// With stiffness and limit of friction held, from a place that has been looked at.
bool PotentialWalk::fall() noexcept {
  balanced_ = false;
  PotentialSample at = at_;
  double energy = energy_at(p_, at);
  const double before = energy;
  double reach = kFirstReach;
  double near = 0;  // the last step, near a minimum
  bool found = false;
  while (true) {
    const Vec3 g = springs_.gradient(p_ - x_, at.gradient_nn) - springs_.to_frame(held_.force_nn(p_));
    const Mat3 h = springs_.hessian(at.hessian_n_m + held_.stiffness_n_m(p_));
    Mat3 inverse;
    Vec3 step = Vec3::Zero();
    bool newton = invert_positive(h, inverse);
    if (newton) {
      step = -(inverse * g);
      const double length = step.norm();
      if (length < kStepDone || (near > 0.0 && length < kNoise)) {
        lost_ += std::max(0.0, before - energy);
        settle(p_, springs_.to_world(step), at, inverse);
        force_ += held_.force_nn(p_);
        found = true;
        break;
      }
      newton = length <= reach;
    }
    if (evaluations_ >= most_) break;
    const double length = step.norm();
    if (newton && length < kNear && !(near > 0.0 && length > kContraction * near)) {
      // So near that E hardly tells: by the steps alone.
      CurveHint hint = hint_;
      PotentialSample there;
      const Vec3 q = p_ + springs_.to_world(step);
      if (sample(q, branch_, hint, there) == BranchEnd::kNone) {
        p_ = q;
        hint_ = hint;
        at = there;
        energy = std::min(energy, energy_at(p_, at));
        near = length;
        continue;
      }
      if (evaluations_ >= most_) break;
    }
    near = 0;
    if (!newton) step = within_reach(h, g, reach);
    const Vec3 q = p_ + springs_.to_world(step);
    CurveHint hint = hint_;
    PotentialSample there;
    PotentialBranch branch = branch_;
    bool jumps = false;
    const bool good = arrive(q, branch, hint, there, jumps);
    const double after = good ? energy_at(q, there) : energy;
    if (!(after < energy)) {
      reach = 0.3 * std::min(reach, step.norm());
      if (!(reach > kLeastReach)) break;
      continue;
    }
    const double foreseen = -(g.dot(step) + 0.5 * step.dot(h * step));
    if (energy - after > 0.5 * foreseen) {
      const double gap = branch.inside ? 0.0 : std::max(0.0, -there.place.overlap_nm);
      reach = std::min(kMostReach + kReachOfGap * gap, std::max(reach, 2.0 * step.norm()));
    } else {
      reach = std::max(0.5 * step.norm(), 1e-3);
    }
    if (jumps) ++jumps_;
    p_ = q;
    branch_ = branch;
    hint_ = hint;
    at = there;
    energy = after;
  }
  if (!found) {
    lost_ += std::max(0.0, before - energy);
    at_ = at;
  }
  return found;
}

/// On `branch`, or the one that is there instead.
bool PotentialWalk::arrive(const Vec3& q, PotentialBranch& branch, CurveHint& hint, PotentialSample& at,
                           bool& jumps) noexcept {
  for (int i = 0; i <= TipPotential::kMostEnds; ++i) {
    const BranchEnd end = sample(q, branch, hint, at);
    if (end == BranchEnd::kNone) return true;
    if (end == BranchEnd::kNoNumber) return false;
    jumps = jumps || end == BranchEnd::kBridge || !at.reversible;
    const PotentialBranch next = potential_.beyond(end, q, branch, at);
    if (next.bridge.present != branch.bridge.present) hint = {};  // another medium, another curve
    branch = next;
  }
  return false;
}

bool PotentialWalk::look() noexcept {
  const bool wet = branch_.bridge.present;
  const BranchEnd end = sample(p_, branch_, hint_, at_);
  if (end == BranchEnd::kNone) return true;
  finite_ = end != BranchEnd::kNoNumber;
  if (!finite_) return false;
  const double before = at_.energy_aj;
  bool jumps = false;
  hint_ = {};
  branch_ = potential_.beyond(end, p_, branch_, at_);
  if (!arrive(p_, branch_, hint_, at_, jumps)) {
    finite_ = false;
    return false;
  }
  // A tip that is held rigidly has been pushed through: what a bridge sets free is lost there too.
  if (end == BranchEnd::kBridge && branch_.bridge.present != wet) {
    lost_ += std::max(0.0, before - at_.energy_aj);
    ++jumps_;
  }
  return true;
}

bool PotentialWalk::was_reversible() const noexcept {
  ContactJet at;
  potential_.fields().contact_at(p_, at);
  const BranchPotential& dry = potential_.potential();
  const BranchPotential& law = branch_.bridge.present && dry.wet() ? *dry.wet() : dry;
  return law.borders(at.log_radius).reversible;
}

// ---- Friction

void PotentialWalk::rest_on(const FrictionStep& step, const FrictionState& after) noexcept {
  // Without contact the bristle is released.
  rubbed_ += after.stiffness_n_m > 0.0 ? step.dissipated_aj : stored_in(bristle_);
  sliding_ = step.sliding;
  bristle_ = after;
}

void PotentialWalk::hold_friction() noexcept {
  const RubbedContact touch = rubbed_contact(at_);
  const double ratio = broken_ ? friction_->parameters().kinetic_ratio : 1.0;
  held_ = HeldFriction(bristle_, p_, ratio * friction_->limit_nn(touch.radius, touch.load), broken_);
  rubbed_ += held_.broken_aj();
}

/// Ends what hold_friction() began: what slipped is counted, and the bristle put on the contact as it is.
/// True: it slipped.
bool PotentialWalk::let_go() noexcept {
  double slipped_aj = 0;
  if (held_.active()) {
    bristle_.extension_w_nm = held_.slipped(p_, slipped_aj);
    rubbed_ += slipped_aj;
  }
  const RubbedContact touch = rubbed_contact(at_);
  const FrictionStep put =
      friction_->move(bristle_, touch.normal, Vec3::Zero(), touch.radius, touch.load, broken_);
  // All that the bristle has less: the tip stands still, so no force works while it slips.
  rubbed_ += std::max(0.0, stored_in(bristle_) - stored_in(put.after));
  sliding_ = put.sliding || slipped_aj > 0.0;
  bristle_ = put.after;
  held_ = {};
  return slipped_aj > 0.0;
}

// ---- What came of it

// Newton's last step, of second order in the energy and of first in the force.
void PotentialWalk::settle(const Vec3& q, const Vec3& step, const PotentialSample& at,
                           const Mat3& inverse) noexcept {
  if (&at != &at_) at_ = at;
  const Vec3 turned = at.hessian_n_m * step;
  at_.energy_aj += at.gradient_nn.dot(step) + 0.5 * step.dot(turned);
  force_ = -(at.gradient_nn + turned);
  const double deeper = at.place.overlap_grad.dot(step);
  at_.place.overlap_nm += deeper;
  at_.law.force_nn +=
      at.law.stiffness_n_m * deeper + at.law.mixed_nn * at.place.log_radius_grad_per_nm.dot(step);
  p_ = q + step;
  balanced_ = true;
  follow_ = springs_.follow(at.hessian_n_m, inverse);
}

void PotentialWalk::forget_losses() noexcept {
  lost_ = rubbed_ = 0;
  jumps_ = 0;
}

void PotentialWalk::write(TipSolution& out) const noexcept {
  const ContactJet& place = at_.place;
  out.apex_w_nm = p_;
  out.potential_aj = at_.energy_aj;
  if (balanced_) {
    out.force_w_nn = force_;
  } else {
    out.force_w_nn = springs_.force_nn(p_ - x_, -at_.gradient_nn);
    out.under_way = true;
  }
  const double steepness = place.overlap_grad.norm();
  out.normal_w = steepness > 0.0 ? Vec3(-place.overlap_grad / steepness) : Vec3(Vec3::UnitZ());
  out.normal_force_nn = at_.law.force_nn * steepness + at_.other_load_nn;
  out.overlap_nm = place.overlap_nm;
  out.radius_nm = det_exp(place.log_radius);
  out.contact_radius_nm = std::sqrt(std::max(0.0, at_.size.square_nm2));
  out.stiffness_n_m = at_.law.stiffness_n_m * steepness * steepness + at_.other_stiffness_n_m;
  out.dissipated_aj = lost_;
  out.friction_w_nn = -bristle_.stiffness_n_m * bristle_.extension_w_nm;
  out.friction_stored_aj = stored_in(bristle_);
  out.friction_dissipated_aj = rubbed_;
  out.sliding = sliding_;
  out.jumps = jumps_;
  out.iterations = evaluations_;
  const TipSampleParameters& law = potential_.potential().law().parameters();
  const Branch outer = law.van_der_waals ? Branch::kVanDerWaals : Branch::kFree;
  const Branch inner = at_.size.square_nm2 > 0.0 ? Branch::kContact : Branch::kNonContact;
  out.branch = branch_.inside ? inner : outer;
}

void PotentialWalk::write(PotentialState& out) const noexcept {
  out.started = true;
  out.branch = branch_;
  out.under_way = !balanced_;
  out.broken_away = broken_;
  out.free_end_w_nm = x_;
  out.apex_w_nm = p_;
  out.hint = hint_;
  out.follow = follow_;
  out.convergence_per_nm = convergence_;
  out.bristle = bristle_;
}

}  // namespace telenano::physics
