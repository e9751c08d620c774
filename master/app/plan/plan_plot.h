#pragma once

#include <string>

#include "telenano/common/control/scaling_plan.h"

namespace telenano::app {

/// KS fig. 12 for this station: the region of the force scale over the velocity scale, as published, exact
/// and with the delay, the device's limit, KS's two cases, and what is recommended. `title`: of whom. Draws
/// into `file` (.svg or .png), see plot::draw().
void draw_plan(const control::ScalingPlanInput& input, const control::ScalingPlan& plan,
               const std::string& title, const std::string& file);

}  // namespace telenano::app
