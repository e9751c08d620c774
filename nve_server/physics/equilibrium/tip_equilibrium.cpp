#include "telenano/nve_server/physics/equilibrium/tip_equilibrium.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/equilibrium/balance_guards.h"
#include "telenano/nve_server/physics/equilibrium/feet_in_use.h"

namespace telenano::physics {
namespace {

constexpr int kMostFollowed = 20;
constexpr int kMostJumped = 12;
constexpr int kJumpCost = 3;  // iterations' time that a jump of the law takes
constexpr int kMostLate = 20;
constexpr int kMostIterations = 54;      // of one step, all attempts together
constexpr double kStepDone = 1e-9;       // nm
constexpr double kForceDone = 1e-11;     // of the law's forces; counts through a soft spring
constexpr double kForeseen = 1e-7;       // nm: of a step that need not be seen to be the last
constexpr double kForeseenWhole = 5e-7;  // the same where Newton's method leaves nothing out: it then
                                         // squares, times 10/nm or so, what it leaves
constexpr double kNoise = 20.0;          // times these, once steps shrink no more: the law's own error
constexpr double kDeeper = 1e-9;         // nm by which another foot must be deeper to be taken in
constexpr double kForceAtLast = 1e-7;    // of the law's forces, where stick and slip do
constexpr double kDeeperAtLast = 2e-5;   // where two feet take turns for ever
constexpr int kPatient = 16;
constexpr double kTurnMax = 0.9;          // of F C N; at 1 the tip slides off sideways
constexpr double kTurnTrusted = 0.5;      // beyond, the last step's answer does not predict the next
constexpr double kLongerMove = 2.0;       // than the last one, to be foreseen from it
constexpr double kTurnedMove = 0.2;       // of the last one
constexpr double kMostForceChange = 0.5;  // in a step that is foreseen
constexpr double kMostBent = 0.2;         // of the move; more is no parabola
constexpr double kLongestStepRadii = 0.5;
constexpr double kLateralShare = 0.75;  // of the normal compliance that the lateral force may take away
constexpr double kTiltMost = 0.5;       // of what a change of radius is worth in overlap
constexpr double kTiltLongest = 0.5;    // of the normal
constexpr double kSoftestContact =
    0.05;  // of a Hertzian one: near the fold a goes with F as steeply as it likes
constexpr double kMostRadiusRate = 4.0;
constexpr double kFrictionDrift = 0.5;  // of the step, that friction may change by over a changing radius
constexpr int kNewtonAlone = 3;         // iterations before what Newton leaves out is looked for

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
  state.overlap_nm = solution.overlap_nm;
  state.stiffness_n_m = solution.stiffness_n_m;
  state.contact_radius_nm = solution.contact_radius_nm;
  state.stored_aj = solution.potential_aj + solution.friction_stored_aj;
  state.under_way = state.stuck = false;
}

// d value/dF from two places; `before` if they are too near for it.
double secant(double force, double force_0, double value, double value_0, double before) noexcept {
  const double change = force - force_0;
  if (!(std::abs(change) > 1e-6 * (std::abs(force) + std::abs(force_0)))) return before;
  return (value - value_0) / change;
}

// How the contact radius a goes with force and effective radius, as Newton's method of friction needs it:
//   ∂a/∂F = R (3 − ρ)/(6 K a² ρ),   ρ = F_δ/(3/2 K a),   exact for Hertz and DMT (ρ = 1: R/(3 K a²)) and,
//   since there dF/da = 3 K a²/R (1 − x) and ρ = (1 − x)/(1 − x/3), x = (a_c/a)^{3/2}, for JKR; ∂a/∂R =
//   a/(3R) (2 − F R/(K a³)),                   exact for Hertz and DMT, and for JKR at F = 0 and F → ∞.
ContactRadiusRates contact_radius_rates(const Equilibrium& eq, const RadiusRates& exact, double radius,
                                        double modulus) noexcept {
  if (exact.known) return {exact.contact_radius_per_force_nm_nn, exact.contact_radius_per_radius};
  const double a = eq.contact_radius_nm;
  if (!(a > 0.0 && radius > 0.0)) return {};
  const double rho = std::clamp(eq.stiffness_n_m / (1.5 * modulus * a), kSoftestContact, 1.0);
  const double full_load = modulus * a * a * a / radius;
  return {(3.0 - rho) * radius / (6.0 * modulus * a * a * rho),
          a / (3.0 * radius) * std::clamp(2.0 - eq.force_nn / full_load, 0.0, kMostRadiusRate)};
}

// η: the overlap that does to the force what one unit of radius does (tip_equilibrium.h).
double radius_as_overlap(const Equilibrium& eq, const RadiusRates& exact, double radius) noexcept {
  if (eq.branch == Branch::kFree || !(radius > 0.0)) return 0.0;
  const bool inside = eq.branch == Branch::kContact || eq.branch == Branch::kNonContact;
  const double by_radius = exact.known
                               ? exact.force_per_radius_n_m * radius
                               : eq.force_nn - (inside ? eq.overlap_nm * eq.stiffness_n_m / 3.0 : 0.0);
  const double scale = radius * eq.stiffness_n_m;
  return std::abs(by_radius) < kTiltMost * std::abs(scale) ? by_radius / scale : 0.0;
}

// How much of the last step this one is, 0 if it goes another way.
double part_of_last(const TipTrend& last, const Vec3& move) noexcept {
  const double last_sq = last.move_w_nm.squaredNorm();
  if (!(last_sq > 0.0)) return 0.0;
  const double part = move.dot(last.move_w_nm) / last_sq;
  const double turned_sq = (move - part * last.move_w_nm).squaredNorm();
  return part > 0.0 && part < kLongerMove && turned_sq < kTurnedMove * kTurnedMove * last_sq ? part : 0.0;
}

// Energy of sample, springs and bristle.
double stored_aj(const TipSolution& s, const Compliance& c) noexcept {
  return s.potential_aj + 0.5 * s.force_w_nn.dot(c * s.force_w_nn) + s.friction_stored_aj;
}

}  // namespace

