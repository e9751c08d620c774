#include "tests/studies/report/figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <map>
#include <string_view>

#include "common/base/error.h"
#include "tests/studies/report/decimate.h"

namespace telenano::studies {
namespace {

// Okabe and Ito's colours: told apart by everybody, also in grey.
constexpr const char* kBlue = "#0072B2";
constexpr const char* kRed = "#D55E00";
constexpr const char* kGreen = "#009E73";
constexpr const char* kPurple = "#AA4488";
constexpr const char* kPale = "#9BB8CC";
constexpr std::array kRunColours{"#0072B2", "#D55E00", "#009E73", "#AA4488", "#B8860B", "#56B4E9", "#555555"};

constexpr std::size_t kStretches = 700;  // of a time series: two points a pixel column

/// The look that all figures share.
constexpr const char* kStyle = R"(set datafile separator ','
set encoding utf8
set border 3 lc rgb '#666666' lw 1
set tics nomirror out scale 0.6 textcolor rgb '#333333'
set grid lc rgb '#E4E4E4' lt 1 lw 1
set key top right Right samplen 1.6 spacing 1.15 noenhanced textcolor rgb '#222222'
set style data lines
set style fill solid 0.5 noborder
set bmargin 0
set tmargin 0
)";

/// A text inside gnuplot's single quotes.
std::string quoted(const std::string& text) {
  std::string result = "'";
  for (const char c : text) {
    if (c == '\'') result += '\'';
    result += c == '\n' ? ' ' : c;
  }
  return result + "'";
}

/// An argument for the shell.
std::string shell_quoted(const std::string& text) {
  std::string result = "'";
  for (const char c : text) result += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return result + "'";
}

std::string slurp(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

std::string curve(const std::string& file, const char* colour, double width, const std::string& title) {
  return fmt::format("'{}' using 1:2 lc rgb '{}' lw {} title {}", file, colour, width, quoted(title));
}

/// One panel of a column of panels that share the time axis.
struct Panel {
  std::string y_label;
  std::vector<std::string> curves;
  std::string settings{};
};

std::string contact_shades(const RunData& run) {
  std::string script;
  for (std::size_t i = 0; i < run.contacts.size(); ++i) {
    const auto [from, to] = run.contacts[i];
    script += fmt::format(
        "set object {} rectangle from {:.6g}, graph 0 to {:.6g}, graph 1 behind fc rgb '#FBEFD9' fs solid 1 "
        "noborder\n",
        i + 1, from, std::max(to, from + 1e-3 * run.time_s.back()));
  }
  return script;
}

/// Panels in a column between the screen positions `left` and `right`, time axis under the lowest.
std::string column_of_panels(const std::vector<Panel>& panels, double left, double right, double end_s,
                             const std::string& title) {
  constexpr double kTop = 0.94;
  constexpr double kBottom = 0.09;
  constexpr double kGap = 0.05;
  const double n = static_cast<double>(panels.size());
  const double height = (kTop - kBottom - kGap * (n - 1)) / n;
  std::string script = fmt::format(
      "set lmargin at screen {}\nset rmargin at screen {}\nset xrange [0:{:.6g}]\n", left, right, end_s);
  for (std::size_t i = 0; i < panels.size(); ++i) {
    const double top = kTop - static_cast<double>(i) * (height + kGap);
    script += fmt::format("set tmargin at screen {:.4f}\nset bmargin at screen {:.4f}\n", top, top - height);
    script += i == 0 && !title.empty()
                  ? fmt::format("set title {} noenhanced offset 0,-0.4 font ',13'\n", quoted(title))
                  : "unset title\n";
    script += i + 1 == panels.size() ? "set format x '%g'\nset xlabel 'time (s)' offset 0,0.3\n"
                                     : "set format x ''\nunset xlabel\n";
    // One curve is named by its axis; several have a legend above the panel, where it hides nothing.
    script += panels[i].curves.size() > 1 ? "set key at graph 1, graph 1.02 bottom right horizontal\n"
                                          : "unset key\n";
    script += fmt::format("set ylabel {} offset 0.5,0\n{}", quoted(panels[i].y_label), panels[i].settings);
    std::string curves;
    for (const std::string& one : panels[i].curves) curves += (curves.empty() ? "" : ", \\\n  ") + one;
    script += "plot " + curves + "\n";
  }
  return script;
}

/// A range for an axis that holds all of the values and a little air, with about four tics. `with_zero` where
/// zero means something.
std::string y_range(std::initializer_list<const std::vector<double>*> all, bool with_zero = true) {
  double low = with_zero ? 0.0 : HUGE_VAL;
  double high = with_zero ? 0.0 : -HUGE_VAL;
  for (const auto* values : all) {
    for (const double value : *values) {
      if (!std::isfinite(value)) continue;
      low = std::min(low, value);
      high = std::max(high, value);
    }
  }
  if (low > high) low = high = 0;
  if (high - low <= 1e-12 * std::max(std::abs(low), std::abs(high))) high = low + 1;
  const double air = 0.06 * (high - low);
  const double raw_step = (high - low) / 4;
  const double decade = std::pow(10.0, std::floor(std::log10(raw_step)));
  const double mantissa = raw_step / decade;
  const double step = decade * (mantissa <= 1 ? 1 : mantissa <= 2 ? 2 : mantissa <= 5 ? 5 : 10);
  return fmt::format("set yrange [{:.6g}:{:.6g}]\nset ytics {:.6g}\n", low - air, high + air, step);
}

}  // namespace

FigureMaker::FigureMaker(std::filesystem::path folder)
    : folder_(std::move(folder)), has_gnuplot_(std::system("gnuplot --version >/dev/null 2>&1") == 0) {
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (error) throw UserError(folder_.string() + ": cannot be created: " + error.message());
}

std::string FigureMaker::write_series(const std::string& name, const char* x_name, const char* y_name,
                                      const std::vector<double>& x, const std::vector<double>& y,
                                      std::size_t stretches) {
  const std::string file = name + ".csv";
  std::ofstream out(folder_ / file);
  out << "# " << x_name << ',' << y_name << '\n';
  for (const Point& point : decimate(x, y, stretches))
    out << fmt::format("{:.7g},{:.7g}\n", point.x, point.y);
  if (!out.flush()) throw RunError((folder_ / file).string() + ": cannot be written");
  return file;
}

void FigureMaker::draw(Figure& figure, int width, int height, const std::string& script) {
  const std::string name = figure.id + ".gp";
  {
    std::ofstream out(folder_ / name);
    out << fmt::format(
        "set terminal svg size {},{} dynamic font 'Helvetica,Arial,sans-serif,12' name '{}' background "
        "'#FFFFFF'\n"
        "set output '{}.svg'\n{}{}",
        width, height, figure.id, figure.id, kStyle, script);
    if (!out.flush()) throw RunError((folder_ / name).string() + ": cannot be written");
  }
  if (!has_gnuplot_) return;
  const std::string command =
      "cd " + shell_quoted(folder_.string()) + " && gnuplot " + shell_quoted(name) + " 1>&2";
  if (std::system(command.c_str()) != 0) throw RunError((folder_ / name).string() + ": gnuplot failed");
  std::string svg = slurp(folder_ / (figure.id + ".svg"));
  // Inside a page there is no prolog.
  const auto begin = svg.find("<svg");
  figure.svg = begin == std::string::npos ? "" : svg.substr(begin);
  static constexpr std::string_view kCanvas =
      "id=\"gnuplot_canvas\"";  // the same in every figure: once a page only
  const auto canvas = figure.svg.find(kCanvas);
  if (canvas != std::string::npos) figure.svg.replace(canvas, kCanvas.size(), "class=\"canvas\"");
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
    return write_series(figure.id + "." + name, "time_s", name, run.time_s, y, kStretches);
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
  panels.push_back({"tip force (nN)",
                    {curve(series("tip_force_nn", run.tip_force_nn), kGreen, 1.4, "on the tip, z")},
                    y_range({&run.tip_force_nn})});
  panels.push_back(
      {"hand force (N)",
       {curve(series("scaled_force_n", run.scaled_force_n), "#BBBBBB", 2.2, "scaled, before control"),
        curve(series("applied_force_n", run.applied_force_n), kRed, 1.2, "applied")},
       y_range({&run.scaled_force_n, &run.applied_force_n})});
  draw(figure, 900, 220 * static_cast<int>(panels.size()),
       contact_shades(run) + "set multiplot\n" +
           column_of_panels(panels, 0.09, 0.98, run.time_s.back(), run.label) + "unset multiplot\n");
  return figure;
}

Figure FigureMaker::force_distance(const RunData& run) {
  Figure figure{
      "distance_" + run.slug, "Force against distance",
      fmt::format("{}: force on the tip against the commanded height (left, what an AFM draws: the jumps are "
                  "snap-in and pull-off) and against the actual height of the apex (right). Repulsion is "
                  "positive; the lowest point of the way back is the pull-off force.",
                  run.label),
      ""};
  const auto write_legs = [&](const char* name, const std::vector<double>& height, bool approach) {
    const std::string file = fmt::format("{}.{}_{}.csv", figure.id, name, approach ? "approach" : "retract");
    std::ofstream out(folder_ / file);
    out << "# " << name << ",tip_force_nn\n";
    const auto count = static_cast<std::size_t>(std::count_if(
        run.legs.begin(), run.legs.end(), [&](const Leg& leg) { return leg.approach == approach; }));
    for (const Leg& leg : run.legs) {
      if (leg.approach != approach) continue;
      const std::vector<double> x(height.begin() + static_cast<std::ptrdiff_t>(leg.begin),
                                  height.begin() + static_cast<std::ptrdiff_t>(leg.end));
      const std::vector<double> y(run.tip_force_nn.begin() + static_cast<std::ptrdiff_t>(leg.begin),
                                  run.tip_force_nn.begin() + static_cast<std::ptrdiff_t>(leg.end));
      // The legs share the budget of points.
      for (const Point& point :
           decimate(x, y, std::max<std::size_t>(1300 / std::max<std::size_t>(count, 1), 40))) {
        out << fmt::format("{:.7g},{:.7g}\n", point.x, point.y);
      }
      out << '\n';  // a blank line lifts the pen
    }
    if (count == 0) out << "nan,nan\n";
    if (!out.flush()) throw RunError((folder_ / file).string() + ": cannot be written");
    return file;
  };
  const std::string above = run.surface_known ? "height above the surface (nm)" : "z (nm)";
  const auto panel = [&](const char* name, const std::vector<double>& height, const std::string& label) {
    return fmt::format("set xlabel {}\nset title {} noenhanced font ',13'\nplot {}, \\\n  {}\n",
                       quoted(above), quoted(label),
                       curve(write_legs(name, height, true), kBlue, 1.6, "approach"),
                       curve(write_legs(name, height, false), kRed, 1.6, "retract"));
  };
  std::string script =
      "set multiplot\nset tmargin at screen 0.90\nset bmargin at screen 0.14\nset xzeroaxis lc rgb "
      "'#999999' lt 1\nset ylabel 'force on the tip (nN)'\n" +
      y_range({&run.tip_force_nn});
  script += "set lmargin at screen 0.09\nset rmargin at screen 0.50\n" +
            panel("target_height_nm", run.target_height_nm, run.label + ": against the commanded height");
  script += "unset ylabel\nset lmargin at screen 0.57\nset rmargin at screen 0.98\n" +
            panel("tip_height_nm", run.tip_height_nm, run.label + ": against the height of the apex");
  if (run.legs.empty()) {
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
          "{}: the ledger of the station's port (what the hand has put in and not got back; below zero "
          "the port would be active), the damping that the passivity controller injects, and the "
          "energy that stays at the tip: adhesion and cantilever while it touches, dissipation "
          "afterwards.",
          run.label),
      ""};
  const auto series = [&](const char* name, const std::vector<double>& y) {
    return write_series(figure.id + "." + name, "time_s", name, run.time_s, y, kStretches);
  };
  const std::vector<Panel> panels{
      {"energy (mJ)",
       {curve(series("energy_mj", run.energy_mj), kBlue, 1.4, "ledger")},
       y_range({&run.energy_mj})},
      {"damper (N s/m)",
       {curve(series("damper_n_s_m", run.damper_n_s_m), kPurple, 1.2, "injected")},
       y_range({&run.damper_n_s_m})},
      {"tip energy (aJ)",
       {curve(series("slave_energy_aj", run.slave_energy_aj), kGreen, 1.4, "in minus out")},
       y_range({&run.slave_energy_aj})}};
  draw(figure, 900, 600,
       contact_shades(run) + "set multiplot\nset xzeroaxis lc rgb '#999999' lt 1\n" +
           column_of_panels(panels, 0.09, 0.98, run.time_s.back(), run.label) + "unset multiplot\n");
  return figure;
}

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
  for (const RunData& run : runs) {
    std::map<int, std::size_t> bins;
    for (const double rtt : run.rtt_us) ++bins[static_cast<int>(std::floor(20 * std::log10(rtt)))];
    const std::string file = "round_trips." + run.slug + ".csv";
    std::ofstream out(folder_ / file);
    out << "# rtt_us_from,fraction\n";
    if (bins.empty()) out << "nan,nan\n";
    if (!bins.empty()) {
      const double floor = 0.5 / static_cast<double>(run.rtt_us.size());  // half a reply stands for none
      for (int bin = bins.begin()->first - 1; bin <= bins.rbegin()->first + 1; ++bin) {
        const auto found = bins.find(bin);
        const double fraction =
            found == bins.end() ? floor
                                : static_cast<double>(found->second) / static_cast<double>(run.rtt_us.size());
        out << fmt::format("{:.6g},{:.6g}\n", std::pow(10.0, bin / 20.0), fraction);
      }
    }
    if (!out.flush()) throw RunError((folder_ / file).string() + ": cannot be written");
    const std::string title = fmt::format("{}: p50 {:.0f} µs, p99 {:.0f} µs", run.label,
                                          run.summary.rtt_us.p50, run.summary.rtt_us.p99);
    curves += fmt::format("{}'{}' using 1:2 with steps lc rgb '{}' lw 1.8 title {}",
                          curves.empty() ? "" : ", \\\n  ", file, kRunColours[colour % kRunColours.size()],
                          quoted(title));
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
  draw(figure, 900, 400,
       fmt::format(
           "set lmargin at screen 0.09\nset rmargin at screen 0.98\nset tmargin at screen 0.96\n"
           "set bmargin at screen 0.14\nset logscale xy\nset format y '10^{{%L}}'\n"
           "set xtics ({})\nset xrange [{:.4g}:{:.4g}]\nset yrange [*:2]\nset xlabel 'round trip (µs)'\n"
           "set ylabel 'fraction of replies'\nplot {}\n",
           tics, 0.7 * least, 1.5 * most, curves));
  return figure;
}

