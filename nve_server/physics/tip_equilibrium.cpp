#include "nve_server/physics/tip_equilibrium.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "nve_server/physics/feet_in_use.h"

namespace telenano::physics {
namespace {

constexpr int kMaxIterations = 80;
constexpr double kStepDone =
    2e-8;  // nm: the law's own error, 1e-9 of some 100 nN, through the softest spring
constexpr double kSwingLeast = 1e-5;  // nm: shorter swings are rounding
constexpr double kRadiusDone = 1e-6;  // of the force, which follows the radius
constexpr int kRadiusUpdates = 6;
constexpr double kDeeper = 1e-9;  // nm by which another foot must be deeper to be taken in
constexpr double kTurnMax = 0.9;  // of F C N; at 1 the tip slides off sideways
constexpr double kLongestStepRadii = 0.5;

void describe(const Equilibrium& eq, TipSolution& solution) noexcept {
  solution.status = eq.status;
  solution.branch = eq.branch;
  solution.normal_force_nn = eq.force_nn;
  solution.overlap_nm = eq.overlap_nm;
  solution.contact_radius_nm = eq.contact_radius_nm;
  solution.stiffness_n_m = eq.stiffness_n_m;
  solution.potential_aj = eq.potential_aj;
  solution.dissipated_aj = eq.dissipated_aj;
  solution.jumps = eq.jumps;
}

void remember(const TipSolution& solution, const Vec3& free_end_w_nm, TipState& state) noexcept {
  state.started = true;
  state.free_end_w_nm = free_end_w_nm;
  state.radius_nm = solution.radius_nm;
  state.apex_w_nm = solution.apex_w_nm;
  state.normal_w = solution.normal_w;
  state.force_nn = solution.normal_force_nn;
  state.stiffness_n_m = solution.stiffness_n_m;
}

// The radius that the law is given, drawn to that of the foot. On a rough surface the foot wanders far for a
// small motion of the tip, most of all in a pit nearly as narrow as the tip, and the radius with it: giving
// the law each new foot's radius can swing for ever. So the radius goes half of the way when it turns round,
// and after kRadiusUpdates it stays; the next step goes on from there.
class RadiusIteration {
 public:
  explicit RadiusIteration(double from_nm) noexcept : given_(from_nm) {}
  double next(double found_nm, double force_nn) noexcept {
    if (given_ <= 0.0) {
      given_ = found_nm;
    } else if (!settled(found_nm, force_nn)) {
      const double change = found_nm - given_;
      if (change * last_change_ < 0.0) weight_ *= 0.5;
      given_ += weight_ * change;
      last_change_ = change;
    }
    ++count_;
    return given_;
  }
  bool settled(double found_nm, double force_nn) const noexcept {
    return count_ >= kRadiusUpdates || std::abs(found_nm - given_) * std::abs(force_nn) <
                                           kRadiusDone * given_ * (1.0 + std::abs(force_nn));
  }

 private:
  int count_ = 0;
  double given_;
  double weight_ = 1.0;
  double last_change_ = 0.0;
};

// Newton's method between two places that send it to each other: in a pit nearly as narrow as the tip the
// foot swings from one side to the other within a fraction of a nanometre, and with it the normal, and from
// neither side does Newton see the steep stretch between. So when a step turns back on the one before, the
// place between is sought (by halving) where it does not, and Newton goes on from there, with that place's
// own, steep, slope.
class Swing {
 public:
  // Takes the step found at p; changes it to where to go instead. True while a swing is being searched.
  bool guard(const Vec3& p, Vec3& step) noexcept {
    if (searching_) {
      const double along = step.dot(direction_);
      if (std::abs(along) < kTurnedBack * direction_.squaredNorm() || ++halvings_ == kHalvings) {
        searching_ = false;
      } else {
        (along > 0.0 ? low_ : high_) = at_;
        at_ = 0.5 * (low_ + high_);
        step = origin_ + at_ * direction_ - p;
        return true;
      }
    } else if (armed_ && step.norm() > kSwingLeast &&
               step.dot(direction_) < -kTurnedBack * direction_.squaredNorm()) {
      searching_ = true;
      halvings_ = 0;
      low_ = 0.0;
      high_ = 1.0;
      at_ = 0.5;
      step = origin_ + at_ * direction_ - p;
      return true;
    }
    armed_ = true;
    origin_ = p;
    direction_ = step;
    return false;
  }
  void forget() noexcept { armed_ = searching_ = false; }

