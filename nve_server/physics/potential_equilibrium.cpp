#include "nve_server/physics/potential_equilibrium.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "common/base/det_math.h"

namespace telenano::physics {
namespace {

constexpr int kMostFollowed = 8;          // evaluations of one attempt
constexpr int kMostHalvings = 2;          // four parts
constexpr int kFirstEvaluations = 2000;   // where the tip is placed
constexpr double kStepDone = 1e-9;        // nm
constexpr double kForeseen = 1e-5;        // nm, below which Newton's convergence is taken to be quadratic
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
constexpr double kRigid = 1e-12;  // of the greatest compliance
constexpr double kLongerMove = 2.0;
constexpr double kTurnedMove = 0.2;

double part_of_last(const Vec3& last, const Vec3& move) noexcept {
  const double last_sq = last.squaredNorm();
  if (!(last_sq > 0.0)) return 0.0;
  const double part = move.dot(last) / last_sq;
  const double turned_sq = (move - part * last).squaredNorm();
  return part > 0.0 && part < kLongerMove && turned_sq < kTurnedMove * kTurnedMove * last_sq ? part : 0.0;
}

void make_frame(const Compliance& c, SpringFrame& frame) noexcept {
  frame.compliance_nm_nn = c;
  const Eigen::LLT<Mat3> llt(c);
  const double most = c.diagonal().maxCoeff();
  const Vec3 pivots = llt.matrixLLT().diagonal();
  if (most > 0.0 && llt.info() == Eigen::Success && pivots.minCoeff() * pivots.minCoeff() > kRigid * most) {
    frame.rank = 3;
    frame.basis_w = Mat3::Identity();
    const Mat3 inverse = c.inverse();
    frame.stiffness_n_m = 0.5 * (inverse + inverse.transpose());
    return;
  }
  const Eigen::SelfAdjointEigenSolver<Mat3> eigen(c);  // values ascend
  frame.rank = 0;
  frame.stiffness_n_m = Mat3::Identity();
  for (int i = 2; i >= 0; --i) {
    const double value = eigen.eigenvalues()[i];
    frame.basis_w.col(2 - i) = eigen.eigenvectors().col(i);
    if (!(most > 0.0 && value > kRigid * most)) continue;
    frame.stiffness_n_m(2 - i, 2 - i) = 1.0 / value;
    frame.rank = 3 - i;
  }
}

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

PotentialEquilibrium::PotentialEquilibrium(std::shared_ptr<const ContactFields> fields,
                                           std::shared_ptr<const BranchPotential> potential,
                                           const std::optional<FrictionParameters>& friction)
    : fields_(std::move(fields)), potential_(std::move(potential)) {
  if (friction) friction_.emplace(*friction);
}

bool PotentialEquilibrium::sample(const Vec3& apex, bool inside, CurveHint& hint,
                                  Sample& out) const noexcept {
  fields_->contact_at(apex, out.place);
  const ContactJet& at = out.place;
  out.finite = std::isfinite(at.overlap_nm) && std::isfinite(at.log_radius);
  if (!out.finite) return false;
  const BranchPotential::Borders borders = potential_->borders(at.log_radius);
  out.reversible = borders.reversible;
  if (inside) {
    if (at.overlap_nm < borders.leave_nm) return false;
    if (!potential_->inside(at.overlap_nm, at.log_radius, hint, out.law, out.size)) return false;
  } else {
    if (at.overlap_nm > borders.enter_nm) return false;
    potential_->outside(at.overlap_nm, at.log_radius, out.law);
    out.size = {};
  }
  const auto add = [&out](const PotentialJet& w, const ContactJet& f) {
    out.energy_aj += w.energy_aj;
    out.gradient_nn += w.force_nn * f.overlap_grad + w.by_radius_aj * f.log_radius_grad_per_nm;
    const Mat3 mixed = f.overlap_grad * f.log_radius_grad_per_nm.transpose();
    out.hessian_n_m +=
        w.stiffness_n_m * f.overlap_grad * f.overlap_grad.transpose() +
        w.mixed_nn * (mixed + mixed.transpose()) +
        w.by_radius_twice_aj * f.log_radius_grad_per_nm * f.log_radius_grad_per_nm.transpose() +
        w.force_nn * f.overlap_hess_per_nm + w.by_radius_aj * f.log_radius_hess_per_nm2;
  };
  out.energy_aj = 0;
  out.gradient_nn.setZero();
  out.hessian_n_m.setZero();
  add(out.law, at);
  if (potential_->has_bias()) {
    ContactJet there;
    fields_->at_softening(apex, BranchPotential::kBiasSoftening_nm, there);
    PotentialJet bias;
    potential_->add_bias(there.overlap_nm, there.log_radius, bias);
    add(bias, there);
  }
  out.finite = std::isfinite(out.energy_aj) && is_finite(out.gradient_nn);
  return out.finite;
}

double PotentialEquilibrium::touch_height_nm(double x_nm, double y_nm, double highest_nm) const noexcept {
  // δ falls with z nearly as a line: Newton's method, held to downward steps of half the gap at most where
  // the softening bends it.
  double z = highest_nm;
  for (int i = 0; i < 200; ++i) {
    ContactJet at;
    fields_->contact_at(Vec3(x_nm, y_nm, z), at);
    const double rate = std::min(at.overlap_grad.z(), -0.1);
    const double step = -at.overlap_nm / rate;
    z += step;
    if (std::abs(step) < 1e-11) break;
  }
  return z;
}

/// One step: the free end's way, and the tip's.
class PotentialEquilibrium::Walk {
 public:
  Walk(const PotentialEquilibrium& equilibrium, const PotentialState& from,
       const SpringFrame& springs) noexcept
      : on_(equilibrium),
        springs_(springs),
        x_(from.free_end_w_nm),
        p_(from.apex_w_nm),
        inside_(from.inside),
        hint_(from.hint),
        follow_(from.follow),
        bristle_(from.bristle) {}

