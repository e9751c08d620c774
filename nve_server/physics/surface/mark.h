#pragma once

namespace telenano::physics {

/// An impression that stays.
struct Mark {
  double x_nm = 0;  ///< its deepest point: the foot of the tip
  double y_nm = 0;
  double depth_nm = 0;    ///< by which the surface is lowered there
  double radius_nm = 0;   ///< of the crater's rim
  double conformity = 1;  ///< g = R/R_eff there afterwards (relative_curvature.h)
  /// ε of the material (flow_family.h): around the mark, too, the radius is that which belongs to the depth
  /// to which the surface has been lowered. 0: it goes to the conformity by the share by which the surface
  /// falls.
  double strain = 0;
  /// What stands round the crater, out to twice its rim, of the volume that it has lost.
  double pile_up = 0;
};

}  // namespace telenano::physics
