#include "telenano/nve_server/physics/equilibrium/level_equilibrium.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace telenano::physics {
namespace {

using Vec2 = Eigen::Vector2d;
using Mat2 = Eigen::Matrix2d;

constexpr int kMostSecular = 50;  // Newton steps of the length of the slip; a few
constexpr double kSecular = 1e-14;
constexpr int kMostAsked = 80;  // balances of the law, of one search
constexpr double kDone_nm = 1e-9;
constexpr double kDone = 1e-11;       // of the springs' extension
constexpr double kNarrowest = 1e-13;  // of the bracket, of the springs' extension: there the law jumps

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

}  // namespace

/// Where the search for a balance with friction stands.
struct LevelEquilibrium::Search {
  const Vec3& free_end;
  const Compliance& springs;
  const LevelState& before;
  bool breaking = false;
  TipSampleState law{};
  Equilibrium eq{};
  FrictionStep rub{};
  int iterations = 0;
};

LevelEquilibrium::LevelEquilibrium(std::shared_ptr<const TipSampleLaw> law, double tip_radius_nm,
                                   const std::optional<FrictionParameters>& friction)
    : law_(std::move(law)), tip_radius_nm_(tip_radius_nm) {
  if (friction) friction_.emplace(*friction);
}

void LevelEquilibrium::advance_without_friction(const Vec3& free_end, const Compliance& c,
                                                TipSampleState& law, TipSolution& solution) const noexcept {
  // Not on a copy: a law that fails forgets no more than its warm start.
  const Equilibrium eq = law_->advance(-free_end.z(), c(2, 2), tip_radius_nm_, law);
  describe(eq, solution);
  if (eq.status != SolveStatus::kOk) return;
  solution.radius_nm = tip_radius_nm_;
  solution.force_w_nn = Vec3(0.0, 0.0, eq.force_nn);
  solution.apex_w_nm = free_end + c.col(2) * eq.force_nn;
  solution.iterations = 1;
}

// At the load and the contact radius that are there.
void LevelEquilibrium::balance_across(Search& at) const noexcept {
  const Mat2 across = at.springs.topLeftCorner<2, 2>();
  const Vec2 way =
      (at.free_end - at.before.apex_w_nm).head<2>() + at.springs.topRightCorner<2, 1>() * at.eq.force_nn;
  const auto rubbed = [&](const Vec2& moved) {
    return friction_->move(at.before.friction, Vec3::UnitZ(), Vec3(moved.x(), moved.y(), 0.0),
                           at.eq.contact_radius_nm, at.eq.force_nn, at.breaking);
  };
  ++at.iterations;
  at.rub = rubbed(Vec2::Zero());
  const double k = at.rub.after.stiffness_n_m;
  if (!(k > 0.0 && at.before.friction.stiffness_n_m > 0.0)) return;  // nothing to hold by
  const Vec2 carried = (at.rub.after.extension_w_nm + at.rub.slip_w_nm).head<2>();
  const Vec2 pulled = carried + way;
  const double limit = friction_->limit_nn(at.eq.contact_radius_nm, at.eq.force_nn) *
                       (at.breaking ? friction_->parameters().kinetic_ratio : 1.0);
  const Vec2 stuck = (Mat2::Identity() + k * across).inverse() * pulled;
  if (k * stuck.norm() <= limit) {
    at.rub = rubbed(stuck - carried);
    return;
  }
  double length = limit / k;
  Vec2 direction = Vec2::Zero();
  for (int i = 0; i < kMostSecular; ++i) {
    const Mat2 inverse = (length * Mat2::Identity() + limit * across).inverse();
    direction = inverse * pulled;
    const double size = direction.norm();
    if (!(size > 1.0 + kSecular)) break;
    length += size * size * (size - 1.0) / direction.dot(inverse * direction);
  }
  at.rub = rubbed(length * direction - carried);
}