  void place(const Vec3& x, bool inside) noexcept {
    x_ = p_ = x;
    inside_ = inside;
  }

  bool follow(const Vec3& to_x, const Vec3& bend) noexcept {
    const Vec3 move = to_x - x_;
    Vec3 q = p_ + follow_ * move + bend;
    if (springs_.rank < 3) q += rigid_part(to_x - x_ - (q - p_));
    bool inside = inside_;
    CurveHint hint = hint_;
    Sample at;
    double last = 0;
    bool crossed = false;
    for (int i = 0; i < kMostFollowed && evaluations_ < most_; ++i) {
      ++evaluations_;
      if (!on_.sample(q, inside, hint, at)) {
        // Across a border that is used both ways: had the tip been where it is so, too?
        if (!at.finite || crossed || !at.reversible || !was_reversible()) return false;
        crossed = true;
        inside = !inside;
        last = 0;
        continue;
      }
      Vec3 g = gradient(q, to_x, at);
      Mat3 h = hessian(at.hessian_n_m);
      Touch touch;
      FrictionStep rub;
      Mat3 inverse;
      const bool rubs = on_.friction_ && at.size.square_nm2 > 0.0;
      if (rubs) {
        touch = touch_at(at);
        rub = on_.friction_->move(bristle_, touch.normal, q - p_, touch.radius, touch.load, false);
        g -= in_frame(rub.force_w_nn);
        h = hessian(at.hessian_n_m + rub.stiffness_n_m);
      }
      const Eigen::LLT<Mat3> llt(h);
      if (llt.info() != Eigen::Success) return false;
      if (rubs) inverse = hessian(at.hessian_n_m + tangent(touch, rub, q - p_)).inverse();
      const Vec3 step = rubs ? Vec3(-(inverse * g)) : Vec3(-llt.solve(g));
      const double length = step.norm();
      if (!(last > 0.0)) {
        if (!(length <= kPredictorError * (move.norm() + bend.norm()) + kPredictorLeast)) return false;
      } else if (!(length <= kContraction * last || length < kNoise)) {
        return false;
      }
      const bool foreseen =
          last > 0.0 && length < kForeseen && length * length * length < kStepDone * last * last;
      const bool done = length < kStepDone || foreseen || (last > 0.0 && length < kNoise);
      const Vec3 step_w = back(step);
      if (done) {
        const Vec3 from = p_;
        x_ = to_x;
        inside_ = inside;
        hint_ = hint;
        if (!rubs) {
          settle(q, step_w, at, [&](const Mat3& m) { return Mat3(llt.solve(m)); });
          if (on_.friction_) rest_on({}, FrictionState{});
          return true;
        }
        settle(q, step_w, at, [&](const Mat3& m) { return Mat3(inverse * m); });
        rub = on_.friction_->move(bristle_, (touch.normal + touch.turn * step_w).normalized(), p_ - from,
                                  std::max(0.0, touch.radius + touch.radius_grad.dot(step_w)),
                                  touch.load + touch.load_grad.dot(step_w), false);
        force_ += rub.force_w_nn;
        rest_on(rub, rub.after);
        return true;
      }
      last = length;
      q += step_w;
    }
    return false;
  }

