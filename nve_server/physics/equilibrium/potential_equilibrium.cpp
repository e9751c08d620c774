#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/renew.h"
#include "telenano/nve_server/physics/equilibrium/potential_walk.h"

namespace telenano::physics {
namespace {

constexpr int kMostHalvings = 2;         // four parts
constexpr int kFirstEvaluations = 2000;  // where the tip is placed

}  // namespace

PotentialEquilibrium::PotentialEquilibrium(std::shared_ptr<const ContactFields> fields,
                                           std::shared_ptr<const BranchPotential> potential,
                                           const std::optional<FrictionParameters>& friction)
    : potential_(std::move(fields), std::move(potential)) {
  if (friction) friction_.emplace(*friction);
}

double PotentialEquilibrium::touch_height_nm(double x_nm, double y_nm, double highest_nm) const noexcept {
  // δ falls with z nearly as a line: Newton's method, held to downward steps of half the gap at most where
  // the softening bends it.
  double z = highest_nm;
  for (int i = 0; i < 200; ++i) {
    ContactJet at;
    potential_.fields().contact_at(Vec3(x_nm, y_nm, z), at);
    const double rate = std::min(at.overlap_grad.z(), -0.1);
    const double step = -at.overlap_nm / rate;
    z += step;
    if (std::abs(step) < 1e-11) break;
  }
  return z;
}

TipSolution PotentialEquilibrium::advance(const Vec3& free_end, const Compliance& c, PotentialState& state,
                                          const Vec3& jolt) const noexcept {
  TipSolution solution;
  solution.status = SolveStatus::kNonFinite;
  if (!is_finite(free_end) || !c.allFinite()) return solution;
  if (c != state.springs.compliance_nm_nn) state.springs.make(c);
  PotentialWalk walk(potential_, friction_, state);
  PathTrend trend;
  if (!state.started) {
    walk.place(free_end);
    walk.allow(kFirstEvaluations);
    walk.descend();
    walk.forget_losses();
  } else if (state.under_way) {
    walk.hold(free_end);
    walk.descend();
  } else {
    const Vec3 from = state.free_end_w_nm;
    const Vec3 whole = free_end - from;
    const double part_of_trend = state.trend.part_of(whole);
    const Vec3 foreseen = part_of_trend > 0.0 ? state.trend.guess(part_of_trend) : Vec3(Vec3::Zero());
    double gone = 0;
    double part = 1;
    int halvings = 0;
    bool balanced = true;
    bool straight = true;
    while (gone < 1.0 && balanced) {
      const double next = std::min(1.0, gone + part);
      const Vec3 to = next < 1.0 ? Vec3(from + next * whole) : free_end;
      Vec3 bend = gone == 0.0 ? jolt : Vec3(Vec3::Zero());
      if (straight && halvings == 0) bend += foreseen;
      if (walk.follow(to, bend)) {
        if (straight && next == 1.0) {
          const Vec3 moved = walk.apex() - state.apex_w_nm - jolt;
          trend = state.trend;
          trend.take(whole, part_of_trend, moved - state.follow * whole, walk.rate() * whole - moved);
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
  if (!walk.finite() || !is_finite(solution.force_w_nn) || !std::isfinite(solution.potential_aj)) {
    renew(solution);
    solution.status = SolveStatus::kNonFinite;
    return solution;
  }
  solution.status = SolveStatus::kOk;
  walk.write(state);
  state.trend = trend;
  return solution;
}

}  // namespace telenano::physics