TipEquilibrium::TipEquilibrium(std::shared_ptr<const Surface> surface, const TipSampleLaw& law,
                               double tip_radius_nm, const EquilibriumOptions& options)
    : surface_(std::move(surface)),
      law_(law),
      tip_radius_nm_(tip_radius_nm),
      radius_force_(options.radius_force),
      options_(options) {
  if (options.friction) friction_.emplace(*options.friction);
  if (options.hardness_gpa) {
    if (surface_->is_flat()) throw UserError("hardness: a flat surface keeps no marks; expected a grid");
    plastic_.emplace(law_, *options.hardness_gpa);
  }
}

void TipEquilibrium::advance_flat(const Vec3& free_end, const Compliance& c, TipSampleState& law,
                                  TipSolution& solution) const noexcept {
  // Not on a copy: a law that fails forgets no more than its warm start.
  const Equilibrium eq = law_.advance(-free_end.z(), c(2, 2), tip_radius_nm_, law);
  describe(eq, solution);
  if (eq.status != SolveStatus::kOk) return;
  solution.radius_nm = tip_radius_nm_;
  solution.force_w_nn = Vec3(0.0, 0.0, eq.force_nn);
  solution.apex_w_nm = free_end + c.col(2) * eq.force_nn;
  solution.iterations = 1;
}

TipSolution TipEquilibrium::advance_flat(const Vec3& free_end, const Compliance& c,
                                         TipState& state) const noexcept {
  TipSolution solution;
  advance_flat(free_end, c, state.law, solution);
  if (solution.status == SolveStatus::kOk) remember(solution, free_end, state);
  return solution;
}