  /// The free end goes on, the tip stays, but for where it is rigidly held.
  void hold(const Vec3& to_x) noexcept {
    if (springs_.rank < 3) p_ += rigid_part(to_x - x_);
    x_ = to_x;
    balanced_ = false;
  }

  /// Down to a local minimum of E at x. False: interrupted.
  bool descend() noexcept {
    balanced_ = false;
    if (!look()) return false;
    if (!on_.friction_) return fall();
    bool found = false;
    for (int round = 0; round < kMostRounds; ++round) {
      const double k = bristle_.stiffness_n_m;
      hold_friction();
      found = fall();
      let_go();
      if (!found || std::abs(bristle_.stiffness_n_m - k) <= kSameStiffness * k) break;
    }
    return found;
  }

  /// The same with stiffness and limit of friction held, from a place that has been looked at.
  bool fall() noexcept {
    balanced_ = false;
    Sample at = at_;
    double energy = at.energy_aj + elastic(p_) + held_energy(p_);
    const double before = energy;
    double reach = kFirstReach;
    double near = 0;  // the last step, near a minimum
    bool found = false;
    while (true) {
      const Vec3 g = gradient(p_, x_, at) - in_frame(held_force(p_));
      const Mat3 h = hessian(at.hessian_n_m + held_stiffness(p_));
      const Eigen::LLT<Mat3> llt(h);
      Vec3 step = Vec3::Zero();
      bool newton = llt.info() == Eigen::Success;
      if (newton) {
        step = -llt.solve(g);
        const double length = step.norm();
        if (length < kStepDone || (near > 0.0 && length < kNoise)) {
          lost_ += std::max(0.0, before - energy);
          settle(p_, back(step), at, [&](const Mat3& m) { return Mat3(llt.solve(m)); });
          force_ += held_force(p_);
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
        Sample there;
        ++evaluations_;
        const Vec3 q = p_ + back(step);
        if (on_.sample(q, inside_, hint, there)) {
          p_ = q;
          hint_ = hint;
          at = there;
          energy = std::min(energy, at.energy_aj + elastic(p_) + held_energy(p_));
          near = length;
          continue;
        }
        if (evaluations_ >= most_) break;
      }
      near = 0;
      if (!newton) step = within_reach(h, g, reach);
      const Vec3 q = p_ + back(step);
      CurveHint hint = hint_;
      Sample there;
      bool inside = inside_;
      ++evaluations_;
      bool good = on_.sample(q, inside, hint, there);
      const bool reversible = there.reversible;
      if (!good && there.finite) {
        inside = !inside;
        ++evaluations_;
        good = on_.sample(q, inside, hint, there);
      }
      const double after = good ? there.energy_aj + elastic(q) + held_energy(q) : energy;
      if (!(after < energy)) {
        reach = 0.3 * std::min(reach, step.norm());
        if (!(reach > kLeastReach)) break;
        continue;
      }
      const double foreseen = -(g.dot(step) + 0.5 * step.dot(h * step));
      if (energy - after > 0.5 * foreseen) {
        const double gap = inside ? 0.0 : std::max(0.0, -there.place.overlap_nm);
        reach = std::min(kMostReach + kReachOfGap * gap, std::max(reach, 2.0 * step.norm()));
      } else {
        reach = std::max(0.5 * step.norm(), 1e-3);
      }
      if (inside != inside_ && !reversible) ++jumps_;
      p_ = q;
      inside_ = inside;
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

  /// Before a solution without a balance: what is where the tip is. False: nowhere that can be.
  bool look() noexcept {
    ++evaluations_;
    if (on_.sample(p_, inside_, hint_, at_)) return true;
    if (!at_.finite) return false;
    inside_ = !inside_;
    ++evaluations_;
    return on_.sample(p_, inside_, hint_, at_);
  }

  void write(TipSolution& out) const noexcept {
    const ContactJet& place = at_.place;
    out.apex_w_nm = p_;
    out.potential_aj = at_.energy_aj;
    if (balanced_) {
      out.force_w_nn = force_;
    } else {
      // The springs' force; in directions in which they are rigid the sample's.
      Vec3 pull = springs_.basis_w.transpose() * (p_ - x_);
      clear_rigid(pull);
      Vec3 f = springs_.basis_w.transpose() * -at_.gradient_nn;
      const Vec3 held = springs_.stiffness_n_m * pull;
      for (int i = 0; i < 3; ++i) f[i] = i < springs_.rank ? held[i] : f[i];
      out.force_w_nn = springs_.basis_w * f;
      out.under_way = true;
    }
    const double steepness = place.overlap_grad.norm();
    out.normal_w = steepness > 0.0 ? Vec3(-place.overlap_grad / steepness) : Vec3(Vec3::UnitZ());
    out.normal_force_nn = at_.law.force_nn * steepness;
    out.overlap_nm = place.overlap_nm;
    out.radius_nm = det_exp(place.log_radius);
    out.contact_radius_nm = std::sqrt(std::max(0.0, at_.size.square_nm2));
    out.stiffness_n_m = at_.law.stiffness_n_m * steepness * steepness;
    out.dissipated_aj = lost_;
    out.friction_w_nn = -bristle_.stiffness_n_m * bristle_.extension_w_nm;
    out.friction_stored_aj = stored_in(bristle_);
    out.friction_dissipated_aj = rubbed_;
    out.sliding = sliding_;
    out.jumps = jumps_;
    out.iterations = evaluations_;
    out.feet = 1;
    const TipSampleParameters& law = on_.potential_->law().parameters();
    const Branch outer = law.van_der_waals ? Branch::kVanDerWaals : Branch::kFree;
    const Branch inner = at_.size.square_nm2 > 0.0 ? Branch::kContact : Branch::kNonContact;
    out.branch = inside_ ? inner : outer;
  }

  void write(PotentialState& out) const noexcept {
    out.started = true;
    out.inside = inside_;
    out.under_way = !balanced_;
    out.free_end_w_nm = x_;
    out.apex_w_nm = p_;
    out.hint = hint_;
    out.follow = follow_;
    out.bristle = bristle_;
  }

  void allow(int evaluations) noexcept { most_ = evaluations; }
  void forget_losses() noexcept {
    lost_ = rubbed_ = 0;
    jumps_ = 0;
  }
  bool spent() const noexcept { return evaluations_ >= most_; }
  const Vec3& apex() const noexcept { return p_; }
  const Sample& here() const noexcept { return at_; }

 private:
  Vec3 rigid_part(const Vec3& v) const noexcept {
    Vec3 y = springs_.basis_w.transpose() * v;
    for (int i = 0; i < 3; ++i) y[i] = i < springs_.rank ? 0.0 : y[i];
    return springs_.basis_w * y;
  }
  void clear_rigid(Vec3& y) const noexcept {
    for (int i = 0; i < 3; ++i) y[i] = i < springs_.rank ? y[i] : 0.0;
  }
  Vec3 back(const Vec3& y) const noexcept { return springs_.rank == 3 ? y : Vec3(springs_.basis_w * y); }

  // Of E in the springs' coordinates; where they are rigid nothing moves.
  Vec3 gradient(const Vec3& q, const Vec3& x, const Sample& at) const noexcept {
    if (springs_.rank == 3) return springs_.stiffness_n_m * (q - x) + at.gradient_nn;
    Vec3 y = springs_.basis_w.transpose() * (q - x);
    clear_rigid(y);
    Vec3 g = springs_.stiffness_n_m * y + springs_.basis_w.transpose() * at.gradient_nn;
    clear_rigid(g);
    return g;
  }
  Vec3 in_frame(const Vec3& force) const noexcept {
    if (springs_.rank == 3) return force;
    Vec3 f = springs_.basis_w.transpose() * force;
    clear_rigid(f);
    return f;
  }
  Mat3 hessian(const Mat3& of_sample) const noexcept {
    if (springs_.rank == 3) return springs_.stiffness_n_m + of_sample;
    Mat3 h = springs_.stiffness_n_m + springs_.basis_w.transpose() * of_sample * springs_.basis_w;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        if (i >= springs_.rank || j >= springs_.rank) h(i, j) = i == j ? 1.0 : 0.0;
      }
    }
    return h;
  }
  double elastic(const Vec3& q) const noexcept {
    Vec3 y = springs_.basis_w.transpose() * (q - x_);
    clear_rigid(y);
    return 0.5 * y.dot(springs_.stiffness_n_m * y);
  }

  bool was_reversible() const noexcept {
    ContactJet at;
    on_.fields_->contact_at(p_, at);
    return on_.potential_->borders(at.log_radius).reversible;
  }

  // ---- Friction

  /// The contact that it acts in, and how that changes with the apex.
  struct Touch {
    Vec3 normal = Vec3::UnitZ();
    Mat3 turn = Mat3::Zero();
    double radius = 0;
    Vec3 radius_grad = Vec3::Zero();
    double load = 0;
    Vec3 load_grad = Vec3::Zero();
  };
  static Touch touch_at(const Sample& at) noexcept {
    Touch t;
    const ContactJet& place = at.place;
    const double steepness = place.overlap_grad.norm();
    if (!(steepness > 0.0)) return t;
    t.normal = -place.overlap_grad / steepness;
    t.turn = -((Mat3::Identity() - t.normal * t.normal.transpose()) * place.overlap_hess_per_nm) / steepness;
    t.load = at.law.force_nn * steepness;
    t.load_grad = steepness * (at.law.stiffness_n_m * place.overlap_grad +
                               at.law.mixed_nn * place.log_radius_grad_per_nm);
    if (!(at.size.square_nm2 > 0.0)) return t;
    t.radius = std::sqrt(at.size.square_nm2);
    t.radius_grad = (at.size.by_overlap_nm * place.overlap_grad +
                     at.size.by_log_radius_nm2 * place.log_radius_grad_per_nm) /
                    (2.0 * t.radius);
    return t;
  }
  /// −∂f/∂p: not symmetric, since the limit follows the place, and f turns with the normal.
  static Mat3 tangent(const Touch& t, const FrictionStep& rub, const Vec3& moved) noexcept {
    return rub.stiffness_n_m - rub.force_per_radius_w_n_m * t.radius_grad.transpose() -
           rub.force_per_load_w * t.load_grad.transpose() + t.normal * (t.turn * rub.force_w_nn).transpose() -
           t.normal.dot(moved) * (rub.stiffness_n_m * t.turn);
  }
  static double stored_in(const FrictionState& bristle) noexcept {
    return 0.5 * bristle.stiffness_n_m * bristle.extension_w_nm.squaredNorm();
  }
  void rest_on(const FrictionStep& step, const FrictionState& after) noexcept {
    // Without contact the bristle is released.
    rubbed_ += after.stiffness_n_m > 0.0 ? step.dissipated_aj : stored_in(bristle_);
    sliding_ = step.sliding;
    bristle_ = after;
  }

  void hold_friction() noexcept {
    held_ = {};
    held_.from = p_;
    held_.stiffness = bristle_.stiffness_n_m;
    held_.extension = bristle_.extension_w_nm;
    held_.across = Mat3::Identity() - bristle_.normal_w * bristle_.normal_w.transpose();
    const Touch touch = touch_at(at_);
    held_.limit =
        std::max(on_.friction_->limit_nn(touch.radius, touch.load), held_.stiffness * held_.extension.norm());
  }
  Vec3 held_extension(const Vec3& q) const noexcept {
    return held_.extension + held_.across * (q - held_.from);
  }
  double held_energy(const Vec3& q) const noexcept {
    if (!(held_.stiffness > 0.0)) return 0;
    const double e = held_extension(q).norm();
    if (held_.stiffness * e <= held_.limit) return 0.5 * held_.stiffness * e * e;
    return held_.limit * (e - 0.5 * held_.limit / held_.stiffness);
  }
  Vec3 held_force(const Vec3& q) const noexcept {
    if (!(held_.stiffness > 0.0)) return Vec3::Zero();
    const Vec3 e = held_extension(q);
    const double length = e.norm();
    return held_.stiffness * length <= held_.limit ? Vec3(-held_.stiffness * e)
                                                   : Vec3(-(held_.limit / length) * e);
  }
  Mat3 held_stiffness(const Vec3& q) const noexcept {
    if (!(held_.stiffness > 0.0)) return Mat3::Zero();
    const Vec3 e = held_extension(q);
    const double length = e.norm();
    if (held_.stiffness * length <= held_.limit) return held_.stiffness * held_.across;
    return (held_.limit / length) * (held_.across - (e / length) * (e / length).transpose());
  }
  /// Ends what hold_friction() began: what slipped is booked, and the bristle put on the contact as it is.
  void let_go() noexcept {
    if (held_.stiffness > 0.0) {
      Vec3 e = held_extension(p_);
      const double length = e.norm();
      const double longest = held_.limit / held_.stiffness;
      if (length > longest) {
        rubbed_ += held_.limit * (length - longest);
        e *= longest / length;
      }
      bristle_.extension_w_nm = e;
    }
    const Touch touch = touch_at(at_);
    const FrictionStep put =
        on_.friction_->move(bristle_, touch.normal, Vec3::Zero(), touch.radius, touch.load, false);
    // All that the bristle has less: the tip stands still, so no force works while it slips.
    rubbed_ += std::max(0.0, stored_in(bristle_) - stored_in(put.after));
    sliding_ = put.sliding;
    bristle_ = put.after;
    held_ = {};
  }

  // Newton's last step, of second order in the energy and of first in the force.
  template <class Solve>
  void settle(const Vec3& q, const Vec3& step, const Sample& at, const Solve& solve) noexcept {
    at_ = at;
    const Vec3 turned = at.hessian_n_m * step;
    at_.energy_aj += at.gradient_nn.dot(step) + 0.5 * step.dot(turned);
    force_ = -(at.gradient_nn + turned);
    const double deeper = at.place.overlap_grad.dot(step);
    at_.place.overlap_nm += deeper;
    at_.law.force_nn +=
        at.law.stiffness_n_m * deeper + at.law.mixed_nn * at.place.log_radius_grad_per_nm.dot(step);
    p_ = q + step;
    balanced_ = true;
    // ∇²E ∂p = K ∂x along the springs, where they are rigid ∂p = ∂x.
    if (springs_.rank == 3) {
      follow_ = solve(springs_.stiffness_n_m);
      return;
    }
    const Mat3& b = springs_.basis_w;
    Mat3 given = Mat3::Zero();  // in the basis: (K − BᵀUB's rigid columns)
    const Mat3 u = b.transpose() * at.hessian_n_m * b;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        if (i >= springs_.rank) {
          given(i, j) = i == j ? 1.0 : 0.0;
        } else {
          given(i, j) = j < springs_.rank ? springs_.stiffness_n_m(i, j) : -u(i, j);
        }
      }
    }
    follow_ = b * solve(given) * b.transpose();
  }

