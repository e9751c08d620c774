#include "telenano/nve_server/scene/force_curve.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"

namespace telenano::scene {
namespace {

constexpr int kMostSlide = 1000;
constexpr double kSubstepMax_nm = 0.05;  // on a curved surface
constexpr double kRowsMax = 1e7;

std::string interval(double min, double max) {
  std::ostringstream text;
  text << "[" << min << ", " << max << "]";
  return text.str();
}

void require(bool good, const char* flag, double value, const std::string& expected) {
  if (good) return;
  std::ostringstream text;
  text << flag << " is " << value << ", expected " << expected;
  throw UserError(text.str());
}

class CurveWalk {
 public:
  CurveWalk(const Scene& scene, const CurvePlan& plan)
      : scene_(scene),
        compliance_(scene.probe_compliance_nm_nn()),
        x_(plan.x_nm),
        y_(plan.y_nm),
        surface_z_(scene.surface->height_nm(plan.x_nm, plan.y_nm)) {}

  /// False: no balance there.
  bool move_to(double base_z_nm) {
    int substeps = 1;
    if (started_ && !scene_.surface->is_flat()) {
      substeps = static_cast<int>(std::max(1.0, std::ceil(std::abs(base_z_nm - base_z_) / kSubstepMax_nm)));
    }
    const double from = base_z_;
    bool found = false;
    for (int i = 1; i <= substeps; ++i) {
      found = solve(i == substeps ? base_z_nm : from + (base_z_nm - from) * i / substeps);
    }
    return found;
  }

  CurveRow row(bool approach) const {
    CurveRow row;
    row.approach = approach;
    row.base_z_nm = base_z_;
    row.force_nn = solution_.force_w_nn.z();
    row.deflection_nm = row.force_nn * compliance_(2, 2);
    row.tip_z_nm = base_z_ + row.deflection_nm;
    row.overlap_nm = solution_.overlap_nm;
    row.branch = solution_.branch;
    row.work_aj = work_;
    return row;
  }

 private:
  bool solve(double base_z_nm) {
    const physics::TipSolution before = solution_;
    const physics::LevelState state_before = state_;
    const physics::PotentialState potential_before = potential_state_;
    const Vec3 end(x_, y_, surface_z_ + base_z_nm);
    solution_ = advance(end);
    // A slide that takes more than a step: the curve shows where it ends.
    for (int i = 0; solution_.under_way && i < kMostSlide; ++i) {
      const double lost = solution_.dissipated_aj, rubbed = solution_.friction_dissipated_aj;
      solution_ = advance(end);
      solution_.dissipated_aj += lost;
      solution_.friction_dissipated_aj += rubbed;
    }
    if (solution_.status != physics::SolveStatus::kOk) {
      solution_ = before;
      state_ = state_before;  // a slide may have failed half way
      potential_state_ = potential_before;
      return false;
    }
    if (started_) {
      work_ +=
          stored(solution_) - stored(before) + solution_.dissipated_aj + solution_.friction_dissipated_aj;
    }
    base_z_ = base_z_nm;
    started_ = true;
    return true;
  }

  physics::TipSolution advance(const Vec3& end) {
    if (scene_.potential) return scene_.potential->advance(end, compliance_, potential_state_);
    return scene_.level->advance(end, compliance_, state_);
  }

  double stored(const physics::TipSolution& s) const {
    return s.potential_aj + s.friction_stored_aj + 0.5 * s.force_w_nn.dot(compliance_ * s.force_w_nn);
  }

  const Scene& scene_;
  physics::Compliance compliance_;
  double x_, y_, surface_z_;
  physics::LevelState state_;
  physics::PotentialState potential_state_;
  physics::TipSolution solution_;
  double base_z_ = 0;
  double work_ = 0;
  bool started_ = false;
};

}  // namespace

const char* branch_name(physics::Branch branch) noexcept {
  switch (branch) {
    case physics::Branch::kVanDerWaals:
      return "vdw";
    case physics::Branch::kNonContact:
      return "noncontact";
    case physics::Branch::kContact:
      return "contact";
    case physics::Branch::kFree:
      break;
  }
  return "free";
}

void check_plan(const Scene& scene, const CurvePlan& plan) {
  const Vec3& min = scene.limits.workspace_min_w_nm;
  const Vec3& max = scene.limits.workspace_max_w_nm;
  require(plan.x_nm >= min.x() && plan.x_nm <= max.x(), "--x-nm", plan.x_nm, interval(min.x(), max.x()));
  require(plan.y_nm >= min.y() && plan.y_nm <= max.y(), "--y-nm", plan.y_nm, interval(min.y(), max.y()));
  require(std::abs(plan.from_nm) <= 1e5, "--from-nm", plan.from_nm, "a height in [-1e5, 1e5]");
  require(plan.to_nm >= -1e5 && plan.to_nm < plan.from_nm, "--to-nm", plan.to_nm,
          "a height in [-1e5, from-nm), since approach goes down");
  const double span = plan.from_nm - plan.to_nm;
  require(plan.step_nm > 0 && plan.step_nm <= span && span / plan.step_nm <= kRowsMax, "--step-nm",
          plan.step_nm, "more than 0, at most from-nm - to-nm, and no more than 1e7 rows");
}

CurveOutcome run_curve(const Scene& scene, const CurvePlan& plan,
                       const std::function<void(const CurveRow&)>& row,
                       const std::function<void(const CurveGap&)>& gap) {
  check_plan(scene, plan);
  // Row i at from − i·step, not by adding up steps, and the last row at `to` itself: 1e-9 of a step is
  // rounding.
  const double span = plan.from_nm - plan.to_nm;
  const auto last = static_cast<long>(std::ceil(span / plan.step_nm - 1e-9));
  const auto height = [&](long i) {
    return i == last ? plan.to_nm : plan.from_nm - plan.step_nm * static_cast<double>(i);
  };
  CurveWalk walk(scene, plan);
  CurveOutcome outcome;
  const auto visit = [&](long i, bool approach) {
    if (walk.move_to(height(i))) {
      ++outcome.rows;
      row(walk.row(approach));
    } else {
      ++outcome.gaps;
      if (gap) gap({approach, height(i)});
    }
  };
  for (long i = 0; i <= last; ++i) visit(i, true);
  for (long i = last; i >= 0; --i) visit(i, false);
  if (outcome.rows == 0) {
    std::ostringstream text;
    text << scene.path << ": no balance of tip and cantilever at any of the " << outcome.gaps
         << " base heights over (" << plan.x_nm << ", " << plan.y_nm << ") nm";
    throw RunError(text.str());
  }
  return outcome;
}

}  // namespace telenano::scene
