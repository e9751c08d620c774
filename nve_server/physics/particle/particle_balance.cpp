#include "telenano/nve_server/physics/particle/particle_balance.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/common/base/renew.h"
#include "telenano/nve_server/physics/numerics/numbers.h"

namespace telenano::physics {
namespace {

constexpr int kMaxPasses = 14;
constexpr int kShortPasses = 6;  // those that may end before they are balanced
constexpr double kRenewed =
    0.3;  // of the change in what friction takes from the state: more balance is then of no use
constexpr int kMaxIterations = 400;       // of one minimisation; long ways downhill take hundreds
constexpr double kBalanced = 1e-9;        // of the forces: ten times the laws' own error
constexpr double kStalled = 1e-6;         // as good as rounding lets it be
constexpr double kSettled = 1e-7;         // of the forces, from what friction takes from the state
constexpr double kNearestCentres = 0.05;  // of the radii's sum: which way is out is lost there
constexpr double kSteepestCurve = 30.0;   // in units of a contact's own stiffness

Vec3 unit(const Vec3& v) noexcept {
  const double length = v.norm();
  return length > 0.0 ? Vec3(v / length) : Vec3::UnitZ();
}

}  // namespace

ParticleBalance::ParticleBalance(const ParticleModel& model, const ParticleState& from, const Mat3& spring,
                                 const Vec3& free_end, double dt_s, bool asleep) noexcept
    : model_(model),
      from_(from),
      spring_(spring),
      free_end_(free_end),
      start_u_(from.tip_centre_w_nm - free_end),
      drag_n_m_(model.parameters.drag_n_s_m / dt_s),
      law_(from.contacts[kTipParticle].law),
      asleep_(asleep) {
  best_->y.head<3>() = start_u_;
  for (int i = 0; i < kParticleContacts; ++i) {
    held_[i].place = from.contacts[i].place;
    held_[i].hint = from.contacts[i].hint;
  }
  if (!asleep) return;
  const ParticleSleep& rest = from.sleep;
  for (Trial* trial : {best_, trial_}) {
    ContactTrial& contact = trial->contacts[kParticleSample];
    contact.law = rest.law;
    contact.normal_w = rest.normal_w;
    contact.push_w_nn = rest.push_w_nn;
    contact.radius_nm = rest.radius_nm;
    contact.slide.force = rest.slide_force_w_nn;
    contact.roll.force = rest.roll_torque_w_nn_nm;
    contact.spin.force = rest.spin_torque_w_nn_nm;
  }
  held_[kParticleSample].radius_nm = rest.radius_nm;
}

// Tip or particle on the ground, on the branch that is there. False: no number.
bool ParticleBalance::lean(int i, const Vec3& centre, ContactTrial& contact) noexcept {
  if (contact.known && contact.centre_w_nm == centre) return true;
  const ParticleParameters& p = model_.parameters;
  const TipPotential& ground = *model_.ground[i];
  Held& held = held_[i];
  const Vec3 apex = centre - Vec3(0.0, 0.0, i == kTipSample ? p.tip_radius_nm : p.particle_radius_nm);
  contact.known = false;
  contact.place = held.place;
  int jumps = 0;
  PotentialSample at;
  for (int ends = 0;; ++ends) {
    const BranchEnd end = ground.sample(apex, contact.place, held.hint, at);
    if (end == BranchEnd::kNone) break;
    if (end == BranchEnd::kNoNumber || ends == TipPotential::kMostEnds) return false;
    jumps += end == BranchEnd::kBridge || !at.reversible ? 1 : 0;
    const PotentialBranch next = ground.beyond(end, apex, contact.place, at);
    if (next.bridge.present != contact.place.bridge.present) held.hint = {};  // another medium, another curve
    contact.place = next;
  }
  const double steepness = at.place.overlap_grad.norm();
  contact.normal_w = steepness > 0.0 ? Vec3(-at.place.overlap_grad / steepness) : Vec3(Vec3::UnitZ());
  contact.push_w_nn = -at.gradient_nn;
  contact.hessian_n_m = at.hessian_n_m;
  const ParticleModel::LevelGround& level = model_.level[i];
  contact.radius_nm =
      at.place.log_radius == level.log_radius ? level.radius_nm : det_exp(at.place.log_radius);
  const bool attracts = ground.potential().law().parameters().van_der_waals;
  const Branch outer = attracts ? Branch::kVanDerWaals : Branch::kFree;
  Equilibrium& law = contact.law;
  renew(law);
  law.branch = !contact.place.inside      ? outer
               : at.size.square_nm2 > 0.0 ? Branch::kContact
                                          : Branch::kNonContact;
  law.overlap_nm = at.place.overlap_nm;
  law.force_nn = at.law.force_nn * steepness + at.other_load_nn;
  law.stiffness_n_m = at.law.stiffness_n_m * steepness * steepness + at.other_stiffness_n_m;
  law.contact_radius_nm = std::sqrt(std::max(0.0, at.size.square_nm2));
  law.potential_aj = at.energy_aj;
  law.jumps = jumps;
  law.bridge = contact.place.bridge.present;
  contact.known = true;
  contact.centre_w_nm = centre;
  return true;
}

// Tip and particle, on the branch that is held. False: no number.
bool ParticleBalance::touch(const Vec3& apart, ContactTrial& contact) noexcept {
  if (contact.known && contact.centre_w_nm == apart) return true;
  contact.known = false;
  const ParticleParameters& p = model_.parameters;
  const Held& held = held_[kTipParticle];
  const double distance = apart.norm();
  if (!(distance > kNearestCentres * (p.tip_radius_nm + p.particle_radius_nm))) return false;
  contact.normal_w = apart / distance;
  contact.distance_nm = distance;
  contact.radius_nm = model_.nominal_radius_nm[kTipParticle];
  law_.branch = held.branch;  // the cache alone goes on from trial to trial
  const double overlap = p.tip_radius_nm + p.particle_radius_nm - distance;
  contact.law = model_.laws[kTipParticle].advance(overlap, 0.0, held.radius_nm, law_);
  if (contact.law.status != SolveStatus::kOk) return false;
  contact.push_w_nn = contact.law.force_nn * contact.normal_w;
  contact.known = true;
  contact.centre_w_nm = apart;
  return true;
}

void ParticleBalance::evaluate(const Vec9& y, Trial& trial) noexcept {
  const ParticleParameters& p = model_.parameters;
  const double lever = p.particle_radius_nm;
  const Vec3 u = y.head<3>(), dq = y.segment<3>(3), turn = y.tail<3>();
  const Vec3 dp = u - start_u_;
  const Vec3 tip = free_end_ + u, particle = from_.particle_centre_w_nm + dq;
  trial.y = y;
  trial.valid = false;

  const Vec3 pull = spring_ * u;
  const double drag_aj = 0.5 * drag_n_m_ * (dq.squaredNorm() + lever * lever * turn.squaredNorm());
  const double spring_aj = 0.5 * u.dot(pull);
  double potential = spring_aj + drag_aj;
  double magnitude = spring_aj + drag_aj;
  trial.gradient.head<3>() = pull;
  trial.gradient.segment<3>(3) = drag_n_m_ * dq;
  trial.gradient.tail<3>() = drag_n_m_ * lever * lever * turn;
  trial.load_nn = floor_nn_;
  trial.stiffest_n_m = 0;

  for (int i = 0; i < kParticleContacts; ++i) {
    if (asleep_ && i == kParticleSample) continue;
    ContactTrial& contact = trial.contacts[i];
    Held& held = held_[i];
    if (i == kTipParticle) {
      if (!touch(particle - tip, contact)) return;
    } else if (!lean(i, i == kTipSample ? tip : particle, contact)) {
      return;
    }

    const Pair pair = kPairs[i];
    const Vec3 d = pair.tip * dp + pair.particle * dq;
    const Vec3& n = held.normal_w;
    const bool turns = pair.particle != 0.0;
    if (held.slide.acts()) {
      Vec3 slip = d - n * n.dot(d);
      if (turns) slip += lever * n.cross(turn);
      respond(held.slide, held.slide_nm + slip, contact.slide);
    } else {
      renew(contact.slide);
    }
    const Vec3 spin = turns ? Vec3(n * n.dot(turn)) : Vec3(Vec3::Zero());
    if (turns && held.roll.acts()) {
      respond(held.roll, held.roll_rad + turn - spin, contact.roll);
    } else {
      renew(contact.roll);
    }
    if (turns && held.spin.acts()) {
      respond(held.spin, held.spin_rad + spin, contact.spin);
    } else {
      renew(contact.spin);
    }

    potential +=
        contact.law.potential_aj + contact.slide.envelope + contact.roll.envelope + contact.spin.envelope;
    magnitude += std::abs(contact.law.potential_aj) + contact.slide.envelope + contact.roll.envelope +
                 contact.spin.envelope;
    const Vec3 force = contact.slide.force - contact.push_w_nn;
    trial.gradient.head<3>() += pair.tip * force;
    if (!asleep_) trial.gradient.segment<3>(3) += pair.particle * force;
    if (turns && !asleep_) {
      trial.gradient.tail<3>() +=
          contact.roll.force + contact.spin.force - lever * n.cross(contact.slide.force);
    }
    trial.load_nn += (on_ground(i) ? contact.push_w_nn.norm() : std::abs(contact.law.force_nn)) +
                     contact.slide.size + (contact.roll.size + contact.spin.size) / lever;
    trial.stiffest_n_m += std::abs(contact.law.stiffness_n_m) + held.slide.stiffness;
  }
  trial.potential_aj = potential;
  trial.magnitude_aj = magnitude;
  trial.valid = std::isfinite(potential) && std::isfinite(trial.gradient.squaredNorm());
}

double ParticleBalance::size(const Vec9& gradient) const noexcept {
  return std::max({gradient.head<3>().norm(), gradient.segment<3>(3).norm(),
                   gradient.tail<3>().norm() / model_.parameters.particle_radius_nm});
}

double ParticleBalance::tolerance_nn(const Trial& trial) const noexcept {
  // One ulp of the places turns into this much force.
  const double places = free_end_.cwiseAbs().maxCoeff() + from_.particle_centre_w_nm.cwiseAbs().maxCoeff();
  return kBalanced * trial.load_nn + 4.0 * kEpsilon * places * trial.stiffest_n_m;
}

// No contact has begun or ended, and no bridge.
bool ParticleBalance::on_held_branches() const noexcept {
  for (int i = 0; i < kParticleContacts; ++i) {
    if (asleep_ && i == kParticleSample) continue;
    const ContactTrial& now = best_->contacts[i];
    const Held& held = held_[i];
    if (is_on_curve(now.law.branch) != is_on_curve(held.branch)) return false;
    if (on_ground(i) && now.place.bridge.present != held.place.bridge.present) return false;
    if (!held.lost && now.law.contact_radius_nm == 0.0) return false;
  }
  return true;
}

bool ParticleBalance::go_over() noexcept {
  bool over = false;
  for (int i = 0; i < kParticleContacts; ++i) {
    const Equilibrium& law = best_->contacts[i].law;
    const PotentialBranch& place = best_->contacts[i].place;
    const bool same_bridge = !on_ground(i) || place.bridge.present == held_[i].place.bridge.present;
    if (is_on_curve(law.branch) == is_on_curve(held_[i].branch) && same_bridge) continue;
    held_[i].branch = law.branch;
    held_[i].place = place;
    jumps_ += law.jumps;
    for (Trial& trial : trials_) trial.contacts[i].known = false;
    over = true;
  }
  if (over) evaluate(Vec9(best_->y), *best_);
  return over;
}

SolveStatus ParticleBalance::minimise(bool to_the_end) noexcept {
  evaluate(Vec9(best_->y), *best_);
  if (!best_->valid) return SolveStatus::kNonFinite;
  for (int i = 0; i < kMaxIterations; ++i) {
    const double tolerance = tolerance_nn(*best_);
    const double off = size(best_->gradient);
    if (off <= tolerance) return SolveStatus::kOk;
    if (i > 0 && !to_the_end && off <= kRenewed * unsettled_nn() && on_held_branches())
      return SolveStatus::kOk;
    ++iterations_;
    Vec9 step;
    bool done = false;
    if (find_step(false, step)) {
      done = descend(step, tolerance);
    } else {
      unstable_ = true;
    }
    if (!done) done = find_step(true, step) && descend(step, tolerance);
    // Held up by the step of a potential whose branch was left on the way and which has no way back?
    if (!done && !go_over()) {
      return size(best_->gradient) <= kStalled * best_->load_nn ? SolveStatus::kOk
                                                                : SolveStatus::kNotConverged;
    }
  }
  return SolveStatus::kNotConverged;
}

// What passes hold approaches its end as a geometric series, mostly of one ratio; this is how far beyond what was found the
// next pass looks. Source  D. G. Anderson, J. ACM 12 (1965) 547, with one former step.
double ParticleBalance::extrapolation(int pass) const noexcept {
  if (pass < 2) return 0.0;
  double along = 0, square = 0;
  for (int i = 0; i < kParticleContacts; ++i) {
    const Held& held = held_[i];
    if (held.lost || (asleep_ && i == kParticleSample)) continue;
    const ContactTrial& now = best_->contacts[i];
    const Vec3 gap = unit(now.normal_w) - held.normal_w;
    const double radius_gap = (now.law.contact_radius_nm - held.contact_radius_nm) / held.contact_radius_nm;
    const Vec3 change = gap - held.normal_gap;
    const double radius_change = radius_gap - held.radius_gap_nm / held.contact_radius_nm;
    along += gap.dot(change) + radius_gap * radius_change;
    square += change.squaredNorm() + radius_change * radius_change;
  }
  const double share = along / square;
  return std::abs(share) < 0.5 ? share : 0.0;  // also false if it is no number
}

void ParticleBalance::hold(int pass) noexcept {
  const bool first = pass == 0;
  const double share = extrapolation(pass);
  if (first) floor_nn_ = 0;
  for (int i = 0; i < kParticleContacts; ++i) {
    if (asleep_ && i == kParticleSample) continue;
    const ParticleContactMemory& memory = from_.contacts[i];
    Held& held = held_[i];
    const ContactTrial& now = best_->contacts[i];
    if (first) held.branch = memory.law.branch;
    if (held.radius_nm != now.radius_nm) {
      held.radius_nm = now.radius_nm;
      const ParticleModel::LevelGround& level = model_.level[i];
      held.at = held.radius_nm == level.radius_nm ? level.at : model_.at_radius(i, held.radius_nm);
    }
    const Vec3 normal = unit(now.normal_w);
    const double radius = first ? memory.contact_radius_nm : now.law.contact_radius_nm;
    held.normal_gap = normal - held.normal_w;
    held.radius_gap_nm = radius - held.contact_radius_nm;
    held.normal_w = unit(normal - share * (normal - held.normal_found_w));
    held.contact_radius_nm =
        radius > 0.0 ? std::max(0.5 * radius, radius - share * (radius - held.radius_found_nm)) : radius;
    held.normal_found_w = normal;
    held.radius_found_nm = radius;
    const ContactScales& scales = held.at.scales;
    held.stiffest_n_m = kSteepestCurve * scales.force_nn / scales.overlap_nm;
    if (first && i != kTipSample) floor_nn_ += scales.force_nn;
    held.lost = held.lost || memory.contact_radius_nm == 0.0 || held.contact_radius_nm == 0.0;
    held.slide = held.roll = held.spin = {};
    if (held.lost) continue;

    const ContactFriction& friction = model_.friction[i];
    const double a = held.contact_radius_nm;
    held.slide = {8.0 * friction.shear_modulus_gpa * a, friction.shear_strength_gpa * kPi * a * a};
    held.slide_nm = transported(carried_over(memory.slide_nm, memory.slide_stiffness, held.slide.stiffness),
                                memory.normal_w, held.normal_w);
    if (i == kTipSample) continue;
    held.spin = {16.0 / 3.0 * friction.shear_modulus_gpa * a * a * a,
                 2.0 / 3.0 * friction.shear_strength_gpa * kPi * a * a * a};
    const double spread = a / held.at.zero_load_radius_nm;
    const double rolling_nn = 4.0 * model_.pull_off_nn[i] * held.at.relative * spread * std::sqrt(spread);
    held.roll = {rolling_nn * held.radius_nm, rolling_nn * friction.rolling_length_nm};
    held.roll_rad = transported(carried_over(memory.roll_rad, memory.roll_stiffness, held.roll.stiffness),
                                memory.normal_w, held.normal_w);
    held.spin_rad = transported(carried_over(memory.spin_rad, memory.spin_stiffness, held.spin.stiffness),
                                memory.normal_w, held.normal_w);
  }
}

// Force by which friction is another one than what was held: infinite if a contact that holds friction has ended.
double ParticleBalance::unsettled_nn() const noexcept {
  const double lever = model_.parameters.particle_radius_nm;
  double most = 0;
  for (int i = 0; i < kParticleContacts; ++i) {
    if (asleep_ && i == kParticleSample) continue;
    const ContactTrial& now = best_->contacts[i];
    const Held& held = held_[i];
    const double friction = now.slide.size + (now.roll.size + now.spin.size) / lever;
    // On the ground it is no more than rolling friction that takes the radius as it was held.
    const double by_radius = on_ground(i) ? now.roll.size / lever : std::abs(now.law.force_nn);
    most = std::max(most, std::abs(now.radius_nm / held.radius_nm - 1.0) * by_radius);
    if (held.lost || friction == 0.0) continue;
    const double a = now.law.contact_radius_nm;
    if (a == 0.0) return std::numeric_limits<double>::infinity();
    most = std::max(most, (unit(now.normal_w) - held.normal_w).norm() * friction);
    most = std::max(most, std::abs(held.contact_radius_nm / a - 1.0) * friction);
  }
  return most;
}

SolveStatus ParticleBalance::solve() noexcept {
  if (!lean(kTipSample, from_.tip_centre_w_nm, best_->contacts[kTipSample])) return SolveStatus::kNonFinite;
  if (!asleep_ && !lean(kParticleSample, from_.particle_centre_w_nm, best_->contacts[kParticleSample]))
    return SolveStatus::kNonFinite;
  best_->contacts[kTipParticle].normal_w = unit(from_.particle_centre_w_nm - from_.tip_centre_w_nm);
  best_->contacts[kTipParticle].radius_nm = model_.nominal_radius_nm[kTipParticle];
  for (int pass = 0; pass < kMaxPasses; ++pass) {
    hold(pass);
    const SolveStatus status = minimise(pass >= kShortPasses);
    if (status != SolveStatus::kOk) return status;
    if (unsettled_nn() <= kSettled * best_->load_nn) return SolveStatus::kOk;
  }
  // Swinging on a rough surface: balanced with what was held, unless a contact that holds friction has ended.
  for (int i = 0; i < kParticleContacts; ++i) {
    if (!held_[i].lost && best_->contacts[i].law.contact_radius_nm == 0.0) return SolveStatus::kNotConverged;
  }
  return SolveStatus::kOk;
}

double ParticleBalance::drag_loss_aj() const noexcept {
  const double lever = model_.parameters.particle_radius_nm;
  return drag_n_m_ *
         (best_->y.segment<3>(3).squaredNorm() + lever * lever * best_->y.tail<3>().squaredNorm());
}

double ParticleBalance::friction_loss_aj() const noexcept {
  const auto carried = [](double k_before, const Vec3& before, double k, const Vec3& after) {
    return 0.5 * (k_before * before.squaredNorm() - k * after.squaredNorm());
  };
  double loss = 0.0;
  for (int i = 0; i < kParticleContacts; ++i) {
    if (asleep_ && i == kParticleSample) continue;
    const ParticleContactMemory& memory = from_.contacts[i];
    const ContactTrial& now = best_->contacts[i];
    const Held& held = held_[i];
    loss += now.slide.dissipated + now.roll.dissipated + now.spin.dissipated;
    loss += carried(memory.slide_stiffness, memory.slide_nm, held.slide.stiffness, held.slide_nm);
    loss += carried(memory.roll_stiffness, memory.roll_rad, held.roll.stiffness, held.roll_rad);
    loss += carried(memory.spin_stiffness, memory.spin_rad, held.spin.stiffness, held.spin_rad);
  }
  return loss;
}

int ParticleBalance::jumps() const noexcept {
  int jumps = jumps_;
  for (int i = 0; i < kParticleContacts; ++i)
    if (!(asleep_ && i == kParticleSample)) jumps += best_->contacts[i].law.jumps;
  return jumps;
}

void ParticleBalance::store(ParticleState& state) const noexcept {
  const Vec3 u = best_->y.head<3>(), dq = best_->y.segment<3>(3), turn = best_->y.tail<3>();
  double potential = 0.0;
  for (int i = 0; i < kParticleContacts; ++i) {
    if (asleep_ && i == kParticleSample) {
      potential += from_.sleep.potential_aj;
      continue;
    }
    ParticleContactMemory& memory = state.contacts[i];
    const ContactTrial& now = best_->contacts[i];
    const Held& held = held_[i];
    if (!on_ground(i)) memory.law = law_;
    memory.law.branch = now.law.branch;
    memory.law.overlap_nm = now.law.overlap_nm;
    if (on_ground(i)) {
      memory.place = now.place;
      memory.hint = held.hint;
    }
    memory.contact_radius_nm = now.law.contact_radius_nm;
    memory.normal_w = held.normal_w;
    memory.slide_nm = now.slide.deflection;
    memory.roll_rad = now.roll.deflection;
    memory.spin_rad = now.spin.deflection;
    memory.slide_stiffness = held.slide.stiffness;
    memory.roll_stiffness = held.roll.stiffness;
    memory.spin_stiffness = held.spin.stiffness;
    potential += now.law.potential_aj + now.slide.stored + now.roll.stored + now.spin.stored;
  }
  state.started = true;
  state.tip_centre_w_nm = free_end_ + u;
  state.tip_force_w_nn = spring_ * u;
  state.potential_aj = potential;
  if (asleep_) return;
  const ContactTrial& rest = best_->contacts[kParticleSample];
  state.sleep = {false,
                 rest.law,
                 rest.normal_w,
                 held_[kParticleSample].radius_nm,
                 rest.push_w_nn,
                 rest.slide.force,
                 rest.roll.force,
                 rest.spin.force,
                 rest.law.potential_aj + rest.slide.stored + rest.roll.stored + rest.spin.stored};
  state.particle_centre_w_nm += dq;
  state.turned_w_rad += turn;
  const Eigen::Quaterniond half(1.0, 0.5 * turn.x(), 0.5 * turn.y(), 0.5 * turn.z());
  state.orientation_w = (half * state.orientation_w).normalized();
}

}  // namespace telenano::physics
