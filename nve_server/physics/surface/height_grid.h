#pragma once

#include "telenano/common/surface/height_grid.h"

namespace telenano::physics {

using surface::HeightGrid;

}  // namespace telenano::physics