TipSolution TipEquilibrium::advance(const Vec3& free_end, const Compliance& c,
                                    TipState& state) const noexcept {
  if (!is_finite(free_end)) {
    TipSolution none;
    none.status = SolveStatus::kNonFinite;
    return none;
  }
  if (surface_->is_flat() && !friction_) return advance_flat(free_end, c, state);
  if (state.under_way && !state.stuck) return slide(free_end, c, kMostIterations, state);
  if (state.stuck && free_end == state.free_end_w_nm) return slide(free_end, c, 0, state);
  Vec3 start = free_end;
  TipTrend trend;
  if (state.started) {
    trend.move_w_nm = free_end - state.free_end_w_nm;
    trend.bend_w_nm = state.apex_w_nm + state.follow * trend.move_w_nm;
    trend.force_nn = state.force_nn;
    trend.contact_radius_rates = state.contact_radius_rates;
    const double part = part_of_last(state.trend, trend.move_w_nm);
    start = trend.bend_w_nm + part * part * state.trend.bend_w_nm;
  }
  std::optional<Jump> jump;
  TipSolution solution =
      balance(free_end, c, start, state, {Radius::kFollowed, kMostFollowed, 0.0, true, &jump});
  if (solution.status == SolveStatus::kOk) {
    trend.bend_w_nm = solution.apex_w_nm - trend.bend_w_nm;
    trend.force_nn = state.force_nn - trend.force_nn;
    trend.contact_radius_rates.per_force_nm_nn =
        state.contact_radius_rates.per_force_nm_nn - trend.contact_radius_rates.per_force_nm_nn;
    trend.contact_radius_rates.per_radius =
        state.contact_radius_rates.per_radius - trend.contact_radius_rates.per_radius;
    const bool smooth = solution.jumps == 0 && state.foot_count == 1 &&
                        trend.bend_w_nm.squaredNorm() < kMostBent * kMostBent * trend.move_w_nm.squaredNorm();
    state.trend = smooth ? trend : TipTrend{};
    return solution;
  }
  if (solution.status != SolveStatus::kNotConverged) return solution;
  state.trend = {};
  int spent = solution.iterations;
  const auto attempt = [&](const Vec3& from, const Attempt& with, TipState& kept) {
    solution = balance(free_end, c, from, kept, with);
    spent += solution.iterations;
    solution.iterations = spent;
    return solution.status == SolveStatus::kOk;
  };
  if (jump) {
    // At a fold Newton's method has the tip jump at one place and stay at the next, for ever. It jumps.
    TipState after = state;
    after.law = jump->law;
    if (attempt(jump->apex_w_nm, {Radius::kFollowed, kMostJumped}, after)) {
      state = after;
      solution.dissipated_aj += jump->dissipated_aj;
      ++solution.jumps;
      solution.slid = true;
      return solution;
    }
  }
  if (attempt(start, {Radius::kLate, kMostLate}, state)) return solution;
  solution = slide(free_end, c, kMostIterations - spent, state);
  solution.iterations += spent;
  return solution;
}

