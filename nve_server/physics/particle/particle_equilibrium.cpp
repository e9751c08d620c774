#include "telenano/nve_server/physics/particle/particle_equilibrium.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/common/base/renew.h"
#include "telenano/nve_server/physics/particle/particle_balance.h"

namespace telenano::physics {
namespace {

constexpr double kSubstepRadii = 0.125;
constexpr double kSubstepOfGap = 0.5;
constexpr int kMaxSubsteps = 20000;         // 1 µm past a particle of 1 nm takes 8000
constexpr int kMaxIterationsInAll = 50000;  // some 100 ms: the bound on the time of a step
constexpr double kRefine = 0.25;
constexpr double kFinest = 1e-5;
constexpr double kReleaseRefinement = 1e-3;
constexpr double kLeastCompliance = 1e-12;  // nm/nN: 1e-10 nm under 100 nN
constexpr double kEnergyRounding = 1e-12;   // ten times the laws' own
constexpr double kShortestTime_s = 1e-12;
constexpr double kStill_nm = 1e-4;        // in a step: with the default drag 1e-5 nN at 1 kHz
constexpr double kLittlePull = 1e-4;      // of the pull-off
constexpr double kLittleFriction = 1e-2;  // of what friction holds
constexpr double kFallsAsleep = 0.5;      // of the pull that wakes

double allowed_step(const ParticleModel& model, const ParticleState& state) noexcept {
  const ParticleParameters& p = model.parameters;
  const double smaller = std::min(p.tip_radius_nm, p.particle_radius_nm);
  const double gap =
      (state.particle_centre_w_nm - state.tip_centre_w_nm).norm() - p.tip_radius_nm - p.particle_radius_nm;
  double step = std::max(kSubstepRadii * smaller, kSubstepOfGap * gap);
  if (!model.surface->is_flat()) step = std::min(step, kSubstepRadii * p.tip_radius_nm);
  return step;
}

/// The straight way of the free end in one step, gone in sub-steps: shorter ones where a balance was not found, longer ones
/// again after each that was.
class FreeEndWay {
 public:
  FreeEndWay(const Vec3& origin, const Vec3& target) noexcept
      : origin_(origin), target_(target), way_(target - origin), distance_(way_.norm()), end_(origin) {}

  struct SubStep {
    double part;  ///< of the whole way
    bool last;
    Vec3 end;  ///< of the free end
  };
  SubStep next(const ParticleModel& model, const ParticleState& state) const noexcept {
    double part = 1.0 - done_;
    if (distance_ > 0.0)
      part = std::min(part, refined_ * allowed_step(model, state) / distance_);
    else
      part *= refined_;
    const bool last = part >= 1.0 - done_;
    return {part, last, last ? target_ : Vec3(origin_ + (done_ + part) * way_)};
  }
  double refine() noexcept { return refined_ *= kRefine; }
  void go(const SubStep& step) noexcept {
    refined_ = std::min(1.0, 2.0 * refined_);
    end_ = step.end;
    done_ = step.last ? 1.0 : done_ + step.part;
  }

  bool is_done() const noexcept { return !(done_ < 1.0); }
  double refined() const noexcept { return refined_; }  ///< of the longest sub-step allowed
  const Vec3& end() const noexcept { return end_; }     ///< where it is now

