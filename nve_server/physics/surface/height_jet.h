#pragma once

namespace telenano::physics {

/// Value and derivatives of a height field at a point, nm and its powers.
struct HeightJet {
  double z = 0;
  double zx = 0, zy = 0;
  double zxx = 0, zxy = 0, zyy = 0;
};

}  // namespace telenano::physics
