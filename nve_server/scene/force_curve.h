#pragma once

#include <functional>

#include "telenano/nve_server/scene/scene.h"

namespace telenano::scene {

/// Which way, how far and how finely the base of the cantilever moves, over (x, y) along W z.
struct CurvePlan {
  double x_nm = 0;
  double y_nm = 0;
  double from_nm = 20;
  double to_nm = -5;
  double step_nm = 0.01;
};

struct CurveRow {
  bool approach = true;
  double base_z_nm = 0;  ///< apex with the cantilever undeflected, above the surface at (x, y)
  double tip_z_nm = 0;   ///< base + deflection
  double overlap_nm = 0;
  double force_nn = 0;  ///< W z, repulsive positive
  double deflection_nm = 0;
  physics::Branch branch = physics::Branch::kFree;
  double work_aj = 0;  ///< done by the base since the first row
};

/// A place where tip and cantilever found no balance.
struct CurveGap {
  bool approach = true;
  double base_z_nm = 0;
};

struct CurveOutcome {
  long rows = 0;
  long gaps = 0;
};

/// Throws UserError unless the plan is sane and lies in the scene: finite, from > to, 2 to 1e7 steps, (x, y)
/// inside.
void check_plan(const Scene& scene, const CurvePlan& plan);

/// A force–distance curve: approach from `from` to `to`, then retract, the row at `to` in both. Cantilever
/// and contact alone; the coupling takes no part. Jumps between rows are resolved. Quasi-static.
///
/// work_aj: Δ(U_tip–sample + U_cantilever + bristle) + what jumps and friction have lost, at any step size.
/// Where the ground is not level the base moves in pieces of at most 0.05 nm.
///
/// Gaps. Where there is no balance the tip stays as it was and the next place is tried; such a place has no
/// row, `gap` is called instead. Over it the work goes on from the last balance to the next.
///
/// Throws RunError if there is no balance anywhere.
CurveOutcome run_curve(const Scene& scene, const CurvePlan& plan,
                       const std::function<void(const CurveRow&)>& row,
                       const std::function<void(const CurveGap&)>& gap = {});

const char* branch_name(physics::Branch branch) noexcept;

}  // namespace telenano::scene
