#pragma once

#include <optional>
#include <vector>

#include "telenano/nve_server/physics/law/tip_sample_law.h"

namespace telenano::fit {

/// What a flat sample and a lever do as the base goes in and out again: the exact law with its memory, at
/// nodes, with cubics between them.
///
/// x is the overlap that there would be without any force, growing towards the sample: x = z_touch − z_base.
/// A node has the force and, from the law's own stiffness S, its slope: at balance F = f(x − cF), so
/// dF/dx = S/(1 + cS). Between two nodes of one stretch a cubic of Hermite; at a leap one stretch ends and
/// the next begins.
struct PathNode {
  double x_nm = 0;
  double force_nn = 0;
  double slope_n_m = 0;
};

struct PathSegment {
  std::vector<PathNode> nodes;      ///< x monotone: growing on the approach, falling on the retract
  std::vector<std::size_t> starts;  ///< of stretches, the first is 0
  std::optional<double> leap_x_nm;  ///< where the largest leap of the force is
  double leap_nn = 0;               ///< its size, positive
  // Where a bridge forms and the tip leaps elsewhere, too, there are two.
  std::optional<double> bridge_x_nm;    ///< where the bridge forms or ruptures
  double bridge_nn = 0;                 ///< how much the force leaps there
  std::optional<double> dry_leap_x_nm;  ///< where the largest leap without that is
  double dry_leap_nn = 0;
  bool good = true;

  /// In the stretch that holds x; beyond the ends, the end's value.
  double force_nn(double x_nm) const noexcept;
};

struct CurvePath {
  PathSegment approach;
  PathSegment retract;
};

/// From `from_nm` (far) to `to_nm` (deep) and back; compliance of the lever along z, nm/nN. Nodes stand so
/// close that the trapezium of the slopes is within `tolerance_nn` from each to the next; the cubic is far
/// better than that.
CurvePath trace_path(const physics::TipSampleLaw& law, double radius_nm, double compliance_nm_nn,
                     double from_nm, double to_nm, double tolerance_nn);

}  // namespace telenano::fit
