#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <map>

#include "telenano/common/base/error.h"
#include "tests/studies/report/figures.h"
#include "tests/studies/report/gnuplot.h"

namespace telenano::studies {
namespace {

constexpr std::array kRunColours{"#0072B2", "#D55E00", "#009E73", "#AA4488", "#B8860B", "#56B4E9", "#555555"};

/// What damper, clamp and limits added to the force, z.
std::vector<double> change_of_force(const RunData& run) {
  std::vector<double> change = run.applied_force_n;
  for (std::size_t i = 0; i < change.size(); ++i) change[i] -= run.scaled_force_n[i];
  return change;
}

std::string stop_mark(const RunData& run) {
  if (run.stopped_s < 0) return "";
  std::string script = fmt::format(
      "set arrow 1 from {:.6g}, graph 0 to {:.6g}, graph 1 nohead lc rgb '#333333' lw 1.4 dt (2,3)\n",
      run.stopped_s, run.stopped_s);
  return script;
}

/// In the top panel only.
std::string stop_label(const RunData& run, double end_s) {
  if (run.stopped_s < 0) return "";
  const bool left = run.stopped_s > 0.6 * end_s;
  return fmt::format(
      "set label 1 'stopped' at {:.6g}, graph 0.93 {} offset {},0 textcolor rgb '#333333' font ',11'\n",
      run.stopped_s, left ? "right" : "left", left ? -0.6 : 0.6);
}

}  // namespace

Figure FigureMaker::round_trips(const std::vector<RunData>& runs) {
  Figure figure{
      "round_trips", "Round trips",
      "Distribution of the round trip of each reply, without the server's hold time; both axes "
      "logarithmic, twenty bins to the decade. The tail to the right is what the operator feels as jitter.",
      ""};
  std::string curves;
  std::size_t colour = 0;
  double least = HUGE_VAL;
  double most = 0;
  std::size_t most_replies = 1;
  for (const RunData& run : runs) {
    std::map<int, std::size_t> bins;
    for (const double rtt : run.rtt_us) ++bins[static_cast<int>(std::floor(20 * std::log10(rtt)))];
    const std::string file = "round_trips." + run.slug + ".csv";
    std::ofstream out(folder_.path() / file);
    out << "# rtt_us_from,fraction\n";
    if (bins.empty()) out << "nan,nan\n";
    if (!bins.empty()) {
      constexpr double floor = 1e-9;  // below the axis: an empty bin shows nothing
      for (int bin = bins.begin()->first - 1; bin <= bins.rbegin()->first + 1; ++bin) {
        const auto found = bins.find(bin);
        const double fraction =
            found == bins.end() ? floor
                                : static_cast<double>(found->second) / static_cast<double>(run.rtt_us.size());
        out << fmt::format("{:.6g},{:.6g}\n", std::pow(10.0, bin / 20.0), fraction);
      }
    }
    if (!out.flush()) throw RunError((folder_.path() / file).string() + ": cannot be written");
    const std::string title = fmt::format("{}: p50 {:.0f} µs, p99 {:.0f} µs", run.label,
                                          run.summary.rtt_us.p50, run.summary.rtt_us.p99);
    curves += fmt::format("{}'{}' using 1:2 with steps lc rgb '{}' lw 1.8 dt {} title {}",
                          curves.empty() ? "" : ", \\\n  ", file, kRunColours[colour % kRunColours.size()],
                          1 + colour / kRunColours.size(), quoted(title));
    most_replies = std::max(most_replies, run.rtt_us.size());
    for (const double rtt : run.rtt_us) {
      least = std::min(least, rtt);
      most = std::max(most, rtt);
    }
    ++colour;
  }
  if (least > most) least = most = 100;
  std::string tics;
  for (double decade = 1; decade < 1e9; decade *= 10) {
    for (const int digit : {1, 2, 5}) tics += fmt::format("{}{:g}", tics.empty() ? "" : ", ", digit * decade);
  }
  // The legend stands under the axis, where it hides nothing, in two columns.
  const int rows = static_cast<int>((runs.size() + 1) / 2);
  const int height = 390 + 20 * rows;
  const double share = 1.0 / height;
  draw(figure, 900, height,
       fmt::format(
           "set lmargin at screen 0.09\nset rmargin at screen 0.98\nset tmargin at screen {:.4f}\n"
           "set bmargin at screen {:.4f}\nset logscale xy\nset format y '10^{{%L}}'\n"
           "set key at screen 0.535, screen {:.4f} top center maxrows {} Left reverse width 1\n"
           "set xtics ({})\nset xrange [{:.4g}:{:.4g}]\nset yrange [{:.4g}:2]\nset xlabel 'round trip (µs)'\n"
           "set ylabel 'fraction of replies'\nplot {}\n",
           1 - 15 * share, (66 + 20 * rows) * share, (10 + 20 * rows) * share, rows, tics, 0.7 * least,
           1.5 * most, 0.5 / static_cast<double>(most_replies), curves));
  return figure;
}

Figure FigureMaker::side_by_side(const std::vector<RunData>& runs) {
  Figure figure{"control", "With and without control", "", ""};
  figure.caption =
      "The same motion on the same sample at the same scaling, and every row on the same axes (Kim and "
      "Sitti's figures "
      "13 and 14). Lowest row: what damper, clamp and force limit changed of the force. Rare peaks of the "
      "damper leave its axis. Shaded: the tip touches the sample. ";
  std::vector<double> hand;
  std::vector<double> force;
  std::vector<double> energy;
  std::vector<double> damper;
  std::vector<double> changed;
  double end_s = 0;
  for (const RunData& run : runs) {
    const auto& s = run.summary;
    figure.caption += fmt::format(
        "{}: the applied force changes by {:.2g} N a tick (RMS), the port energy is {:.4g} mJ at the least, "
        "damper or clamp "
        "act in {:.0f} % of the ticks, the largest damper is {:.4g} N s/m. ",
        run.label, s.force_step_rms_n, 1e3 * s.energy_least_j, 100 * s.controller_duty, s.damper_max_n_s_m);
    const auto join = [](std::vector<double>& all, const std::vector<double>& more) {
      all.insert(all.end(), more.begin(), more.end());
    };
    join(hand, run.hand_z_mm);
    join(force, run.applied_force_n);
    join(energy, run.energy_mj);
    join(damper, run.damper_n_s_m);
    join(changed, change_of_force(run));
    if (run.stopped_s >= 0)
      figure.caption += fmt::format("At its dotted line the station stopped ({}). ", run.stop_reason);
    end_s = std::max(end_s, run.time_s.back());
  }
  std::string script = "set multiplot\nset xzeroaxis lc rgb '#999999' lt 1\n";
  constexpr double kLeft = 0.075;
  constexpr double kGap = 0.025;
  const double n = static_cast<double>(runs.size());
  const double width = (0.985 - kLeft - kGap * (n - 1)) / n;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const RunData& run = runs[i];
    figure.id += "_" + run.slug;
    const auto series = [&](const char* name, const std::vector<double>& y) {
      return write_series("control." + run.slug + "." + name, run, name, y, 240);
    };
    const std::vector<Panel> panels{
        {"hand z (mm)",
         {curve(series("hand_z_mm", run.hand_z_mm), kBlue, 1.0, "hand")},
         y_range({&hand}, false) + stop_label(run, end_s)},
        {"hand force z (N)",
         {curve(series("applied_force_n", run.applied_force_n), kRed, 0.9, "applied")},
         "unset label\n" + y_range({&force})},
        {"port energy (mJ)",
         {curve(series("energy_mj", run.energy_mj), kInk, 1.3, "observer")},
         y_range({&energy})},
        {"damper (N s/m)",
         {curve(series("damper_n_s_m", run.damper_n_s_m), kPurple, 0.9, "injected")},
         y_range_without_peaks(damper)},
        {"control, limits (N)",
         {curve(series("change_n", change_of_force(run)), kPurple, 0.9, "applied less scaled")},
         y_range({&changed})}};
    const double left = kLeft + static_cast<double>(i) * (width + kGap);
    script += "unset object\nunset arrow\nunset label\n" + contact_shades(run) + stop_mark(run) +
              column_of_panels(panels,
                               {.left = left,
                                .right = left + width,
                                .top = 0.955,
                                .bottom = 0.07,
                                .gap = 0.025,
                                .y_labels = i == 0,
                                .x_range = fmt::format("0:{:.6g}", end_s)},
                               run.label);
  }
  draw(figure, 1000, 940, script + "unset multiplot\n");
  return figure;
}

