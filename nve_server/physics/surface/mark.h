#pragma once

namespace telenano::physics {

/// An impression that stays, in the heights.
struct Mark {
  double x_nm = 0;  ///< its deepest point: the foot of the tip
  double y_nm = 0;
  double depth_nm = 0;   ///< by which the surface is lowered there
  double radius_nm = 0;  ///< of the crater's rim
  /// What stands round the crater, out to twice its rim, of the volume that it has lost.
  double pile_up = 0;
};

}  // namespace telenano::physics
