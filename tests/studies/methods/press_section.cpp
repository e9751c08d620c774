#include "tests/studies/methods/press_section.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "telenano/master/station/station.h"
#include "tests/studies/methods/prototype_numbers.h"
#include "tests/studies/report/gnuplot.h"
#include "tests/studies/report/page.h"
#include "tests/studies/zwidth/on_all_cores.h"

namespace telenano::studies {
namespace {

using control::Method;

template <class T>
void push_distinct(std::vector<T>& list, const T& value) {
  if (std::find(list.begin(), list.end(), value) == list.end()) list.push_back(value);
}

const PressResult* find(const std::vector<PressResult>& results, Method method, double rtt_s) {
  for (const PressResult& r : results) {
    if (r.config.method == method && r.config.rtt_s == rtt_s) return &r;
  }
  return nullptr;
}

std::string table(const std::string& head, const std::string& body) {
  return "<div class=\"scroll\"><table>\n<thead><tr>" + head + "</tr></thead>\n<tbody>\n" + body +
         "</tbody></table></div>\n";
}

/// A swing of more than this is no hold: 0.2 mm is 20 encoder steps.
constexpr double kCalmMm = 0.2;

std::string stiffness_cell(const PressResult& r) {
  if (r.stopped_at_s >= 0) {
    return fmt::format("stopped at {:.1f} s: {}", r.stopped_at_s, station::fault_name(r.stop_faults));
  }
  if (r.worst_swing_mm() > kCalmMm) {
    return fmt::format("swings {:.2g} mm, {:.2g} N", r.worst_swing_mm(), r.peak_force_n);
  }
  return fmt::format("{:.0f} ({:.0f})", r.later_stiffness_n_m(), r.first().stiffness_n_m);
}

std::string stiffness_table(const std::vector<PressResult>& results, const std::vector<Method>& methods,
                            const std::vector<double>& rtts) {
  std::string head = "<th>round trip, ms</th>";
  for (const Method m : methods) head += fmt::format("<th>{}</th>", control::method_name(m));
  std::string body;
  for (const double rtt : rtts) {
    body += fmt::format("<tr><th>{:g}</th>", 1e3 * rtt);
    for (const Method m : methods) {
      const PressResult* r = find(results, m, rtt);
      body += "<td>" + (r != nullptr ? html_escaped(stiffness_cell(*r)) : std::string("–")) + "</td>";
    }
    body += "</tr>\n";
  }
  return table(head, body);
}

std::string prototype_table() {
  std::string body;
  for (const PrototypeNumbers& row : kPrototype) {
    body += fmt::format("<tr><th>{:g}</th><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
                        row.rtt_ms, row.none, row.tdpa, row.wave, row.tank, row.model);
  }
  return table("<th>round trip, ms</th><th>none</th><th>tdpa</th><th>wave</th><th>tank</th><th>model</th>",
               body);
}

std::string detail_table(const std::vector<PressResult>& results) {
  std::string body;
  for (const PressResult& r : results) {
    body += fmt::format(
        "<tr><th>{}</th><td>{:g}</td><td>{:.0f}</td><td>{:.0f}</td><td>{:.2f}</td><td>{:.2f}</td><td>{:.2f}"
        "</td><td>{:.2f}</td><td>{:.2f}</td><td>{:.3g}</td><td>{:.3g}</td><td>{:.0f}</td></tr>\n",
        control::method_name(r.config.method), 1e3 * r.config.rtt_s, r.first().stiffness_n_m,
        r.later_stiffness_n_m(), r.peak_force_n, r.over_force, r.force_error_rms_n, r.worst_swing_mm(),
        r.worst_drift_mm(), r.least_energy_mj, r.extracted_mj, 100 * r.duty);
  }
  return table(
      "<th>method</th><th>round trip, ms</th><th>first touch, N/m</th><th>later, N/m</th><th>peak force, "
      "N</th><th>tip over-force</th><th>force error RMS, N</th><th>swing, mm</th><th>drift, mm</th><th>least "
      "net energy, mJ</th><th>extracted, mJ</th><th>control acts, %</th>",
      body);
}

Figure stiffness_figure(const std::vector<PressResult>& results, const std::vector<Method>& methods,
                        const std::vector<double>& rtts, const FigureFolder& folder) {
  // Round trips from 0 to a second: shown evenly, as a category each.
  std::string csv = "# place,rtt_ms,stiffness_n_m; one block a method\n", curves, tics;
  for (std::size_t i = 0; i < rtts.size(); ++i)
    tics += fmt::format("{}'{:g}' {}", i == 0 ? "" : ", ", 1e3 * rtts[i], i);
  double most = results.empty() ? 1 : results.front().config.wall_n_m;
  int block = 0;
  for (const Method m : methods) {
    for (std::size_t i = 0; i < rtts.size(); ++i) {
      const PressResult* r = find(results, m, rtts[i]);
      if (r == nullptr || r->stopped_at_s >= 0 || r->worst_swing_mm() > kCalmMm) continue;
      csv += fmt::format("{},{:g},{:.6g}\n", i, 1e3 * rtts[i], r->later_stiffness_n_m());
      most = std::max(most, r->later_stiffness_n_m());
    }
    csv += "\n\n";
    curves += fmt::format(
        "{}'shown_stiffness_plot.csv' index {} using 1:3 with linespoints pt 7 ps 0.6 lw 2 "
        "lc rgb '{}' title '{}'",
        block == 0 ? "plot " : ", \\\n  ", block, method_colour(m), control::method_name(m));
    ++block;
  }
  folder.write("shown_stiffness_plot.csv", csv);
  Figure figure{"shown_stiffness", "What is shown of the wall",
                "Mean force over mean depth in the last second of the second and third hold. Holds that "
                "swing by more than 0.2 mm, and runs that the station stopped, have no point.",
                ""};
  if (results.empty()) return figure;
  folder.draw(figure, 900, 460,
              fmt::format("set lmargin 10\nset bmargin 4\nset tmargin 2\nset xtics ({})\nset xrange "
                          "[-0.3:{}]\nset yrange [0:{:.6g}]\nset xlabel 'round trip (ms)'\nset ylabel 'shown "
                          "stiffness (N/m)'\nset key outside right top\nset arrow from graph 0, first {:g} "
                          "to graph 1, first {:g} nohead dt "
                          "(4,4) lc rgb '#888888'\n",
                          tics, static_cast<double>(rtts.size()) - 0.7, 1.15 * most,
                          results.front().config.wall_n_m, results.front().config.wall_n_m) +
                  curves + "\n");
  return figure;
}

Figure trace_figure(const std::vector<PressResult>& results, const FigureFolder& folder) {
  std::vector<const PressResult*> traced;
  for (const PressResult& r : results) {
    if (!r.trace.empty()) traced.push_back(&r);
  }
  Figure figure{"press_traces", "The three presses over time", "", ""};
  if (traced.empty()) return figure;
  const RestOnWall rest = rest_on_wall(traced.front()->config);
  figure.caption = fmt::format(
      "Round trip {:g} ms. Depth of the hand beyond the wall and force on it; on the wall itself this hand "
      "rests at {:.2f} mm and {:.2f} N. Beyond 10 N or 20 mm the curves leave the panel.",
      1e3 * traced.front()->config.rtt_s, 1e3 * rest.depth_m, rest.force_n);
  std::string csv = "# time_s,depth_mm,force_n; one block a method\n";
  std::vector<Panel> panels;
  for (std::size_t i = 0; i < traced.size(); ++i) {
    for (const auto& row : traced[i]->trace)
      csv += fmt::format("{:.6g},{:.6g},{:.6g}\n", row.time_s, row.depth_mm, row.force_n);
    csv += "\n\n";
    const auto name = control::method_name(traced[i]->config.method);
    panels.push_back(
        {fmt::format("{}", name),
         {fmt::format("'press_traces.csv' index {} using 1:2 lc rgb '{}' lw 1.2 title 'depth, mm'", i, kBlue),
          fmt::format("'press_traces.csv' index {} using 1:3 lc rgb '{}' lw 1.2 title 'force, N'", i, kRed)},
         i == 0 ? "set yrange [-6:12]\nset ytics 5\n" : "set yrange [-6:12]\nset ytics 5\nunset key\n"});
  }
  folder.write("press_traces.csv", csv);
  folder.draw(figure, 1000, 120 + 150 * static_cast<int>(traced.size()),
              "set multiplot\n" + column_of_panels(panels, {0.07, 0.98, 0.95, 0.06, 0.04, true, "0:24"}, ""));
  return figure;
}

}  // namespace

const char* method_colour(Method method) {
  switch (method) {
    case Method::kNone:
      return kGrey;
    case Method::kKs:
      return kPale;
    case Method::kKsClamp:
      return kBlue;
    case Method::kTdpa:
      return kPurple;
    case Method::kWave:
      return kGreen;
    case Method::kTank:
      return kInk;
    case Method::kModel:
    case Method::kTwin:  // without a twin of the scene, which the wall has not
      return kRed;
  }
  return kInk;
}

std::vector<PressResult> run_presses(const std::vector<Method>& methods, const std::vector<double>& rtt_ms,
                                     double trace_rtt_ms, std::uint64_t seed) {
  std::vector<PressResult> results;
  for (const double rtt : rtt_ms) {
    for (const Method method : methods) {
      PressResult r;
      r.config.method = method;
      r.config.rtt_s = 1e-3 * rtt;
      r.config.seed = seed;
      r.config.trace_every = rtt == trace_rtt_ms ? 8 : 0;
      results.push_back(r);
    }
  }
  on_all_cores(results.size(), [&](std::size_t i) { results[i] = run_press(results[i].config); });
  return results;
}

std::string press_csv(const std::vector<PressResult>& results) {
  std::string csv =
      "method,rtt_ms,wall_n_m,first_stiffness_n_m,later_stiffness_n_m,peak_force_n,tip_over_force,"
      "force_error_rms_n,swing_mm,drift_mm,least_net_energy_mj,extracted_mj,duty,stopped_at_s\n";
  for (const PressResult& r : results) {
    csv += fmt::format(
        "{},{:g},{:g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:g}\n",
        control::method_name(r.config.method), 1e3 * r.config.rtt_s, r.config.wall_n_m,
        r.first().stiffness_n_m, r.later_stiffness_n_m(), r.peak_force_n, r.over_force, r.force_error_rms_n,
        r.worst_swing_mm(), r.worst_drift_mm(), r.least_energy_mj, r.extracted_mj, r.duty, r.stopped_at_s);
  }
  return csv;
}

std::string press_section(const std::vector<PressResult>& results, const FigureFolder& folder) {
  folder.write("shown_stiffness.csv", press_csv(results));
  std::vector<Method> methods;
  std::vector<double> rtts;
  for (const PressResult& r : results) {
    push_distinct(methods, r.config.method);
    push_distinct(rtts, r.config.rtt_s);
  }
  const PressConfig plain;
  std::string html = fmt::format(
      "<h2>What is shown of a wall</h2>\n<p>A simulated operator with a firm hand presses three times "
      "through the whole system on a wall that should feel like {:g} N/m: device b = {:g} N s/m, T = {:g} "
      "ms, "
      "ideal link. Cells: N/m in the second and third hold (in brackets: in the first, before which nothing "
      "is known of the wall).</p>\n",
      plain.wall_n_m, plain.plant.device_damping_n_s_m, 1e3 * plain.plant.period_s);
  html += stiffness_table(results, methods, rtts);
  html +=
      "<p>The numbers to beat, N/m: a prototype of this architecture with the same wall, device and hand "
      "over an ideal channel (not measured by this program).</p>\n" +
      prototype_table();
  html +=
      "<h3>In detail</h3>\n<p>Tip over-force: greatest force at the tip over that of the same hand "
      "pressing on the wall itself. Drift: of the tip's command against the hand, after a release. Least "
      "net energy: of what the hand had put in; extracted: its negative less what the device's damping "
      "certainly took.</p>\n" +
      detail_table(results);
  html += figure_html(stiffness_figure(results, methods, rtts, folder));
  html += figure_html(trace_figure(results, folder));
  return html;
}

}  // namespace telenano::studies
