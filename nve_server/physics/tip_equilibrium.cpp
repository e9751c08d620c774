#include "nve_server/physics/tip_equilibrium.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace telenano::physics {
namespace {

constexpr int kMaxIterations = 40;
constexpr double kStepDone = 1e-9;       // nm
constexpr double kGlobalAgain = 1e-3;    // nm that the apex may move before the nearest foot is asked for again
constexpr double kTurnMax = 0.9;         // of F C N; at 1 the tip slides off sideways
constexpr double kLongestStepRadii = 0.5;

// Largest eigenvalue of F·N: the foot's principal curvatures, as seen from the centre.
double turning(double force_nn, const SurfaceContact& contact) noexcept {
  const double d = contact.distance_nm;
  const double first = 1.0 + contact.curvature_1_per_nm * d;
  const double second = 1.0 + contact.curvature_2_per_nm * d;
  const double turn_1 = first > 1e-6 ? contact.curvature_1_per_nm / first : 0.0;
  const double turn_2 = second > 1e-6 ? contact.curvature_2_per_nm / second : 0.0;
  return std::max(force_nn * turn_1, force_nn * turn_2);
}

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
  state.apex_w_nm = solution.apex_w_nm;
  state.normal_w = solution.normal_w;
  state.force_nn = solution.normal_force_nn;
  state.stiffness_n_m = solution.stiffness_n_m;
}

// Where the apex goes if the surface is a plane and the law a line.
Vec3 predict(const Vec3& free_end, const Compliance& c, const TipState& state) noexcept {
  if (!state.started) return free_end;
  const Vec3 moved = free_end - state.free_end_w_nm;
  const Vec3 give = c.cwiseProduct(state.normal_w);
  const double springs = state.normal_w.dot(give);
  const double along = 1.0 + springs * state.stiffness_n_m;
  if (!(along > 0.1)) return state.apex_w_nm + moved;
  return state.apex_w_nm + moved - give * (state.normal_w.dot(moved) * state.stiffness_n_m / along);
}

}  // namespace

TipEquilibrium::TipEquilibrium(std::shared_ptr<const Surface> surface, const TipSampleLaw& law, double tip_radius_nm)
    : surface_(std::move(surface)), law_(law), tip_radius_nm_(tip_radius_nm) {}

TipSolution TipEquilibrium::advance_flat(const Vec3& free_end, const Compliance& c, TipState& state) const noexcept {
  TipSolution solution;
  TipSampleState law_state = state.law;
  describe(law_.advance(-free_end.z(), c.z(), tip_radius_nm_, law_state), solution);
  if (solution.status != SolveStatus::kOk) return solution;
  solution.radius_nm = tip_radius_nm_;
  solution.force_w_nn = Vec3(0.0, 0.0, solution.normal_force_nn);
  solution.apex_w_nm = free_end + Vec3(0.0, 0.0, c.z() * solution.normal_force_nn);
  solution.iterations = 1;
  state.law = law_state;
  remember(solution, free_end, state);
  return solution;
}

TipSolution TipEquilibrium::advance(const Vec3& free_end, const Compliance& c, TipState& state) const noexcept {
  TipSolution solution;
  if (!is_finite(free_end)) {
    solution.status = SolveStatus::kNonFinite;
    return solution;
  }
  if (surface_->is_flat()) return advance_flat(free_end, c, state);

  const Vec3 to_centre(0.0, 0.0, tip_radius_nm_);
  const double c_max = c.maxCoeff();
  FootMemory foot = state.foot;
  Vec3 p = predict(free_end, c, state);
  Vec3 searched_at = p;
  bool searched = false;
  double force = state.force_nn;

  for (int iteration = 1; iteration <= kMaxIterations; ++iteration) {
    const Search search = searched ? Search::kLocal : Search::kGlobal;
    const SurfaceContact contact = surface_->nearest(p + to_centre, search, foot);
    if (!searched) searched_at = p;
    searched = true;
    const Vec3& n = contact.normal_w;
    const EffectiveRadius radius = effective_radius(tip_radius_nm_, contact);

    // A = (1 − F C N)⁻¹, see the header.
    Mat3 a = Mat3::Identity();
    const double turn = c_max * turning(force, contact);
    if (force * c_max != 0.0) {
      const double kept = turn > kTurnMax ? kTurnMax / turn : 1.0;
      a = (Mat3::Identity() - (kept * force) * c.asDiagonal() * contact.normal_turn_per_nm).inverse();
    }
    const Vec3 give = a * c.cwiseProduct(n);  // how the apex moves for 1 nN
    const Vec3 unloaded = a * (free_end - p);
    const double overlap = tip_radius_nm_ - contact.distance_nm;
    TipSampleState law_state = state.law;
    const Equilibrium eq =
        law_.advance(overlap - n.dot(unloaded), std::max(0.0, n.dot(give)), radius.radius_nm, law_state);
    if (eq.status != SolveStatus::kOk) {
      solution.status = eq.status;
      return solution;
    }
    force = eq.force_nn;
    Vec3 step = unloaded + give * force;
    const double length = step.norm();
    if (!std::isfinite(length)) {
      solution.status = SolveStatus::kNonFinite;
      return solution;
    }
    if (turn >= 1.0) solution.slid = true;
    if (length < kStepDone) {
      if ((p - searched_at).squaredNorm() > kGlobalAgain * kGlobalAgain) {
        searched = false;
        continue;
      }
      describe(eq, solution);
      solution.normal_w = n;
      solution.force_w_nn = force * n;
      solution.apex_w_nm = free_end + c.cwiseProduct(solution.force_w_nn);
      solution.radius_nm = radius.radius_nm;
      solution.radius_clamped = radius.clamped;
      solution.outside = contact.outside;
      solution.iterations = iteration;
      state.law = law_state;
      state.foot = foot;
      remember(solution, free_end, state);
      return solution;
    }
    const double longest = kLongestStepRadii * tip_radius_nm_;
    if (length > longest) step *= longest / length;
    p += step;
  }
  solution.status = SolveStatus::kNotConverged;
  solution.iterations = kMaxIterations;
  return solution;
}

double TipEquilibrium::touch_height_nm(double x_nm, double y_nm) const noexcept {
  // Going down by the distance that is certainly free never passes the surface; near it each step takes the gap times
  // (1 − n_z) of the last, so that even a 60° flank needs some 40 steps.
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