TipSolution TipEquilibrium::balance(const Vec3& free_end, const Compliance& c, const Vec3& start,
                                    TipState& state, const Attempt& attempt) const noexcept {
  TipSolution solution;
  const bool followed = attempt.radius == Radius::kFollowed;
  const Vec3 to_centre(0.0, 0.0, tip_radius_nm_);
  const double c_max = c.cwiseAbs().rowwise().sum().maxCoeff();  // bounds the largest eigenvalue
  Vec3 p = start;
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
  double contact_radius = state.contact_radius_nm;
  double radius_force = state.radius_force_nn;
  ContactRadiusRates rates = state.contact_radius_rates;
  if (followed && state.foot_count == 1 && force > 0.0) {
    // The limit of friction is far from a line over a step: from where the force is likely to be, with the
    // contact radius there (trapezium; over the radius below).
    const double part = part_of_last(state.trend, free_end - state.free_end_w_nm);
    const double change = part * state.trend.force_nn;
    if (std::abs(change) < kMostForceChange * force) {
      rates.per_force_nm_nn += 0.5 * part * state.trend.contact_radius_rates.per_force_nm_nn;
      rates.per_radius += 0.5 * part * state.trend.contact_radius_rates.per_radius;
      force += change;
      contact_radius = std::max(0.0, contact_radius + rates.per_force_nm_nn * change);
    }
  }
  double radius_before = state.radius_nm;  // where contact_radius is from
  double tilt_per_gradient = state.radius_as_overlap;
  TipSampleState law_state = state.law;
  double last_left = 0;
  bool rates_known = false;
  bool breaking = false;
  double energy_at_break = 0, lost_at_break = 0;
  Swing swing(tip_radius_nm_);
  Secants secants;
  FeetInUse left_behind = feet;  // the feet one position ago
  int feet_before = 0;

  int spent = 0;
  for (int iteration = 1; spent < attempt.iterations; ++iteration) {
    ++spent;
    feet.measure(tip_radius_nm_);
    if (!(force > 0.0)) feet.keep_deepest();

    // The forces besides n F, where they stand and how they go with p and F.
    const bool alone = followed && feet.count() == 1;
    const Vec3 gradient = alone || radius_force_ ? feet.radius_gradient() : Vec3(Vec3::Zero());
    Vec3 other = radius_force_ ? Vec3(radius_force * gradient) : Vec3(Vec3::Zero());
    Vec3 tilt = -tilt_per_gradient * gradient;
    const double tilted = tilt.norm();
    bool whole = alone && rates_known;  // Newton's matrix, with nothing approximated or held back
    if (tilted > kTiltLongest) {
      tilt *= kTiltLongest / tilted;
      whole = false;
    }
    const Vec3 pull =
        radius_force_ ? tilt : Vec3(Vec3::Zero());  // the law acts along n + pull, feels n + tilt
    Vec3 slope = pull;
    const double force_0 = force;
    FrictionStep rub;
    Mat3 hold = Mat3::Zero();   // K
    Vec3 drift = Vec3::Zero();  // ∂a/∂p
    if (friction_) {
      if (alone && contact_radius > 0.0) {
        contact_radius =
            std::max(0.0, contact_radius + rates.per_radius * (feet.radius_nm() - radius_before));
      }
      rub = friction_->move(state.friction, feet.normal().normalized(), p - state.apex_w_nm, contact_radius,
                            force, breaking);
      other += rub.force_w_nn;
      slope += rates.per_force_nm_nn * rub.force_per_radius_w_n_m + rub.force_per_load_w;
      if (alone) drift = rates.per_radius * gradient;
      const double carried = c_max * rub.force_per_radius_w_n_m.norm() * drift.norm();
      if (carried > kFrictionDrift) {
        drift *= kFrictionDrift / carried;
        whole = false;
      }
      hold = rub.stiffness_n_m - rub.force_per_radius_w_n_m * drift.transpose();
      if (alone) {
        // The force stays in the tangent plane, and of the motion only what lies in it counts.
        const Vec3 normal = feet.normal();
        const Mat3 normal_turn = feet.normal_turn();
        hold += normal * (normal_turn * rub.force_w_nn).transpose() -
                normal.dot(p - state.apex_w_nm) * (rub.stiffness_n_m * normal_turn);
      }
    }

    // A = (1 − C (F N − K))⁻¹ and S = A C, see the header.
    const double turn = c_max * feet.turning(force);
    Mat3 a = Mat3::Identity();
    if ((force != 0.0 || friction_) && c_max > 0.0) {
      const double kept = turn > kTurnMax ? kTurnMax / turn : 1.0;
      a = (Mat3::Identity() - c * (kept * force * feet.normal_turn() - hold)).inverse();
    }
    const Mat3 s = a * c;
    const Vec3 seen = feet.normal() + tilt;
    const double taken = seen.dot(s * (pull - slope));
    const double most_taken = kLateralShare * seen.dot(s * seen);
    if (taken > most_taken) {
      slope = pull + (slope - pull) * (most_taken / taken);  // about to jam
      whole = false;
    }
    if (turn > kTurnMax) whole = false;
    const Vec3 unloaded = a * (free_end + c * (other - force_0 * slope) - p);
    const FeetInUse::Reduced reduced = feet.reduce(s, unloaded, tilt, slope);

    if (feet.count() != feet_before) {
      last_left = 0;
      swing.forget();
      secants.forget();
    }
    feet_before = feet.count();
    const double radius_nm = feet.radius_nm();
    Equilibrium eq;
    PlasticFlow flow;
    const bool yields = plastic_ && attempt.may_yield;
    if (yields) {
      law_state = state.law;
      const PlasticStep plastic = plastic_->advance(reduced.base_overlap_nm, reduced.compliance, radius_nm,
                                                    feet.origin_radius_nm(), law_state);
      eq = plastic.equilibrium;
      flow = plastic.flow;
    } else {
      eq = law_.try_advance(reduced.base_overlap_nm, reduced.compliance, radius_nm, state.law, law_state);
    }
    if (eq.status != SolveStatus::kOk) {
      solution.status = SolveStatus::kNotConverged;
      solution.iterations = spent;
      return solution;
    }
    if (eq.jumps > 0) {
      spent += kJumpCost - 1;
      if (attempt.last_jump) attempt.last_jump->emplace(Jump{law_state, p, eq.dissipated_aj});
    }
    force = eq.force_nn;
    if (feet.share(reduced, force)) continue;  // a foot was dropped: the others alone

    const Vec3 normal = feet.normal();
    Vec3 step = unloaded + s * ((normal + slope) * force);
    const double length = step.norm();
    const double forces =
        c_max * (std::abs(force) + kPi * law_.parameters().work_of_adhesion_n_m * radius_nm);
    const double done = std::max(attempt.tolerance_nm, kStepDone + kForceDone * forces);
    if (!std::isfinite(length)) {
      solution.status = SolveStatus::kNotConverged;
      solution.iterations = spent;
      return solution;
    }
    if (turn >= 1.0) solution.slid = true;

    // A flow has changed what the law was asked.
    const RadiusRates exact = flow.depth_nm > 0.0 ? RadiusRates{} : law_.radius_rates(eq, law_state);

    // What the other forces are with the force found, against what they were taken for.
    const double contact_radius_0 = contact_radius;
    if (radius_force_) {
      Equilibrium on_mark = eq;
      on_mark.overlap_nm -= flow.depth_nm;
      radius_force = law_.radius_force_nn(on_mark, law_state);
    }
    tilt_per_gradient = radius_as_overlap(eq, exact, radius_nm);
    contact_radius = eq.contact_radius_nm;
    radius_before = radius_nm;
    Vec3 found = radius_force_ ? Vec3(radius_force * gradient) : Vec3(Vec3::Zero());
    if (friction_) {
      if (followed) {
        rates = contact_radius_rates(eq, exact, radius_nm, law_.parameters().contact_modulus_gpa);
      } else {
        const double before = rates.per_force_nm_nn;
        rates.per_force_nm_nn =
            std::max(0.0, secant(force, force_0, contact_radius, contact_radius_0, before));
      }
      const double there = contact_radius > 0.0 ? std::max(0.0, contact_radius + drift.dot(step)) : 0.0;
      const Vec3 turned = alone ? Vec3(normal + feet.normal_turn() * step) : normal;
      rub = friction_->move(state.friction, turned.normalized(), p + step - state.apex_w_nm, there, force,
                            breaking);
      found += rub.force_w_nn;
    }
    const Vec3 lateral = other + (force - force_0) * slope - hold * step;
    const double left = std::max(length, c_max * (found - lateral).cwiseAbs().maxCoeff());
    // Newton's next step is shorter than this one by at least what this one was than the last; what it would
    // be is the error of an answer that has this step in it.
    const bool foreseen = !radius_force_ && ((left < kForeseen && left * left < done * last_left) ||
                                             (whole && last_left > 0.0 && left < kForeseenWhole));
    rates_known = exact.known;
    const bool balanced = left < done || foreseen || (left < kNoise * done && left > 0.5 * last_left) ||
                          (iteration >= kPatient && left < kNoise * done + kForceAtLast * forces);
    last_left = left;

    if (balanced) {
      // Balanced on these feet; is there a deeper one?
      FootMemory memory = feet.memory(0);
      const SurfaceContact nearest = surface_->nearest(p + to_centre, Search::kGlobal, memory);
      if (tip_radius_nm_ - nearest.distance_nm >
          feet.overlap_nm() +
              (iteration < kPatient && !(attempt.tolerance_nm > 0.0) ? kDeeper : kDeeperAtLast)) {
        if (!(force > 0.0)) feet.clear();
        if (!feet.add(memory, nearest, 0.0)) feet.replace_least(memory, nearest);
        feet_before = 0;
        continue;
      }
      if (!yields) law_.add_joining_energy(eq, law_state);
      describe(eq, solution);
      solution.normal_w = normal + feet.normal_turn() * step;  // where the step leads
      solution.friction_w_nn = rub.force_w_nn;
      solution.friction_stored_aj = rub.stored_aj;
      solution.friction_dissipated_aj = rub.dissipated_aj;
      solution.sliding = rub.sliding;
      solution.force_w_nn = force * solution.normal_w + found;
      if (rub.sliding && !breaking && friction_->parameters().kinetic_ratio < 1.0) {
        breaking = true;  // it lets go: on to where the kinetic limit holds it
        energy_at_break = stored_aj(solution, c);
        lost_at_break = rub.dissipated_aj;
        continue;
      }
      if (breaking) {
        // At rest again at the same free end: what springs, sample and bristle have lost is dissipated.
        solution.friction_dissipated_aj =
            std::max(rub.dissipated_aj, lost_at_break + energy_at_break - stored_aj(solution, c));
      }
      solution.apex_w_nm = free_end + c * solution.force_w_nn;
      solution.radius_nm = radius_nm;
      solution.radius_clamped = feet.radius_clamped();
      solution.outside = feet.outside();
      solution.feet = feet.count();
      solution.iterations = spent;
      state.law = law_state;
      state.friction = rub.after;
      state.radius_force_nn = radius_force;
      state.contact_radius_rates = rates;
      state.radius_as_overlap = tilt_per_gradient;
      const Vec3 give = s * (normal + slope);
      const double along = 1.0 + eq.stiffness_n_m * seen.dot(give);
      state.follow = turn < kTurnTrusted ? a : Mat3::Identity();
      if (along > 0.1) {
        state.follow -= give * ((eq.stiffness_n_m / along) * seen.transpose() * state.follow);
      }
      feet.store(state);
      remember(solution, free_end, state);
      if (flow.depth_nm > 0.0) {
        solution.yielded.from_radius_nm = radius_nm;
        solution.yielded.origin_radius_nm = feet.origin_radius_nm();
        solution.yielded.flow = flow;
        feet.store(solution.yielded);
        solution.radius_nm = state.radius_nm = flow.radius_nm;
        state.overlap_nm -= flow.depth_nm;
      }
      return solution;
    }
    const double longest = kLongestStepRadii * tip_radius_nm_;
    const bool far = length > longest;
    if (far) step *= longest / length;
    const bool swings = swing.guard(p, step);
    if (far || swings) {
      secants.forget();
    } else if (iteration > kNewtonAlone) {
      step = secants.better(p, step);
    }
    if (swings) {
      // Two feet by turns are two feet at once, if the one left behind is still one from here.
      bool taken_in = false;
      for (int i = 0; i < left_behind.count() && force > 0.0; ++i) {
        FootMemory memory = left_behind.memory(i);
        const SurfaceContact contact = surface_->nearest(p + to_centre, Search::kLocal, memory);
        taken_in = feet.add_if_new(memory, contact) || taken_in;
      }
      if (taken_in) continue;
    } else {
      left_behind = feet;
    }
    p += step;
    for (int i = 0; i < feet.count(); ++i) {
      feet.update(i, surface_->nearest(p + to_centre, Search::kLocal, feet.memory(i)));
    }
  }
  solution.status = SolveStatus::kNotConverged;
  solution.iterations = spent;
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
