#pragma once

#include <imgui.h>

#include <span>

#include "telenano/master/view_model/force_curve.h"
#include "telenano/master/view_model/round_trips.h"
#include "telenano/master/view_model/strip.h"
#include "telenano/master/viewer/gui.h"

namespace telenano::viewer {

/// One line of a strip chart.
struct Curve {
  const view_model::Strip& strip;
  const char* name;
  palette::Rgb colour;
};

struct ChartBox {
  ImVec2 from;
  ImVec2 to;
};

struct ChartScale {
  const char* unit = "";
  double least_span = 1;   ///< the axis never shows less than this
  bool from_zero = false;  ///< zero is in the picture
  double limit = 0;        ///< a dashed line at ± this, when it is in the picture; 0 = none
};

/// Name, newest value and unit above; least and greatest of each bin as one upright stroke; zero and round
/// numbers as lines.
void draw_strip_chart(const Gui& gui, const ChartBox& box, const char* title, std::span<const Curve> curves,
                      const ChartScale& scale);

/// Two quantities with scales of their own: `left` at the left border, `right` at the right one.
void draw_two_scales(const Gui& gui, const ChartBox& box, const char* title, const Curve& left,
                     const ChartScale& left_scale, const Curve& right, const ChartScale& right_scale);

/// Force over distance of the last touch, with the places of most pull marked, and beside it in numbers what
/// was found. In a narrow box the curve alone.
void draw_force_curve(const Gui& gui, const ChartBox& box, const view_model::ForceCurve& curve);

void draw_round_trips(const Gui& gui, const ChartBox& box, const view_model::RoundTrips& round_trips);

}  // namespace telenano::viewer
