#include "tests/studies/report/figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>

#include "telenano/common/base/error.h"
#include "tests/studies/report/decimate.h"
#include "tests/studies/report/gnuplot.h"

namespace telenano::studies {
namespace {

constexpr std::size_t kStretches = 700;  // of a time series: two points a pixel column

// Of the range of force in one tick: drawn dashed, since nothing was measured between.
constexpr double kJump = 0.1;

double range_of(const std::vector<double>& values) {
  double low = HUGE_VAL;
  double high = -HUGE_VAL;
  for (const double value : values) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  return std::max(0.0, high - low);
}

/// The heights at which there is a force, and half as much again: far away is only zero.
std::string x_window(const RunData& run, const std::vector<double>& height) {
  double most_force = 0;
  for (const double force : run.tip_force_nn) most_force = std::max(most_force, std::abs(force));
  double low = HUGE_VAL;
  double high = -HUGE_VAL;
  double end = -HUGE_VAL;
  for (const CurveSegment& segment : run.segments) {
    for (std::size_t i = segment.begin; i < segment.end; ++i) {
      if (!std::isfinite(height[i])) continue;
      low = std::min(low, height[i]);
      end = std::max(end, height[i]);
      if (std::abs(run.tip_force_nn[i]) > 0.02 * most_force) high = std::max(high, height[i]);
    }
  }
  if (!(high > low)) return "set xrange [*:*]\n";
  const double air = 0.04 * (high - low);
  return fmt::format("set xrange [{:.4g}:{:.4g}]\n", low - air,
                     std::min(high + 0.5 * (high - low), end + air));
}

std::string whole_range(const RunData& run) {
  return fmt::format("0:{:.6g}", run.time_s.back());
}

}  // namespace

FigureMaker::FigureMaker(std::filesystem::path folder) : folder_(std::move(folder)) {}

std::string FigureMaker::write_pieces(const std::string& name, const std::string& head,
                                      const std::vector<std::vector<Point>>& pieces) {
  const std::string file = name + ".csv";
  std::ofstream out(folder_.path() / file);
  out << "# " << head << '\n';
  for (const std::vector<Point>& piece : pieces) {
    for (const Point& point : piece) out << fmt::format("{:.7g},{:.7g}\n", point.x, point.y);
    out << '\n';
  }
  if (pieces.empty()) out << "nan,nan\n";
  if (!out.flush()) throw RunError((folder_.path() / file).string() + ": cannot be written");
  return file;
}

std::string FigureMaker::write_series(const std::string& name, const RunData& run, const char* y_name,
                                      const std::vector<double>& y, std::size_t stretches) {
  return write_pieces(name, fmt::format("time_s,{}", y_name),
                      decimate_pieces(run.time_s, y, stretches, run.largest_step_s));
}

Figure FigureMaker::position_and_force(const RunData& run) {
  Figure figure{
      "time_" + run.slug, "Position and force against time",
      fmt::format("{}: height of the commanded and of the actual tip{}, force on the tip, and force on the "
                  "hand before and after control. Shaded: the tip touches the sample. Where the two "
                  "heights part, cantilever and coupling bend.",
                  run.label, run.surface_known ? " above the surface" : ""),
      ""};
  const auto series = [&](const char* name, const std::vector<double>& y) {
    return write_series(figure.id + "." + name, run, name, y, kStretches);
  };
  std::vector<std::string> heights{
      curve(series("target_height_nm", run.target_height_nm), kPale, 2.2, "commanded"),
      curve(series("tip_height_nm", run.tip_height_nm), kBlue, 1.4, "tip")};
  const std::string lateral = series("lateral_nm", run.lateral_nm);
  std::vector<Panel> panels;
  panels.push_back({run.surface_known ? "height (nm)" : "z (nm)", heights,
                    y_range({&run.target_height_nm, &run.tip_height_nm}, run.surface_known)});
  if (*std::max_element(run.lateral_nm.begin(), run.lateral_nm.end()) > 1.0) {
    panels.push_back({"lateral (nm)",
                      {curve(lateral, kPurple, 1.4, "in the plane, from the start")},
                      y_range({&run.lateral_nm})});
  }
  const AxisUnit tip_unit = readable({&run.tip_force_nn}, {"nN"}, "pN");
  const AxisUnit hand_unit = readable({&run.scaled_force_n, &run.applied_force_n}, {"N"}, "mN");
  panels.push_back({fmt::format("tip force ({})", tip_unit.name),
                    {curve(series("tip_force_nn", run.tip_force_nn), kGreen, 1.4, "on the tip, z", tip_unit)},
                    y_range({&run.tip_force_nn}, true, tip_unit)});
  panels.push_back(
      {fmt::format("hand force ({})", hand_unit.name),
       {curve(series("scaled_force_n", run.scaled_force_n), kGrey, 2.2, "scaled, before control", hand_unit),
        curve(series("applied_force_n", run.applied_force_n), kRed, 1.2, "applied", hand_unit)},
       y_range({&run.scaled_force_n, &run.applied_force_n}, true, hand_unit)});
  draw(figure, 900, 220 * static_cast<int>(panels.size()),
       contact_shades(run) + "set multiplot\n" +
           column_of_panels(panels, {.x_range = whole_range(run)}, run.label) + "unset multiplot\n");
  return figure;
}

Figure FigureMaker::force_distance(const RunData& run) {
  Figure figure{
      "distance_" + run.slug, "Force against distance",
      fmt::format("{}: force on the tip against the commanded height (left, what an AFM draws: the jumps are "
                  "snap-in and pull-off, dashed where one tick holds them) and against the actual height of "
                  "the apex (right). Repulsion is "
                  "positive; the lowest point of the way back is the pull-off force.",
                  run.label),
      ""};
  const double jump_nn = kJump * range_of(run.tip_force_nn);
  const AxisUnit unit = readable({&run.tip_force_nn}, {"nN"}, "pN");
  const auto write_segments = [&](const char* name, const std::vector<double>& height, bool approach) {
    const auto count = static_cast<std::size_t>(
        std::count_if(run.segments.begin(), run.segments.end(),
                      [&](const CurveSegment& segment) { return segment.approach == approach; }));
    // The segments share the budget of points; the short ones of an oscillation are drawn whole anyway.
    const std::size_t stretches = std::max<std::size_t>(1300 / std::max<std::size_t>(count, 1), 300);
    std::vector<std::vector<Point>> pieces;
    std::vector<std::vector<Point>> leaps;
    for (const CurveSegment& segment : run.segments) {
      if (segment.approach != approach) continue;
      std::size_t begin = segment.begin;
      for (std::size_t i = segment.begin + 1; i <= segment.end; ++i) {
        const bool hole = i < segment.end && run.time_s[i] - run.time_s[i - 1] > run.largest_step_s;
        const bool jump =
            i < segment.end && !hole && std::abs(run.tip_force_nn[i] - run.tip_force_nn[i - 1]) > jump_nn;
        if (jump)
          leaps.push_back({{height[i - 1], run.tip_force_nn[i - 1]}, {height[i], run.tip_force_nn[i]}});
        if (i < segment.end && !hole && !jump) continue;
        const auto part = [&](const std::vector<double>& v) {
          return std::vector<double>(v.begin() + static_cast<std::ptrdiff_t>(begin),
                                     v.begin() + static_cast<std::ptrdiff_t>(i));
        };
        pieces.push_back(decimate(part(height), part(run.tip_force_nn), stretches));
        begin = i;
      }
    }
    const std::string base = fmt::format("{}.{}_{}", figure.id, name, approach ? "approach" : "retract");
    const std::string head = fmt::format("{},tip_force_nn", name);
    const char* const colour = approach ? kBlue : kRed;
    return curve(write_pieces(base, head, pieces), colour, 1.6, approach ? "approach" : "retract", unit) +
           ", \\\n  " + jumps(write_pieces(base + "_jumps", head, leaps), colour, unit);
  };
  const std::string above = run.surface_known ? "height above the surface (nm)" : "z (nm)";
  const auto panel = [&](const char* name, const std::vector<double>& height, const std::string& label) {
    return fmt::format("set xlabel {}\nset title {} noenhanced font ',13'\n{}plot {}, \\\n  {}\n",
                       quoted(above), quoted(label), x_window(run, height),
                       write_segments(name, height, true), write_segments(name, height, false));
  };
  std::string script =
      "set multiplot\nset tmargin at screen 0.90\nset bmargin at screen 0.14\nset xzeroaxis lc rgb "
      "'#999999' lt 1\nset key bottom right\n" +
      fmt::format("set ylabel 'force on the tip ({})'\n", unit.name) +
      y_range({&run.tip_force_nn}, true, unit);
  script += "set lmargin at screen 0.09\nset rmargin at screen 0.50\n" +
            panel("target_height_nm", run.target_height_nm, run.label + ": against the commanded height");
  script += "unset ylabel\nset lmargin at screen 0.57\nset rmargin at screen 0.98\n" +
            panel("tip_height_nm", run.tip_height_nm, run.label + ": against the height of the apex");
  if (run.segments.empty()) {
    script +=
        "set label 1 'no approach and no retract in this run' at screen 0.5, screen 0.5 center\nreplot\n";
  }
  draw(figure, 900, 420, script + "unset multiplot\n");
  return figure;
}

Figure FigureMaker::energy_and_damper(const RunData& run) {
  Figure figure{
      "energy_" + run.slug, "Energy and damper",
      fmt::format(
          "{}: the energy observer of the station's port (what the hand has put in and not got back; below "
          "zero "
          "the port has given more than it got: with ks-clamp at most the allowance and what the device's "
          "own "
          "damping certainly took), the damping that the passivity controller injects (at most {:.3g} N "
          "s/m; rare peaks leave the axis), and the "
          "energy that stays at the tip: adhesion and cantilever while it touches, dissipation "
          "afterwards.",
          run.label, run.summary.damper_max_n_s_m),
      ""};
  const auto series = [&](const char* name, const std::vector<double>& y) {
    return write_series(figure.id + "." + name, run, name, y, kStretches);
  };
  const AxisUnit unit = readable({&run.energy_mj}, {"mJ"}, "µJ");
  const AxisUnit tip_unit = readable({&run.slave_energy_aj}, {"aJ"}, "zJ");
  const std::vector<Panel> panels{
      {fmt::format("energy ({})", unit.name),
       {curve(series("energy_mj", run.energy_mj), kInk, 1.4, "observer", unit)},
       y_range({&run.energy_mj}, true, unit)},
      {"damper (N s/m)",
       {curve(series("damper_n_s_m", run.damper_n_s_m), kPurple, 1.2, "injected")},
       y_range_without_peaks(run.damper_n_s_m)},
      {fmt::format("tip energy ({})", tip_unit.name),
       {curve(series("slave_energy_aj", run.slave_energy_aj), kGreen, 1.4, "in minus out", tip_unit)},
       y_range({&run.slave_energy_aj}, true, tip_unit)}};
  draw(figure, 900, 600,
       contact_shades(run) + "set multiplot\nset xzeroaxis lc rgb '#999999' lt 1\n" +
           column_of_panels(panels, {.x_range = whole_range(run)}, run.label) + "unset multiplot\n");
  return figure;
}

}  // namespace telenano::studies