Figure FigureMaker::with_and_without(const RunData& without, const RunData& with) {
  Figure figure{
      "control_" + without.slug + "_" + with.slug, "With and without control",
      fmt::format(
          "The same motion on the same sample at the same scaling; each row shares its scale. Left, {}: the "
          "applied force changes by {:.2g} N a tick (RMS) and the ledger falls to {:.3g} mJ. Right, {}: "
          "{:.2g} N "
          "a tick and {:.3g} mJ at the least; damper or clamp act in {:.0f} % of the ticks.",
          without.label, without.summary.force_step_rms_n, 1e3 * without.summary.energy_least_j, with.label,
          with.summary.force_step_rms_n, 1e3 * with.summary.energy_least_j,
          100 * with.summary.controller_duty),
      ""};
  std::string script = "set multiplot\nset xzeroaxis lc rgb '#999999' lt 1\n";
  double left = 0.085;
  for (const RunData* run : {&without, &with}) {
    const auto series = [&](const char* name, const std::vector<double>& y) {
      return write_series(figure.id + "." + run->slug + "." + name, "time_s", name, run->time_s, y, 450);
    };
    const std::vector<Panel> panels{
        {"hand z (mm)",
         {curve(series("hand_z_mm", run->hand_z_mm), kBlue, 1.2, "hand")},
         y_range({&without.hand_z_mm, &with.hand_z_mm}, false)},
        {"hand force (N)",
         {curve(series("applied_force_n", run->applied_force_n), kRed, 1.0, "applied")},
         y_range({&without.applied_force_n, &with.applied_force_n})},
        {"energy (mJ)",
         {curve(series("energy_mj", run->energy_mj), kGreen, 1.4, "ledger")},
         y_range({&without.energy_mj, &with.energy_mj})},
        {"damper (N s/m)",
         {curve(series("damper_n_s_m", run->damper_n_s_m), kPurple, 1.0, "injected")},
         y_range({&without.damper_n_s_m, &with.damper_n_s_m})}};
    script += column_of_panels(panels, left, left + 0.40, run->time_s.back(), run->label);
    left = 0.58;
  }
  draw(figure, 1000, 820, script + "unset multiplot\n");
  return figure;
}

}  // namespace telenano::studies
