// Newton's step of ParticleBalance: where it leads, how long it may be, and how it is shortened until Π falls.
// What is balanced, and when it is, stands in particle_balance.cpp.
#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

#include "telenano/nve_server/physics/numerics/cholesky_nine.h"
#include "telenano/nve_server/physics/numerics/numbers.h"
#include "telenano/nve_server/physics/particle/particle_balance.h"

namespace telenano::physics {
namespace {

constexpr int kMaxHalvings = 40;
constexpr int kMaxHoldBacks = 12;
constexpr double kLongestStepRadii = 0.3;
constexpr double kLongestStepOfGap = 0.5;
constexpr double kLongestTurn_rad = 0.3;
constexpr double kArmijo = 1e-4;

// What bends downwards taken to bend upwards, but no steeper than `most`: the gentlest step that goes down.
Mat3 bent_upwards(const Mat3& h, double most_n_m) noexcept {
  const Eigen::SelfAdjointEigenSolver<Mat3> eigen(h);
  Vec3 k = eigen.eigenvalues();
  if (k[0] >= 0.0) return h;
  for (int i = 0; i < 3; ++i) k[i] = k[i] < 0.0 ? std::min(-k[i], most_n_m) : k[i];
  return eigen.eigenvectors() * k.asDiagonal() * eigen.eigenvectors().transpose();
}

Mat3 cross_matrix(const Vec3& v) noexcept {
  Mat3 m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

}  // namespace

// The lower triangle of ∇∇Π, all that a Cholesky factor reads. With a the unit vector along which a bristle slips (0 if it
// sticks; it lies across n), b = a × n and c the bristle's stiffness, a contact's friction adds to the blocks of (Δq, Δq),
// (φ, Δq) and (φ, φ)
//   slide  c (1 − nnᵀ − aaᵀ),   c R_p ([n]ᵀ − baᵀ),   c R_p² (1 − nnᵀ − bbᵀ)
//   roll                                              c (1 − nnᵀ − aaᵀ)
//   spin                                              c nnᵀ, 0 where it slips.
void ParticleBalance::hessian(const Trial& trial, bool convex, Mat9& h) const noexcept {
  const double lever = model_.parameters.particle_radius_nm;
  Mat3 tip = spring_, particle = drag_n_m_ * Mat3::Identity(),
       turn = drag_n_m_ * lever * lever * Mat3::Identity();
  Mat3 between = Mat3::Zero(), turn_by_tip = Mat3::Zero(), turn_by_particle = Mat3::Zero();
  for (int i = 0; i < kParticleContacts; ++i) {
    if (asleep_ && i == kParticleSample) continue;
    const ContactTrial& contact = trial.contacts[i];
    const Held& held = held_[i];
    const Pair pair = kPairs[i];
    Mat3 relative;
    if (on_ground(i)) {
      relative = convex ? bent_upwards(contact.hessian_n_m, held.stiffest_n_m) : contact.hessian_n_m;
    } else {
      const double force = contact.law.force_nn;
      double stiffness = contact.law.stiffness_n_m;
      if (stiffness < 0.0) {
        stiffness = std::max(stiffness, -held.stiffest_n_m);
        if (convex) stiffness = -stiffness;
      }
      const Mat3 along = contact.normal_w * contact.normal_w.transpose();
      relative = stiffness * along;
      if (!convex || force < 0.0) {  // ∇²δ bends downwards
        relative += force / contact.distance_nm * (along - Mat3::Identity());
      }
    }

    const Vec3& n = held.normal_w;
    const bool turns = pair.particle != 0.0;
    const Mat3 across = Mat3::Identity() - n * n.transpose();
    if (held.slide.acts()) {
      const Vec3& a = contact.slide.along;
      const double c = contact.slide.stiffness;
      relative += c * (across - a * a.transpose());
      if (turns) {
        const Vec3 b = a.cross(n);
        const Mat3 coupled = c * lever * (cross_matrix(n).transpose() - b * a.transpose());
        turn += c * lever * lever * (across - b * b.transpose());
        turn_by_particle += pair.particle * coupled;
        if (pair.tip != 0.0) turn_by_tip += pair.tip * coupled;
      }
    }
    if (held.roll.acts()) {
      const Vec3& a = contact.roll.along;
      turn += contact.roll.stiffness * (across - a * a.transpose());
    }
    if (held.spin.acts() && !contact.spin.slips) turn += contact.spin.stiffness * (n * n.transpose());
    if (pair.tip != 0.0) tip += relative;
    if (turns) particle += relative;
    if (pair.tip != 0.0 && turns) between += pair.tip * pair.particle * relative;
  }
  h.block<3, 3>(0, 0) = tip;
  h.block<3, 3>(3, 3) = particle;
  h.block<3, 3>(6, 6) = turn;
  h.block<3, 3>(3, 0) = between;
  h.block<3, 3>(6, 0) = turn_by_tip;
  h.block<3, 3>(6, 3) = turn_by_particle;
}

double ParticleBalance::excess(const Vec9& step) const noexcept {
  // A third of the smaller sphere, so that nothing is passed through; half the gap where that is more.
  const ParticleParameters& p = model_.parameters;
  const double lever = p.particle_radius_nm;
  const double longest = std::max(kLongestStepRadii * std::min(p.tip_radius_nm, lever),
                                  -kLongestStepOfGap * best_->contacts[kTipParticle].law.overlap_nm);
  const double turn = std::max(kLongestTurn_rad, longest / lever);
  return std::max(step.segment<3>(3).norm() / longest, step.tail<3>().norm() / turn);
}

bool ParticleBalance::find_tip_step(bool convex, Vec9& step) const noexcept {
  Mat9 h;
  hessian(*best_, convex, h);
  const Eigen::LLT<Mat3> factor(Mat3(h.topLeftCorner<3, 3>()));
  if (factor.info() != Eigen::Success) return false;
  step.setZero();
  step.head<3>() = -factor.solve(Vec3(best_->gradient.head<3>()));
  return step.allFinite();
}

bool ParticleBalance::find_step(bool convex, Vec9& step) noexcept {
  if (asleep_) return find_tip_step(convex, step);
  Mat9 h;  // its upper triangle is never written, nor read
  hessian(*best_, convex, h);
  CholeskyNine factor;
  if (!factor.compute(h)) return false;
  step = -factor.solve(best_->gradient);
  // A particle that little holds would go far: held back by springs of its own, so that the tip, which may be
  // held by stiff ones, still goes all its way.
  const double lever = model_.parameters.particle_radius_nm;
  double springs = 0.0;
  for (int i = 0; i < kMaxHoldBacks; ++i) {
    const double over = excess(step);
    if (!(over > 1.0)) return std::isfinite(over);
    const double moved = step.segment<3>(3).squaredNorm() + lever * lever * step.tail<3>().squaredNorm();
    const double more = std::max(3.0 * springs, 2.0 * over * std::abs(best_->gradient.dot(step)) / moved);
    h.block<3, 3>(3, 3).diagonal().array() += more;
    h.block<3, 3>(6, 6).diagonal().array() += more * lever * lever;
    springs += more;
    if (!factor.compute(h)) return false;
    step = -factor.solve(best_->gradient);
  }
  step /= std::max(1.0, excess(step));
  return step.allFinite();
}

bool ParticleBalance::descend(const Vec9& step, double tolerance) noexcept {
  const double slope = best_->gradient.dot(step);
  if (!(slope < 0.0)) return false;
  const double before = size(best_->gradient);
  double part = 1.0;
  for (int halving = 0; halving < kMaxHalvings; ++halving, part *= 0.5) {
    evaluate(best_->y + part * step, *trial_);
    if (!trial_->valid) continue;
    const double rounding = 16.0 * kEpsilon * (best_->magnitude_aj + trial_->magnitude_aj);
    const double fall = best_->potential_aj - trial_->potential_aj;
    const bool falls = fall >= -kArmijo * part * slope && fall > rounding;
    // Where the fall drowns in rounding, the gradient decides.
    const bool drowned = std::abs(part * slope) < 4.0 * rounding || std::abs(fall) <= rounding;
    if (falls || (drowned && fall >= -rounding && size(trial_->gradient) < before) ||
        size(trial_->gradient) < 0.5 * tolerance) {
      std::swap(best_, trial_);
      return true;
    }
  }
  return false;
}

}  // namespace telenano::physics