  const PotentialEquilibrium& on_;
  const SpringFrame& springs_;
  Vec3 x_, p_;
  bool inside_;
  CurveHint hint_;
  Mat3 follow_;
  FrictionState bristle_;
  struct HeldFriction {
    double stiffness = 0;
    double limit = 0;
    Vec3 from = Vec3::Zero();
    Vec3 extension = Vec3::Zero();
    Mat3 across = Mat3::Zero();
  } held_;
  double rubbed_ = 0;
  bool sliding_ = false;
  Sample at_;
  Vec3 force_ = Vec3::Zero();
  bool balanced_ = false;
  double lost_ = 0;
  int jumps_ = 0;
  int evaluations_ = 0;
  int most_ = kMostEvaluations;
};

TipSolution PotentialEquilibrium::advance(const Vec3& free_end, const Compliance& c, PotentialState& state,
                                          const Vec3& jolt) const noexcept {
  TipSolution solution;
  solution.status = SolveStatus::kNonFinite;
  if (!is_finite(free_end) || !c.allFinite()) return solution;
  if (c != state.springs.compliance_nm_nn) make_frame(c, state.springs);
  Walk walk(*this, state, state.springs);
  Vec3 move = Vec3::Zero();
  Vec3 bend = Vec3::Zero();
  if (!state.started) {
    walk.place(free_end, false);
    walk.allow(kFirstEvaluations);
    walk.descend();
    walk.forget_losses();
  } else if (state.under_way) {
    walk.hold(free_end);
    walk.descend();
  } else {
    const Vec3 from = state.free_end_w_nm;
    const Vec3 whole = free_end - from;
    const double part_of_trend = part_of_last(state.move_w_nm, whole);
    double gone = 0;
    double part = 1;
    int halvings = 0;
    bool balanced = true;
    bool straight = true;
    while (gone < 1.0 && balanced) {
      const double next = std::min(1.0, gone + part);
      const Vec3 to = next < 1.0 ? Vec3(from + next * whole) : free_end;
      const double trend = straight && halvings == 0 ? part_of_trend : 0.0;
      if (walk.follow(to, trend * trend * state.bend_w_nm + (gone == 0.0 ? jolt : Vec3(Vec3::Zero())))) {
        if (straight && next == 1.0) {
          move = whole;
          bend = walk.apex() - (state.apex_w_nm + state.follow * whole) - jolt;
        }
      } else if (halvings < kMostHalvings && !walk.spent()) {
        ++halvings;
        part *= 0.5;
        straight = false;
        continue;
      } else {
        straight = false;
        walk.hold(to);
        balanced = walk.descend();
      }
      gone = next;
    }
    if (!balanced) {
      walk.hold(free_end);
      if (state.springs.rank < 3) walk.look();
    }
  }
  walk.write(solution);
  if (!walk.here().finite || !is_finite(solution.force_w_nn) || !std::isfinite(solution.potential_aj)) {
    TipSolution none;
    none.status = SolveStatus::kNonFinite;
    return none;
  }
  solution.status = SolveStatus::kOk;
  walk.write(state);
  state.move_w_nm = move;
  state.bend_w_nm = bend;
  return solution;
}

}  // namespace telenano::physics
