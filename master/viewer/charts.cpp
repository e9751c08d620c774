#include "telenano/master/viewer/charts.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "telenano/master/view_model/nice_step.h"
#include "telenano/master/view_model/status_text.h"

namespace telenano::viewer {
namespace {

using view_model::Strip;

constexpr std::array<const char*, 7> kDecades = {"1 µs", "10 µs", "100 µs", "1 ms", "10 ms", "100 ms", "1 s"};

constexpr int kLinesMax = 12;

struct Axis {
  double low = 0;
  double high = 1;
  double step = 1;
  float y(const ChartBox& plot, double value) const {
    const double part = (value - low) / (high - low);
    return plot.to.y - static_cast<float>(part) * (plot.to.y - plot.from.y);
  }
};

Axis axis_of(std::span<const Curve> curves, const ChartScale& scale) {
  double low = 0;
  double high = 0;
  bool any = scale.from_zero;
  for (const Curve& curve : curves) {
    double least = 0;
    double greatest = 0;
    if (!curve.strip.range(least, greatest)) continue;
    low = any ? std::min(low, least) : least;
    high = any ? std::max(high, greatest) : greatest;
    any = true;
  }
  const double middle = 0.5 * (low + high);
  const double half = 0.5 * std::max(high - low, scale.least_span);
  if (high - low < scale.least_span) {
    low = scale.from_zero && low >= 0 ? 0 : middle - half;
    high = low + 2 * half;
  }
  Axis axis;
  axis.step = view_model::nice_step((high - low) / 2);
  axis.low = low - 0.06 * (high - low);
  axis.high = high + 0.06 * (high - low);
  return axis;
}

std::string number(double value, double step) {
  const int digits = std::clamp(static_cast<int>(std::ceil(-std::log10(step) - 1e-9)), 0, 6);
  const double shown = std::abs(value) < 0.5 * std::pow(10.0, -digits) ? 0 : value;  // no "-0.0"
  return fmt::format("{:.{}f}", shown, digits);
}

// Without room for names and units the colours must do; the axes say the rest.
bool is_narrow(const Gui& gui, const ChartBox& box) {
  return box.to.x - box.from.x < 170 * gui.scale();
}

ImVec2 size_of(const Gui& gui, const std::string& text) {
  return gui.small()->CalcTextSizeA(gui.small()->FontSize, 1e9f, 0, text.c_str());
}

// Words that would leave the chart, or lie on others, are left out.
void write(const Gui& gui, const ChartBox& box, ImVec2 at, const palette::Rgb& colour,
           const std::string& text) {
  const ImVec2 size = size_of(gui, text);
  const bool inside = at.x >= box.from.x && at.x + size.x <= box.to.x;
  if (!inside || !gui.words().take_if_free(at, {at.x + size.x, at.y + size.y - 2 * gui.scale()})) return;
  ImGui::GetWindowDrawList()->AddText(gui.small(), gui.small()->FontSize, at, ink(colour), text.c_str());
}

// Border and title; returns where the curves go.
ChartBox begin_chart(const Gui& gui, const ChartBox& box, const char* title, float right_margin) {
  ImDrawList* const list = ImGui::GetWindowDrawList();
  const float s = gui.scale();
  list->AddRectFilled(box.from, box.to, ink(palette::kBackground), 4 * s);
  const float margin = is_narrow(gui, box) ? 4 * s : 8 * s;
  write(gui, box, {box.from.x + margin, box.from.y + 4 * s}, palette::kQuiet, title);
  return {{box.from.x + 40 * s, box.from.y + 40 * s}, {box.to.x - right_margin * s, box.to.y - 10 * s}};
}

void draw_grid(const Gui& gui, const ChartBox& plot, const Axis& axis, bool left,
               const palette::Rgb& colour) {
  ImDrawList* const list = ImGui::GetWindowDrawList();
  const float s = gui.scale();
  const double first = std::ceil(axis.low / axis.step);
  for (int i = 0; i < kLinesMax && (first + i) * axis.step <= axis.high; ++i) {
    const double v = (first + i) * axis.step;
    const float y = axis.y(plot, v);
    const bool zero = std::abs(v) < 1e-6 * axis.step;
    if (left) list->AddLine({plot.from.x, y}, {plot.to.x, y}, ink(palette::kEdge, zero ? 1.0f : 0.55f), s);
    const std::string text = number(v, axis.step);
    const ImVec2 size = size_of(gui, text);
    const float x = left ? plot.from.x - size.x - 5 * s : plot.to.x + 5 * s;
    write(gui, {{plot.from.x - 40 * s, plot.from.y}, {plot.to.x + 40 * s, plot.to.y}}, {x, y - 0.5f * size.y},
          colour, text);
  }
}

// The bins of one column of pixels become one upright stroke from their least to their greatest value, joined
// to the one before; a stretch that runs level is one line. (Where the processor draws, each line counts.)
void draw_curve(const Gui& gui, const ChartBox& plot, const Axis& axis, const Curve& curve) {
  ImDrawList* const list = ImGui::GetWindowDrawList();
  const Strip& strip = curve.strip;
  const auto width = static_cast<double>(plot.to.x - plot.from.x);
  const auto x_of = [&](std::size_t bin) {
    return plot.from.x +
           static_cast<float>(width * static_cast<double>(bin) / static_cast<double>(strip.size()));
  };
  const ImU32 colour = ink(curve.colour);
  const float wide = 1.4f * gui.scale();
  constexpr float kLevel_px = 0.2f;
  bool joined = false;
  ImVec2 before{};   // the last line's end,
  ImVec2 reached{};  // and how far the level stretch goes on from there
  for (std::size_t i = 0; i < strip.size();) {
    const float x = x_of(i);
    Strip::Bin column;
    for (; i < strip.size() && x_of(i) < x + 1; ++i) {
      const Strip::Bin& bin = strip.bin(i);
      if (bin.empty) continue;
      column.least = column.empty ? bin.least : std::min(column.least, bin.least);
      column.greatest = column.empty ? bin.greatest : std::max(column.greatest, bin.greatest);
      column.empty = false;
    }
    if (column.empty) continue;
    const float low = axis.y(plot, column.least);
    const float high = axis.y(plot, column.greatest);
    const ImVec2 middle{x, 0.5f * (low + high)};
    const bool stroke = low - high > wide;
    if (joined && !stroke && std::abs(middle.y - before.y) < kLevel_px) {
      reached = middle;
      continue;
    }
    if (joined) {
      if (reached.x > before.x) list->AddLine(before, reached, colour, wide);
      list->AddLine(reached, middle, colour, wide);
    }
    if (stroke) list->AddLine({x, low}, {x, high}, colour, wide);
    before = reached = middle;
    joined = true;
  }
  if (reached.x > before.x) list->AddLine(before, reached, colour, wide);
}

// Newest values, from the right.
float draw_values(const Gui& gui, const ChartBox& box, const Curve& curve, const char* unit, double step,
                  float right) {
  const Strip::Bin& newest = curve.strip.bin(curve.strip.size() - 1);
  const std::string value = newest.empty ? "–" : number(newest.greatest, step / 10);
  std::string text = value;
  if (!is_narrow(gui, box))
    text = *curve.name == 0 ? fmt::format("{} {}", value, unit) : fmt::format("{} {}", curve.name, value);
  const ImVec2 size = size_of(gui, text);
  const float s = gui.scale();
  write(gui, box, {right - size.x, box.from.y + 20 * s}, curve.colour, text);
  return right - size.x - (is_narrow(gui, box) ? 5 : 10) * s;
}

void draw_limit(const Gui& gui, const ChartBox& plot, const Axis& axis, double limit) {
  if (!(limit > 0)) return;
  const float s = gui.scale();
  for (const double v : {limit, -limit}) {
    if (v <= axis.low || v >= axis.high) continue;
    const float y = axis.y(plot, v);
    for (float x = plot.from.x; x < plot.to.x; x += 8 * s)
      ImGui::GetWindowDrawList()->AddLine({x, y}, {std::min(x + 4 * s, plot.to.x), y},
                                          ink(palette::kAlarm, 0.9f), s);
  }
}

using view_model::ForceCurve;

// Along the bottom border.
struct Span {
  double low = 0;
  double high = 1;
  double step = 1;
  float x(const ChartBox& plot, double value) const {
    return plot.from.x + static_cast<float>((value - low) / (high - low)) * (plot.to.x - plot.from.x);
  }
};

double spread(double& low, double& high, double least) {
  const double lack = std::max(least - (high - low), 0.0);
  low -= 0.5 * lack;
  high += 0.5 * lack;
  const double step = view_model::nice_step((high - low) / 2);
  const double margin = 0.06 * (high - low);
  low -= margin;
  high += margin;
  return step;
}

constexpr double kFarther = 1.5;      // times the reach of the touch, of distances without force
constexpr double kLeastReach_nm = 1;  // of both axes
constexpr double kLeastForce_nn = 0.5;

// Both axes of what is drawn. Far out there is nothing to see: an approach from 500 nm would leave a needle
// of the touch. From the contact on up it is shown as far as the sample is felt, and half as far again.
void axes_of(const ForceCurve& curve, Span& span, Axis& axis) {
  double deepest = 0;
  double most = 0;
  double least_nn = 0;
  double most_nn = 0;
  const double seen_nn = std::max(ForceCurve::kSigmas * curve.noise_nn(), ForceCurve::kLeast_nn);
  for (const ForceCurve::Segment* segment : {&curve.approach(), &curve.retract()}) {
    for (const ForceCurve::Point& p : segment->points) {
      deepest = std::min(deepest, p.distance_nm);
      if (std::abs(p.force_nn) > seen_nn) most = std::max(most, p.distance_nm);
      least_nn = std::min(least_nn, p.force_nn);
      most_nn = std::max(most_nn, p.force_nn);
    }
    for (const auto& pull : {curve.snap_in(), curve.pull_off()}) {
      if (pull && pull->leapt) most = std::max({most, pull->leap_from_nm, pull->leap_to_nm});
    }
  }
  span.low = deepest;
  span.high = kFarther * std::max(most, kLeastReach_nm);
  span.step = spread(span.low, span.high, kLeastReach_nm);
  axis.low = least_nn;
  axis.high = most_nn;
  axis.step = spread(axis.low, axis.high, kLeastForce_nn);
}

void draw_distances(const Gui& gui, const ChartBox& plot, const ChartBox& box, const Span& span) {
  const float s = gui.scale();
  const double first = std::ceil(span.low / span.step);
  for (int i = 0; i < kLinesMax && (first + i) * span.step <= span.high; ++i) {
    const double v = (first + i) * span.step;
    const float x = span.x(plot, v);
    const bool zero = std::abs(v) < 1e-6 * span.step;
    ImGui::GetWindowDrawList()->AddLine({x, plot.from.y}, {x, plot.to.y},
                                        ink(palette::kEdge, zero ? 1.0f : 0.55f), s);
    const std::string text = number(v, span.step);
    write(gui, box, {x - 0.5f * size_of(gui, text).x, plot.to.y + s}, palette::kQuiet, text);
  }
}

void draw_segment(const Gui& gui, const ChartBox& plot, const Span& span, const Axis& axis,
                  const ForceCurve::Segment& segment, const palette::Rgb& colour) {
  ImDrawList* const list = ImGui::GetWindowDrawList();
  const float least_px = 0.7f * gui.scale();
  bool any = false;
  ImVec2 before{};
  for (const ForceCurve::Point& p : segment.points) {
    if (p.distance_nm > span.high + kFarther * (span.high - span.low)) continue;
    const ImVec2 at{span.x(plot, p.distance_nm), axis.y(plot, p.force_nn)};
    // Points within a pixel are one.
    if (any && std::abs(at.x - before.x) < least_px && std::abs(at.y - before.y) < least_px) continue;
    if (any) list->AddLine(before, at, ink(colour), 1.4f * gui.scale());
    before = at;
    any = true;
  }
}

void draw_pull(const Gui& gui, const ChartBox& plot, const Span& span, const Axis& axis,
               const std::optional<ForceCurve::Pull>& pull, const palette::Rgb& colour) {
  if (!pull) return;
  const ImVec2 at{span.x(plot, pull->distance_nm), axis.y(plot, pull->force_nn)};
  ImGui::GetWindowDrawList()->AddCircle(at, 4 * gui.scale(), ink(colour), 0, 1.6f * gui.scale());
}

std::string pull_text(const std::optional<ForceCurve::Pull>& pull, bool snap_in) {
  if (!pull) return "–";
  // Where it caught the tip, and where it let go.
  const double at_nm = snap_in && pull->leapt ? pull->leap_from_nm : pull->distance_nm;
  return fmt::format("{:.2f} nN at {:.2f} nm", pull->force_nn, at_nm);
}

}  // namespace

void draw_force_curve(const Gui& gui, const ChartBox& box, const ForceCurve& curve) {
  const float s = gui.scale();
  const bool numbers = box.to.x - box.from.x >= 330 * s;
  const float column = numbers ? 172 : 10;
  const bool narrow = is_narrow(gui, box);
  ChartBox plot = begin_chart(gui, box, narrow ? "Force, distance" : "Force [nN] over distance [nm]", column);
  plot.from.y = box.from.y + 24 * s;
  plot.to.y -= 8 * s;
  Span span;
  Axis axis;
  axes_of(curve, span, axis);
  draw_distances(gui, plot, box, span);
  draw_grid(gui, plot, axis, true, palette::kQuiet);
  ImGui::PushClipRect(plot.from, plot.to, true);
  draw_segment(gui, plot, span, axis, curve.approach(), palette::kFree);
  draw_segment(gui, plot, span, axis, curve.retract(), palette::kWarning);
  draw_pull(gui, plot, span, axis, curve.snap_in(), palette::kFree);
  draw_pull(gui, plot, span, axis, curve.pull_off(), palette::kWarning);
  ImGui::PopClipRect();
  if (!numbers) {  // the number that is asked for most, by its mark
    if (const auto out = curve.pull_off()) {
      const ImVec2 at{span.x(plot, out->distance_nm), axis.y(plot, out->force_nn)};
      write(gui, box, {at.x + 8 * s, at.y - 0.5f * gui.small()->FontSize}, palette::kWarning,
            fmt::format("{:.1f} nN", out->force_nn));
    }
    return;
  }
  const float x = plot.to.x + 12 * s;
  float y = plot.from.y - 2 * s;
  const float line = gui.small()->FontSize + s;
  const auto row = [&](const palette::Rgb& colour, const std::string& text) {
    if (y + line > box.to.y) return;
    write(gui, box, {x, y}, colour, text);
    y += line;
  };
  if (curve.approach().state == ForceCurve::State::kNone) {
    row(palette::kQuiet, "no touch yet");
    return;
  }
  const auto in = curve.snap_in();
  row(palette::kFree, in && in->leapt ? "approach: snap-in" : "approach: most pull");
  row(palette::kFree, pull_text(in, true));
  const ForceCurve::State state = curve.retract().state;
  row(palette::kWarning, state == ForceCurve::State::kCutOff     ? "retract: cut off"
                         : state == ForceCurve::State::kUnderWay ? "retract: under way"
                         : state == ForceCurve::State::kNone     ? "retract: to come"
                                                                 : "retract: pull-off");
  row(palette::kWarning, pull_text(curve.pull_off(), false));
  const std::optional<double> lost = curve.hysteresis_aj();
  row(palette::kText, lost ? "lost " + number(*lost, 0.1) + " aJ" : "lost –");
  row(palette::kText, fmt::format("lateral ≤ {:.2f} nN", std::max(curve.approach().lateral_most_nn(),
                                                                  curve.retract().lateral_most_nn())));
}

void draw_strip_chart(const Gui& gui, const ChartBox& box, const char* title, std::span<const Curve> curves,
                      const ChartScale& scale) {
  const std::string heading = fmt::format("{}  [{}]", title, scale.unit);
  const ChartBox plot = begin_chart(gui, box, heading.c_str(), 10);
  const Axis axis = axis_of(curves, scale);
  draw_grid(gui, plot, axis, true, palette::kQuiet);
  ImGui::PushClipRect(plot.from, plot.to, true);
  draw_limit(gui, plot, axis, scale.limit);
  for (const Curve& curve : curves) draw_curve(gui, plot, axis, curve);
  ImGui::PopClipRect();
  float right = box.to.x - 8 * gui.scale();
  for (std::size_t i = curves.size(); i-- > 0;)
    right = draw_values(gui, box, curves[i], scale.unit, axis.step, right);
}

void draw_two_scales(const Gui& gui, const ChartBox& box, const char* title, const Curve& left,
                     const ChartScale& left_scale, const Curve& right, const ChartScale& right_scale) {
  const ChartBox plot = begin_chart(gui, box, title, 40);
  const Axis left_axis = axis_of({&left, 1}, left_scale);
  const Axis right_axis = axis_of({&right, 1}, right_scale);
  draw_grid(gui, plot, left_axis, true, left.colour);
  draw_grid(gui, plot, right_axis, false, right.colour);
  ImGui::PushClipRect(plot.from, plot.to, true);
  draw_limit(gui, plot, left_axis, left_scale.limit);
  draw_curve(gui, plot, right_axis, right);
  draw_curve(gui, plot, left_axis, left);
  ImGui::PopClipRect();
  float at = box.to.x - 8 * gui.scale();
  at = draw_values(gui, box, right, right_scale.unit, right_axis.step, at);
  draw_values(gui, box, left, left_scale.unit, left_axis.step, at);
}

void draw_round_trips(const Gui& gui, const ChartBox& box, const view_model::RoundTrips& trips) {
  using view_model::RoundTrips;
  const ChartBox plot = begin_chart(gui, box, "Round trip", 10);
  ImDrawList* const list = ImGui::GetWindowDrawList();
  const float s = gui.scale();
  const bool narrow = is_narrow(gui, box);
  const ChartBox bars{{box.from.x + 10 * s, plot.from.y + (narrow ? 12 * s : 0)},
                      {plot.to.x, plot.to.y - 10 * s}};
  // Only the decades that there are, and one bin to either side.
  int first = RoundTrips::kBins;
  int last = -1;
  int tallest = 1;
  for (int bin = 0; bin < RoundTrips::kBins; ++bin) {
    const int count = trips.counts()[static_cast<std::size_t>(bin)];
    if (count == 0) continue;
    first = std::min(first, bin);
    last = bin;
    tallest = std::max(tallest, count);
  }
  if (last < 0) return;
  first = std::max(first / 10 * 10, 0);
  last = std::min(last / 10 * 10 + 9, RoundTrips::kBins - 1);
  const float wide = (bars.to.x - bars.from.x) / static_cast<float>(last - first + 1);
  // The height goes with the logarithm of the count: single late replies are seen.
  const double top = std::log1p(tallest);
  for (int bin = first; bin <= last; ++bin) {
    const int count = trips.counts()[static_cast<std::size_t>(bin)];
    const float x = bars.from.x + wide * static_cast<float>(bin - first);
    if (bin % 10 == 0) {
      list->AddLine({x, bars.from.y}, {x, bars.to.y}, ink(palette::kEdge, 0.55f), s);
      write(gui, box, {x, bars.to.y + s}, palette::kQuiet, kDecades[static_cast<std::size_t>(bin / 10)]);
    }
    if (count == 0) continue;
    const auto part = static_cast<float>(std::log1p(count) / top);
    list->AddRectFilled({x + 0.5f, bars.to.y - part * (bars.to.y - bars.from.y)},
                        {std::max(x + wide - 0.5f, x + 1.5f), bars.to.y}, ink(palette::kTarget, 0.85f));
  }
  const std::string half = "p50 " + view_model::time_text(trips.percentile_us(0.5));
  const std::string most = "p99 " + view_model::time_text(trips.percentile_us(0.99));
  const auto right = [&](const std::string& text, float y) {
    const float margin = narrow ? 4 * s : 8 * s;
    write(gui, box, {box.to.x - margin - size_of(gui, text).x, box.from.y + y * s}, palette::kTarget, text);
  };
  if (narrow) {
    right(half, 18);
    right(most, 31);
  } else {
    right(half + "   " + most, 20);
  }
}

}  // namespace telenano::viewer