// One scalar is sought: by how much friction lifts the apex, β = c·f. The law is asked at −(x_z + β), which
// says load and contact, those and the way across say f: β = c·f(β) by secants in a bracket.
LevelEquilibrium::Sought LevelEquilibrium::search(Search& at, const TipSampleState& from) const noexcept {
  const Vec2 cross = at.springs.topRightCorner<2, 1>();
  const bool coupled = cross.squaredNorm() > 0.0;
  const auto lifted = [&] { return cross.dot(at.rub.force_w_nn.head<2>()); };
  const auto short_of = [&](double lift, double& lacking) {
    at.eq = law_->try_advance(-(at.free_end.z() + lift), at.springs(2, 2), tip_radius_nm_, from, at.law);
    if (at.eq.status != SolveStatus::kOk) return false;
    balance_across(at);
    lacking = lifted() - lift;
    return true;
  };
  at.rub.force_w_nn = -at.before.friction.stiffness_n_m * at.before.friction.extension_w_nm;
  double lift = coupled ? lifted() : 0.0, lacking = 0;
  if (!short_of(lift, lacking)) return Sought::kFailed;
  if (!coupled) return Sought::kFound;
  struct End {
    bool known = false;
    double lift = 0, lacking = 0;
  } above, below;  // where friction lifts by more than was taken, and by less
  double last_lift = lift, last_lacking = lacking;
  for (int i = 0; i < kMostAsked; ++i) {
    const double extension =
        std::abs(lift) + std::abs(at.free_end.z()) + at.springs(2, 2) * std::abs(at.eq.force_nn);
    if (std::abs(lacking) < kDone_nm + kDone * extension) return Sought::kFound;
    (lacking > 0.0 ? above : below) = {true, lift, lacking};
    if (above.known && below.known && std::abs(above.lift - below.lift) < kNarrowest * extension) {
      return Sought::kJumps;
    }
    const double slope = i == 0 ? -1.0 : (lacking - last_lacking) / (lift - last_lift);
    double next = slope < 0.0 ? lift - lacking / slope : lift + lacking;
    if (above.known && below.known) {
      const double low = std::min(above.lift, below.lift), high = std::max(above.lift, below.lift);
      // Halved every third time: a secant that comes from one side alone narrows nothing.
      if (i % 3 == 2 || !(next > low && next < high)) next = 0.5 * (low + high);
    }
    last_lift = lift;
    last_lacking = lacking;
    lift = next;
    if (!std::isfinite(lift) || !short_of(lift, lacking)) return Sought::kFailed;
  }
  return Sought::kFailed;
}

TipSolution LevelEquilibrium::advance(const Vec3& free_end, const Compliance& c,
                                      LevelState& state) const noexcept {
  TipSolution solution;
  if (!friction_) {
    advance_without_friction(free_end, c, state.law, solution);
    if (solution.status == SolveStatus::kOk) state.apex_w_nm = solution.apex_w_nm;
    return solution;
  }
  solution.status = SolveStatus::kNonFinite;
  if (!is_finite(free_end) || !c.allFinite()) return solution;
  Search at{free_end, c, state};
  const TipSampleState* from = &state.law;
  std::optional<TipSampleState> after;
  double jumped_aj = 0;
  int jumped = 0;
  const auto found = [&] {
    Sought sought = search(at, *from);
    if (sought == Sought::kJumps && at.eq.jumps == 0) {
      // The bracket's other end is the one where it does.
      const double base = -(free_end.z() + c.topRightCorner<2, 1>().dot(at.rub.force_w_nn.head<2>()));
      at.eq = law_->try_advance(base, c(2, 2), tip_radius_nm_, *from, at.law);
    }
    if (sought != Sought::kJumps || at.eq.jumps == 0 || jumped > 0) return sought == Sought::kFound;
    // It goes over, and stays there: the law remembers.
    jumped_aj = at.eq.dissipated_aj;
    jumped = at.eq.jumps;
    after = at.law;
    from = &*after;
    return search(at, *from) == Sought::kFound;
  };
  if (!found()) {
    solution.status = at.eq.status != SolveStatus::kOk ? at.eq.status : SolveStatus::kNotConverged;
    solution.iterations = at.iterations;
    return solution;
  }
  const auto stored = [&] {
    const Vec3 force = at.rub.force_w_nn + Vec3(0.0, 0.0, at.eq.force_nn);
    return at.eq.potential_aj + 0.5 * force.dot(c * force) + at.rub.stored_aj;
  };
  double friction_lost = at.rub.dissipated_aj;
  if (at.rub.sliding && friction_->parameters().kinetic_ratio < 1.0) {
    // It lets go, and slips to where the kinetic limit holds it: what all have lost by then is friction.
    const double before = stored(), lost = at.rub.dissipated_aj;
    at.breaking = true;
    if (!found()) {
      solution.status = SolveStatus::kNotConverged;
      solution.iterations = at.iterations;
      return solution;
    }
    friction_lost = std::max(at.rub.dissipated_aj, lost + before - stored());
  }
  law_->add_joining_energy(at.eq, at.law);
  describe(at.eq, solution);
  solution.dissipated_aj += jumped_aj;
  solution.jumps += jumped;
  solution.radius_nm = tip_radius_nm_;
  solution.friction_w_nn = at.rub.force_w_nn;
  solution.friction_stored_aj = at.rub.stored_aj;
  solution.friction_dissipated_aj = friction_lost;
  solution.sliding = at.rub.sliding;
  solution.force_w_nn = at.rub.force_w_nn + Vec3(0.0, 0.0, at.eq.force_nn);
  solution.apex_w_nm = free_end + c * solution.force_w_nn;
  solution.iterations = at.iterations;
  state.law = at.law;
  state.friction = at.rub.after;
  state.apex_w_nm = solution.apex_w_nm;
  return solution;
}

}  // namespace telenano::physics
