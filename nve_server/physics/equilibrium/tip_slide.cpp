// The tip on its way down, where Newton's method finds no balance: tip_equilibrium.h, Slides.
#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "telenano/nve_server/physics/equilibrium/tip_equilibrium.h"

namespace telenano::physics {
namespace {

constexpr double kFirstPart = 0.25;
constexpr double kLeastPart = 1e-3;         // below, a stage is no longer than what it is solved to
constexpr double kStageDone = 1e-6;         // nm: feet that take turns leave steps of 1e-8 nm for ever
constexpr double kAtRest = 1e-6;            // nm that are missing to the balance
constexpr int kMostOfStage = 14;            // Newton's iterations
constexpr int kMostOfLast = 16;             // of a stage that would be the balance sought
constexpr int kLongIterations = 1600;       // where the springs cannot hold the tip on its way, and at first
constexpr double kLeastCompliance = 1e-10;  // of the largest
constexpr double kToAndFro = 5e-3;          // nm that a step goes where feet send the tip to each other
constexpr double kDescent = 1e-9;           // of the energy

// C is invertible, and C⁻¹ exact to some 1e-6 of the springs' forces.
bool gives_all_ways(const Compliance& c) noexcept {
  const Eigen::LLT<Mat3> root(c);
  if (root.info() != Eigen::Success) return false;
  const double stiffest = Vec3(root.matrixLLT().diagonal()).minCoeff();
  return stiffest * stiffest > kLeastCompliance * c.trace();
}

// The tip as it was left, without the springs' force.
TipSolution as_it_was(const TipState& state) noexcept {
  TipSolution solution;
  solution.branch = state.law.branch;
  solution.normal_w = state.normal_w;
  solution.normal_force_nn = state.force_nn;
  solution.overlap_nm = state.overlap_nm;
  solution.radius_nm = state.radius_nm;
  solution.contact_radius_nm = state.contact_radius_nm;
  solution.stiffness_n_m = state.stiffness_n_m;
  const FrictionState& bristle = state.friction;
  solution.friction_w_nn = -bristle.stiffness_n_m * bristle.extension_w_nm;
  solution.friction_stored_aj = 0.5 * bristle.stiffness_n_m * bristle.extension_w_nm.squaredNorm();
  solution.potential_aj = state.stored_aj - solution.friction_stored_aj;
  solution.feet = state.foot_count;
  return solution;
}

}  // namespace

TipSolution TipEquilibrium::slide(const Vec3& free_end, const Compliance& c, int iterations,
                                  TipState& state) const noexcept {
  const bool may_pause = gives_all_ways(c);
  if (!may_pause || !state.started) iterations = kLongIterations;
  const Mat3 springs = may_pause ? Mat3(c.inverse()) : Mat3(Mat3::Zero());
  const auto energy = [&](const TipState& at) {
    const Vec3 stretch = at.apex_w_nm - free_end;
    return at.stored_aj + 0.5 * stretch.dot(springs * stretch);
  };
  TipState here = state;
  if (!state.started) {  // let down from above
    here.apex_w_nm = free_end;
    here.apex_w_nm.z() = std::max(free_end.z(), surface_->highest_nm());
  }
  TipSolution solution = as_it_was(state);
  double part = state.under_way && !state.stuck ? state.slide_part : kFirstPart;
  double law_lost = 0, friction_lost = 0;
  int jumps = 0, spent = 0;
  bool moved = false, at_rest = false;
  while (!at_rest && spent < iterations && part >= kLeastPart) {
    const Vec3 from = here.apex_w_nm;
    const bool last = part == 1.0;
    const Attempt attempt{Radius::kFollowed, last ? kMostOfLast : kMostOfStage, last ? 0.0 : kStageDone,
                          false};
    const TipSolution stage = balance(from + part * (free_end - from), part * c, from, here, attempt);
    spent += stage.iterations;
    if (stage.status != SolveStatus::kOk) {
      part *= 0.25;
      continue;
    }
    solution = stage;
    moved = true;
    law_lost += stage.dissipated_aj;
    friction_lost += stage.friction_dissipated_aj;
    jumps += stage.jumps;
    // From p = from + part (free end − from + C F): what is missing to the balance sought.
    at_rest = last || (here.apex_w_nm - from).norm() / part < kAtRest;
    part = std::min(1.0, 2.0 * part);
  }
  solution.iterations = spent;
  if (at_rest) {
    here.apex_w_nm = free_end + c * solution.force_w_nn;
  } else if (may_pause && here.started) {
    bool stuck = part < kLeastPart || iterations == 0;
    if (moved && state.started && (here.apex_w_nm - state.apex_w_nm).norm() < kToAndFro) {
      stuck = !(energy(here) < energy(state) - kDescent * std::abs(energy(state)));
    }
    if (stuck && state.started) {
      here = state;
      solution = as_it_was(state);
      solution.iterations = spent;
      law_lost = friction_lost = 0.0;
      jumps = 0;
    }
    here.under_way = solution.under_way = true;
    here.stuck = solution.stuck = stuck;
    here.slide_part = std::max(part, kLeastPart);
    here.follow = Mat3::Zero();
    solution.force_w_nn = springs * (here.apex_w_nm - free_end);
  } else {
    solution.status = SolveStatus::kNotConverged;
    return solution;
  }
  here.free_end_w_nm = free_end;
  solution.apex_w_nm = here.apex_w_nm;
  solution.dissipated_aj = law_lost;
  solution.friction_dissipated_aj = friction_lost;
  solution.jumps = jumps;
  solution.slid = true;
  state = here;
  return solution;
}

}  // namespace telenano::physics
