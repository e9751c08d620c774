#include "telenano/master/view_model/start_plan.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <map>
#include <sstream>

#include "telenano/master/view_model/start_faults.h"

namespace telenano::view_model {
namespace {

constexpr std::size_t kReasonMost = 280;  // characters

std::string newtons(double n) {
  if (!std::isfinite(n)) return "–";
  return std::abs(n) < 0.0995 ? fmt::format("{:.2g} mN", 1e3 * n) : fmt::format("{:.2g} N", n);
}

}  // namespace

StartPlan parse_plan(const std::string& csv) {
  std::map<std::string, std::string> rows;
  std::istringstream lines(csv);
  for (std::string line; std::getline(lines, line);) {
    const auto first = line.find(',');
    const auto last = line.rfind(',');
    if (first == std::string::npos || last <= first) continue;
    rows[line.substr(0, first)] = line.substr(first + 1, last - first - 1);
  }
  const auto number = [&](const char* key) { return std::strtod(rows[key].c_str(), nullptr); };
  StartPlan plan;
  plan.scene = rows["scene"];
  for (int i = 1; rows.contains(fmt::format("scene_{}", i)); ++i)
    plan.scenes.push_back(rows[fmt::format("scene_{}", i)]);
  plan.method = rows["method"];
  plan.round_trip_ms = number("round_trip_median");
  plan.safe = !rows["binding"].empty() && rows["binding"] != "nothing_is_safe";
  plan.felt_per_nn_n = number("felt_per_nanonewton");
  plan.no_forecast = rows["felt_unknown_because"];
  plan.forecast = !rows["felt"].empty() && rows["felt"] != "unknown";
  plan.touches = rows["felt"] == "touch";
  plan.press_depth_nm = number("press_depth");
  plan.felt_press_n = number("felt_press");
  plan.felt_pull_off_n = number("felt_pull_off");
  plan.pull_off_nn = number("pull_off_force");
  return plan;
}

std::vector<std::string> plan_text(const StartPlan& plan, bool shows_force) {
  std::vector<std::string> lines;
  lines.push_back("Scene: " + plan.scene);
  lines.push_back(fmt::format("Round trip {:.3g} ms, method {}", plan.round_trip_ms, plan.method));
  if (!plan.safe) {
    lines.emplace_back("No scale is safe for this link and this hand: telenano-master plan says why");
    return lines;
  }
  lines.push_back(fmt::format("{} at the hand for 1 nN at the tip", newtons(plan.felt_per_nn_n)));
  if (!plan.forecast) {
    lines.push_back("Touch and pull-off are not known before" +
                    (plan.no_forecast.empty() ? "" : ": " + shown_text(plan.no_forecast, kReasonMost)));
  } else if (!plan.touches) {
    lines.emplace_back("The way down from the start meets no sample");
  } else {
    lines.push_back(fmt::format("Pressed {:g} nm by a stiff hand {}; pull-off {}", plan.press_depth_nm,
                                newtons(plan.felt_press_n), newtons(plan.felt_pull_off_n)));
  }
  if (!shows_force) lines.emplace_back("This hand has no motors: forces are seen, not felt");
  return lines;
}

}  // namespace telenano::view_model
