#pragma once

#include <string>
#include <vector>

namespace telenano::view_model {

/// What is known of a session before it begins, as `telenano-master plan --felt` says it.
struct StartPlan {
  std::string scene;
  std::vector<std::string> scenes;  ///< of a server with several, the first one first
  std::string method;
  double round_trip_ms = 0;
  bool safe = false;         ///< there is a scale that this device can show passively
  double felt_per_nn_n = 0;  ///< newtons at the hand for a nanonewton at the tip
  std::string no_forecast;   ///< why what follows is not known
  bool forecast = false;     ///< it is known
  bool touches = false;
  double press_depth_nm = 0;
  double felt_press_n = 0;
  double felt_pull_off_n = 0;
  double pull_off_nn = 0;
};

/// From the plan's table (key,value,unit). Rows that are missing keep their defaults.
StartPlan parse_plan(const std::string& csv);

/// For a person, a line each. `shows_force`: the chosen device has motors.
std::vector<std::string> plan_text(const StartPlan& plan, bool shows_force);

}  // namespace telenano::view_model