 private:
  Vec3 origin_, target_, way_;
  double distance_;
  double done_ = 0.0;
  double refined_ = 1.0;
  Vec3 end_;
};

/// There is no answer: only why, and what was spent on it.
void refuse(SolveStatus status, ParticleSolution& out) noexcept {
  const int substeps = out.substeps, iterations = out.iterations;
  renew(out);
  out.status = out.tip.status = status;
  out.substeps = substeps;
  out.iterations = out.tip.iterations = iterations;
}

double spring_energy(const Vec3& force, const Mat3& compliance) noexcept {
  return 0.5 * force.dot(compliance * force);
}

// The particle touches both.
bool touching(const ParticleState& state) noexcept {
  return is_on_curve(state.contacts[kTipParticle].law.branch) &&
         is_on_curve(state.contacts[kParticleSample].law.branch);
}
bool touching(const ParticleBalance& balance) noexcept {
  return is_on_curve(balance.contact(kTipParticle).law.branch) &&
         is_on_curve(balance.contact(kParticleSample).law.branch);
}

void describe(const ParticleModel& model, const ParticleBalance& balance, const ParticleState& state,
              ParticleSolution& out) noexcept {
  for (int i = 0; i < kParticleContacts; ++i) {
    const ParticleBalance::ContactTrial& now = balance.contact(i);
    ParticleContactReport& report = out.contacts[i];
    report.branch = now.law.branch;
    report.overlap_nm = now.law.overlap_nm;
    report.radius_nm = balance.radius_nm(i);
    report.contact_radius_nm = now.law.contact_radius_nm;
    report.normal_force_nn = now.law.force_nn;
    report.stiffness_n_m = now.law.stiffness_n_m;
    report.normal_w = now.normal_w;
    report.friction_w_nn = -now.slide.force;
    report.force_w_nn = now.push_w_nn + report.friction_w_nn;
    report.rolling_w_nn_nm = -now.roll.force;
    report.spinning_w_nn_nm = -now.spin.force;
    report.slides = now.slide.slips;
    report.rolls = now.roll.slips;
  }
  out.held_by_tip = out.contacts[kTipParticle].touches();
  out.on_surface = out.contacts[kParticleSample].touches();
  out.particle_centre_w_nm = state.particle_centre_w_nm;

  const ParticleContactReport& sample = out.contacts[kTipSample];
  const ParticleContactReport& particle = out.contacts[kTipParticle];
  const bool felt = std::abs(particle.normal_force_nn) > std::abs(sample.normal_force_nn);
  const ParticleContactReport& main = felt ? particle : sample;
  TipSolution& tip = out.tip;
  tip.branch = main.branch;
  tip.apex_w_nm = state.tip_centre_w_nm - Vec3(0.0, 0.0, model.parameters.tip_radius_nm);
  tip.force_w_nn = state.tip_force_w_nn;
  tip.normal_w = felt ? Vec3(-main.normal_w) : main.normal_w;
  tip.normal_force_nn = main.normal_force_nn;
  tip.overlap_nm = main.overlap_nm;
  tip.radius_nm = main.radius_nm;
  tip.contact_radius_nm = main.contact_radius_nm;
  tip.stiffness_n_m = main.stiffness_n_m;
  tip.potential_aj = state.potential_aj;
}

}  // namespace

ParticleEquilibrium::ParticleEquilibrium(std::shared_ptr<const Surface> surface,
                                         const ParticleParameters& parameters, const ParticleGround& ground)
    : model_(std::move(surface), parameters, ground) {
  // Its adhesion and, since most pulls are sideways, its friction: one without friction runs after any pull.
  const ContactFriction& friction = model_.friction[kParticleSample];
  const double a = model_.zero_load_radius_nm[kParticleSample];
  const double pull_off = model_.pull_off_nn[kParticleSample];
  const double slide = friction.shear_strength_gpa * kPi * a * a;
  const double roll = 4.0 * pull_off * friction.rolling_length_nm / parameters.particle_radius_nm;
  little_pull_nn_ = std::min(kLittlePull * pull_off, kLittleFriction * std::min(slide, roll));
}

// On the sample, and nothing gives way.
bool ParticleEquilibrium::rests(const ParticleBalance& balance) const noexcept {
  const ParticleBalance::ContactTrial& sample = balance.contact(kParticleSample);
  return model_.parameters.sleeps && sample.law.branch == Branch::kContact && !sample.slide.slips &&
         !sample.roll.slips && !sample.spin.slips;
}

// The tip's pull is little against what holds the particle.
bool ParticleEquilibrium::left_alone(const ParticleBalance& balance, double share) const noexcept {
  const Equilibrium& tip = balance.contact(kTipParticle).law;
  return !is_on_curve(tip.branch) && std::abs(tip.force_nn) <= share * little_pull_nn_;
}

ParticleState ParticleEquilibrium::place(double x_nm, double y_nm) const noexcept {
  const double radius = model_.parameters.particle_radius_nm;
  const TipPotential& ground = *model_.ground[kParticleSample];
  // Down to touch as PotentialEquilibrium::touch_height_nm, then in contact to where ∂U/∂z = 0.
  Vec3 apex(x_nm, y_nm, model_.surface->highest_nm() + radius);
  ContactJet touch;
  for (int i = 0; i < 200; ++i) {
    ground.fields().contact_at(apex, touch);
    const double step = -touch.overlap_nm / std::min(touch.overlap_grad.z(), -0.1);
    apex.z() += step;
    if (std::abs(step) < 1e-11) break;
  }
  const ZeroLoad rest = zero_load(model_.laws[kParticleSample], det_exp(touch.log_radius));
  apex.z() += rest.overlap_nm / std::min(touch.overlap_grad.z(), -0.1);
  ParticleState state;
  ParticleContactMemory& contact = state.contacts[kParticleSample];
  contact.place.inside = true;
  PotentialSample at;
  for (int i = 0; i < 50; ++i) {
    if (ground.sample(apex, contact.place, contact.hint, at) != BranchEnd::kNone) break;
    const double stiffness = at.hessian_n_m(2, 2);
    if (!(stiffness > 0.0)) break;
    const double step = -at.gradient_nn.z() / stiffness;
    apex.z() += std::clamp(step, -0.1 * rest.contact_radius_nm, 0.1 * rest.contact_radius_nm);
    if (std::abs(step) < 1e-11) break;
  }
  state.particle_centre_w_nm = apex + Vec3(0.0, 0.0, radius);
  contact.law.branch = Branch::kContact;
  contact.law.overlap_nm = at.place.overlap_nm;
  const double steepness = at.place.overlap_grad.norm();
  if (steepness > 0.0) contact.normal_w = -at.place.overlap_grad / steepness;
  contact.contact_radius_nm = std::sqrt(std::max(0.0, at.size.square_nm2));
  state.potential_aj = at.energy_aj;
  return state;
}

ParticleSolution ParticleEquilibrium::advance(const Vec3& free_end, const Compliance& compliance, double dt_s,
                                              ParticleState& state) const noexcept {
  ParticleState now = state;
  ParticleSolution out;
  advance_in_place(free_end, compliance, dt_s, now, out);
  if (out.status == SolveStatus::kOk) state = now;
  return out;
}

// Accepts a sub-step: keeps its balance in `now`, and adds what it lost to `out`. `carried_nm` is how far the free end went.
// A step that placed the tip (`counts` false) has no losses.
void ParticleEquilibrium::take(const ParticleBalance& balance, const Mat3& soft, const Vec3& carried_nm,
                               bool counts, ParticleState& now, ParticleSolution& out) const noexcept {
  const double before = now.potential_aj + spring_energy(now.tip_force_w_nn, soft);
  const Vec3 force_before = now.tip_force_w_nn;
  const double friction = std::max(0.0, balance.friction_loss_aj());
  const double drag = balance.drag_loss_aj();
  const Vec3 lay = now.particle_centre_w_nm;
  const Vec3 lay_turned = now.turned_w_rad;
  const bool asleep = now.sleep.asleep;
  balance.store(now);
  if (!asleep) {
    const double moved = (now.particle_centre_w_nm - lay).norm() +
                         (now.turned_w_rad - lay_turned).norm() * model_.parameters.particle_radius_nm;
    now.sleep.asleep = counts && moved < kStill_nm && rests(balance) && left_alone(balance, kFallsAsleep);
  }
  out.tip.jumps += balance.jumps();
  if (!counts) return;
  const Vec3 force = now.tip_force_w_nn;
  const double after = now.potential_aj + spring_energy(force, soft);
  const double work = -0.5 * (force_before + force).dot(carried_nm);
  const double rest = work - (after - before) - friction - drag;
  // A fall that is not seen as such still exceeds what a trapezium can err by, and the rounding of U.
  const double error = 0.5 * std::abs((force - force_before).dot(carried_nm)) +
                       kEnergyRounding * (std::abs(before) + std::abs(after));
  const bool fell = balance.jumps() > 0 || balance.unstable() || rest > error;
  out.friction_loss_aj += friction;
  out.drag_loss_aj += drag;
  if (fell) out.jump_loss_aj += std::max(0.0, rest);
}

void ParticleEquilibrium::advance_in_place(const Vec3& free_end, const Compliance& compliance, double dt_s,
                                           ParticleState& now, ParticleSolution& out) const noexcept {
  renew(out);
  if (!is_finite(free_end) || !compliance.allFinite() || !std::isfinite(dt_s) || !(dt_s > 0.0)) {
    return refuse(SolveStatus::kNonFinite, out);
  }
  const Mat3 soft = compliance + kLeastCompliance * Mat3::Identity();
  const Mat3 inverse = soft.inverse();
  const Mat3 spring = 0.5 * (inverse + inverse.transpose());
  if (!spring.allFinite() || !(spring.diagonal().minCoeff() > 0.0)) {
    return refuse(SolveStatus::kNonFinite, out);
  }

  const Vec3 target = free_end + Vec3(0.0, 0.0, model_.parameters.tip_radius_nm);
  const bool started = now.started;
  if (!started) {
    now.tip_centre_w_nm = target;  // nobody carried it here: no work, no loss
    now.tip_force_w_nn.setZero();
  }
  FreeEndWay way(now.tip_centre_w_nm - soft * now.tip_force_w_nn, target);
  const Vec3 turned_before = now.turned_w_rad;
  while (!way.is_done()) {
    if (++out.substeps > kMaxSubsteps || out.iterations > kMaxIterationsInAll) {
      return refuse(SolveStatus::kNotConverged, out);
    }
    const FreeEndWay::SubStep next = way.next(model_, now);
    const bool asleep = now.sleep.asleep;
    ParticleBalance balance(model_, now, spring, next.end, std::max(dt_s * next.part, kShortestTime_s),
                            asleep);
    const SolveStatus status = balance.solve();
    out.iterations += balance.iterations();
    if (asleep && (status != SolveStatus::kOk || !left_alone(balance, 1.0))) {
      wake(now);
      continue;
    }
    if (status != SolveStatus::kOk) {
      if (way.refine() < kFinest) return refuse(status, out);
      continue;
    }
    // Two contacts pull at the particle and one gives way: which, must not depend on how far the step
    // overshoots. Come near first.
    if (touching(now) && !touching(balance) && way.refined() > kReleaseRefinement) {
      way.refine();
      continue;
    }
    take(balance, soft, next.end - way.end(), started, now, out);
    way.go(next);
    if (way.is_done()) describe(model_, balance, now, out);
  }
  out.dissipated_aj = out.friction_loss_aj + out.drag_loss_aj + out.jump_loss_aj;
  out.turned_w_rad = now.turned_w_rad - turned_before;
  out.tip.dissipated_aj = out.dissipated_aj;
  out.tip.iterations = out.iterations;
}

}  // namespace telenano::physics
