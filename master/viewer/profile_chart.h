#pragma once

#include "telenano/master/view_model/profile.h"
#include "telenano/master/viewer/charts.h"

namespace telenano::viewer {

/// Height over the way between two places, with distance, height difference and relief in numbers.
void draw_profile(const Gui& gui, const ChartBox& box, const view_model::Profile& profile);

}  // namespace telenano::viewer