Figure FigureMaker::force_curve(const CurveData& data) {
  Figure figure{"curve", "Force against distance, quasi-static", "", ""};
  figure.caption =
      "Force on the tip against the height of the cantilever's base, there and back: what an AFM draws (Kim "
      "and Sitti's "
      "figure 6). Left: the whole way. Right: around the jumps. Dashed: jumps, from one row to the next. ";
  figure.caption += fmt::format("Pull-off force {:.3g} nN; ", data.pull_off_force_nn);
  if (data.snaps_in) figure.caption += fmt::format("snap-in at {:.3g} nm, ", data.snap_in_base_nm);
  if (data.lets_go) figure.caption += fmt::format("pull-off at {:.3g} nm; ", data.pull_off_base_nm);
  figure.caption += fmt::format("the loop takes {:.3g} aJ of work.", data.loop_work_aj);

  const std::vector<double>& z = data.approach.base_z_nm;
  const auto [z_low, z_high] = std::minmax_element(z.begin(), z.end());
  // The window of the right panel: the jumps and as much again on either side, and forces of the size of the
  // pull-off.
  const double far = data.lets_go ? data.pull_off_base_nm : data.snaps_in ? data.snap_in_base_nm : 0.0;
  const double window = std::max({2.0, 1.5 * std::abs(far)});
  const double zoom_from = std::max(*z_low, -0.6 * window);
  const double zoom_to = std::min(*z_high, far + 0.7 * window);
  const double depth = data.pull_off_force_nn > 0 ? data.pull_off_force_nn : 1.0;
  std::string curves;
  const auto add_way = [&](const CurveWay& way, const char* name, const char* colour) {
    std::vector<std::vector<Point>> pieces(1);
    std::vector<std::vector<Point>> leaps;
    std::size_t next_jump = 0;
    for (std::size_t i = 0; i < way.force_nn.size(); ++i) {
      const Point point{way.base_z_nm[i], way.force_nn[i]};
      pieces.back().push_back(point);
      if (next_jump < way.jumps.size() && way.jumps[next_jump] == i) {
        leaps.push_back({point, {way.base_z_nm[i + 1], way.force_nn[i + 1]}});
        pieces.emplace_back();
        ++next_jump;
      }
    }
    // All rows where the right panel looks, 600 points of each other piece.
    std::vector<std::vector<Point>> thinned;
    for (const std::vector<Point>& piece : pieces) {
      std::vector<double> x;
      std::vector<double> y;
      const auto flush = [&](std::size_t stretches) {
        if (!x.empty()) {
          const std::vector<Point> more = decimate(x, y, stretches);
          thinned.back().insert(thinned.back().end(), more.begin(), more.end());
        }
        x.clear();
        y.clear();
      };
      thinned.emplace_back();
      bool near = false;
      for (const Point& point : piece) {
        const bool now_near = point.x >= zoom_from && point.x <= zoom_to;
        if (now_near != near) flush(near ? 1500 : 300);
        near = now_near;
        x.push_back(point.x);
        y.push_back(point.y);
      }
      flush(near ? 1500 : 300);
    }
    pieces = std::move(thinned);
    const std::string base = std::string("curve.") + name;
    curves += (curves.empty() ? "" : ", \\\n  ") +
              curve(write_pieces(base, "base_z_nm,force_nn", pieces), colour, 1.8, name) + ", \\\n  " +
              jumps(write_pieces(base + "_jumps", "base_z_nm,force_nn", leaps), colour);
  };
  add_way(data.approach, "approach", kBlue);
  add_way(data.retract, "retract", kRed);

  std::string script =
      "set multiplot\nset tmargin at screen 0.91\nset bmargin at screen 0.14\n"
      "set xzeroaxis lc rgb '#777777' lt 1\nset xlabel 'height of the base above the surface (nm)'\n"
      "set key top right\nset lmargin at screen 0.085\nset rmargin at screen 0.49\nset ylabel 'force on the "
      "tip (nN)'\n"
      "set title 'the whole way' font ',13'\n";
  script += fmt::format("set xrange [{:.4g}:{:.4g}]\n", *z_low, *z_high) +
            y_range({&data.approach.force_nn, &data.retract.force_nn}) + "plot " + curves + "\n";
  script +=
      "unset ylabel\nset lmargin at screen 0.575\nset rmargin at screen 0.98\nset title 'around contact' "
      "font ',13'\n";
  script += fmt::format("set xrange [{:.4g}:{:.4g}]\n", zoom_from, zoom_to) + y_range(-depth, 0.8 * depth) +
            "plot " + curves + "\nunset multiplot\n";
  draw(figure, 900, 420, script);
  return figure;
}

}  // namespace telenano::studies