 private:
  static constexpr double kTurnedBack = 0.3;
  static constexpr int kHalvings = 12;
  bool armed_ = false;
  bool searching_ = false;
  int halvings_ = 0;
  double low_ = 0, high_ = 1, at_ = 0;
  Vec3 origin_ = Vec3::Zero();
  Vec3 direction_ = Vec3::Zero();
};

// Where the apex goes if the surface is a plane and the law a line.
Vec3 predict(const Vec3& free_end, const Compliance& c, const TipState& state) noexcept {
  if (!state.started) return free_end;
  const Vec3 moved = free_end - state.free_end_w_nm;
  const Vec3 give = c * state.normal_w;
  const double springs = state.normal_w.dot(give);
  const double along = 1.0 + springs * state.stiffness_n_m;
  if (!(along > 0.1)) return state.apex_w_nm + moved;
  return state.apex_w_nm + moved - give * (state.normal_w.dot(moved) * state.stiffness_n_m / along);
}

}  // namespace

TipEquilibrium::TipEquilibrium(std::shared_ptr<const Surface> surface, const TipSampleLaw& law,
                               double tip_radius_nm)
    : surface_(std::move(surface)), law_(law), tip_radius_nm_(tip_radius_nm) {}

TipSolution TipEquilibrium::advance_flat(const Vec3& free_end, const Compliance& c,
                                         TipState& state) const noexcept {
  TipSolution solution;
  TipSampleState law_state = state.law;
  describe(law_.advance(-free_end.z(), c(2, 2), tip_radius_nm_, law_state), solution);
  if (solution.status != SolveStatus::kOk) return solution;
  solution.radius_nm = tip_radius_nm_;
  solution.force_w_nn = Vec3(0.0, 0.0, solution.normal_force_nn);
  solution.apex_w_nm = free_end + c.col(2) * solution.normal_force_nn;
  solution.iterations = 1;
  state.law = law_state;
  remember(solution, free_end, state);
  return solution;
}

TipSolution TipEquilibrium::advance(const Vec3& free_end, const Compliance& c,
                                    TipState& state) const noexcept {
  if (!is_finite(free_end)) {
    TipSolution none;
    none.status = SolveStatus::kNonFinite;
    return none;
  }
  if (surface_->is_flat()) return advance_flat(free_end, c, state);
  TipSolution solution = advance_curved(free_end, c, state);
  if (solution.status == SolveStatus::kNotConverged && state.foot_count != 0) {
    // The remembered feet may be what leads astray: once more from the nearest one.
    TipState afresh = state;
    afresh.foot_count = 0;
    const int spent = solution.iterations;
    solution = advance_curved(free_end, c, afresh);
    solution.iterations += spent;
    if (solution.status == SolveStatus::kOk) state = afresh;
  }
  return solution;
}

TipSolution TipEquilibrium::advance_curved(const Vec3& free_end, const Compliance& c,
                                           TipState& state) const noexcept {
  TipSolution solution;
  const Vec3 to_centre(0.0, 0.0, tip_radius_nm_);
  const double c_max = c.cwiseAbs().rowwise().sum().maxCoeff();  // bounds the largest eigenvalue
  Vec3 p = predict(free_end, c, state);
  FeetInUse feet;
  if (state.foot_count == 0) {
    FootMemory memory;
    const SurfaceContact contact = surface_->nearest(p + to_centre, Search::kGlobal, memory);
    feet.add(memory, contact, 1.0);
  } else {
    for (int i = 0; i < state.foot_count; ++i) {
      FootMemory memory = state.feet[i].memory;
      const SurfaceContact contact = surface_->nearest(p + to_centre, Search::kLocal, memory);
      feet.add(memory, contact, state.feet[i].share);
    }
  }
  double force = state.force_nn;
  RadiusIteration radius(state.radius_nm);
  Swing swing;
  FeetInUse left_behind = feet;  // the feet one position ago
  int feet_before = 0;

  for (int iteration = 1; iteration <= kMaxIterations; ++iteration) {
    feet.measure(tip_radius_nm_);
    if (!(force > 0.0)) feet.keep_deepest();

    // A = (1 − F C N)⁻¹ and S = A C, see the header.
    const double turn = c_max * feet.turning(force);
    Mat3 a = Mat3::Identity();
    if (force * c_max != 0.0) {
      const double kept = turn > kTurnMax ? kTurnMax / turn : 1.0;
      a = (Mat3::Identity() - (kept * force) * c * feet.normal_turn()).inverse();
    }
    const Mat3 s = a * c;
    const Vec3 unloaded = a * (free_end - p);
    const FeetInUse::Reduced reduced = feet.reduce(s, unloaded);

    if (feet.count() != feet_before) swing.forget();
    feet_before = feet.count();
    const double radius_nm = radius.next(feet.radius_nm(), force);
    TipSampleState law_state = state.law;
    const Equilibrium eq = law_.advance(reduced.base_overlap_nm, reduced.compliance, radius_nm, law_state);
    if (eq.status != SolveStatus::kOk) {
      solution.status = eq.status;
      return solution;
    }
    force = eq.force_nn;
    if (feet.share(reduced, force)) continue;  // a foot was dropped: the others alone

    const Vec3 normal = feet.normal();
    Vec3 step = unloaded + s * normal * force;
    const double length = step.norm();
    if (!std::isfinite(length)) {
      solution.status = SolveStatus::kNonFinite;
      return solution;
    }
    if (turn >= 1.0) solution.slid = true;

    if (length < kStepDone && radius.settled(feet.radius_nm(), force)) {
      // Balanced on these feet; is there a deeper one?
      FootMemory memory = feet.memory(0);
      const SurfaceContact nearest = surface_->nearest(p + to_centre, Search::kGlobal, memory);
      if (tip_radius_nm_ - nearest.distance_nm > feet.overlap_nm() + kDeeper) {
        if (!(force > 0.0)) feet.clear();
        if (!feet.add(memory, nearest, 0.0)) feet.replace_least(memory, nearest);
        feet_before = 0;
        continue;
      }
      describe(eq, solution);
      solution.normal_w = normal;
      solution.force_w_nn = force * normal;
      solution.apex_w_nm = free_end + c * solution.force_w_nn;
      solution.radius_nm = radius_nm;
      solution.radius_clamped = feet.radius_clamped();
      solution.outside = feet.outside();
      solution.feet = feet.count();
      solution.iterations = iteration;
      state.law = law_state;
      feet.store(state);
      remember(solution, free_end, state);
      return solution;
    }
    const double longest = kLongestStepRadii * tip_radius_nm_;
    if (length > longest) step *= longest / length;
    const bool swings = swing.guard(p, step);
    if (swings) {
      // Two feet by turns are two feet at once, if the one left behind is still one from here.
      bool taken = false;
      for (int i = 0; i < left_behind.count() && force > 0.0; ++i) {
        FootMemory memory = left_behind.memory(i);
        const SurfaceContact contact = surface_->nearest(p + to_centre, Search::kLocal, memory);
        taken = feet.add_if_new(memory, contact) || taken;
      }
      if (taken) continue;
    } else {
      left_behind = feet;
    }
    p += step;
    for (int i = 0; i < feet.count(); ++i) {
      feet.update(i, surface_->nearest(p + to_centre, Search::kLocal, feet.memory(i)));
    }
  }
  solution.status = SolveStatus::kNotConverged;
  solution.iterations = kMaxIterations;
  return solution;
}

double TipEquilibrium::touch_height_nm(double x_nm, double y_nm) const noexcept {
  // Going down by the distance that is certainly free never passes the surface; near it each step takes the
  // gap times (1 − n_z) of the last, so that even a 60° flank needs some 40 steps.
  FootMemory foot;
  double centre_z = surface_->highest_nm() + 2.0 * tip_radius_nm_;
  for (int i = 0; i < 1000; ++i) {
    const SurfaceContact contact = surface_->nearest(Vec3(x_nm, y_nm, centre_z), Search::kGlobal, foot);
    const double gap = contact.distance_nm - tip_radius_nm_;
    centre_z -= gap;
    if (std::abs(gap) < 1e-10) break;
  }
  return centre_z - tip_radius_nm_;
}

}  // namespace telenano::physics
