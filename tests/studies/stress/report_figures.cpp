#include "tests/studies/stress/report_figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <map>

#include "tests/studies/methods/press_section.h"
#include "tests/studies/report/gnuplot.h"
#include "tests/studies/stress/summary.h"

namespace telenano::studies::stress {
namespace {

using control::Method;

std::vector<Method> methods_of(const std::vector<Row>& rows) {
  std::vector<Method> methods;
  for (const Method method : control::kAllMethods) {
    if (std::any_of(rows.begin(), rows.end(), [&](const Row& r) { return r.spec.method == method; }))
      methods.push_back(method);
  }
  return methods;
}

template <class Get>
std::vector<double> values_of(const std::vector<Row>& rows, const Get& get,
                              const std::function<bool(const Row&)>& which) {
  std::vector<double> values;
  for (const Row& row : rows) {
    if (which(row) && std::find(values.begin(), values.end(), get(row)) == values.end())
      values.push_back(get(row));
  }
  std::sort(values.begin(), values.end());
  return values;
}

std::string tics(const std::vector<double>& values, double factor) {
  std::string text;
  for (std::size_t i = 0; i < values.size(); ++i)
    text += fmt::format("{}'{:g}' {}", i == 0 ? "" : ", ", factor * values[i], i);
  return text;
}

bool in_map(const Row& row) {
  return is_plain(row.spec) && (row.spec.scene == SceneKind::kWall || row.spec.scene == SceneKind::kOxide) &&
         (row.spec.hand == HandKind::kPress || row.spec.hand == HandKind::kGreedy ||
          row.spec.hand == HandKind::kPassive);
}

/// Lines of one quantity over places 0, 1, …, one a method.
std::string lines(const std::string& file, const std::vector<Method>& methods, int column) {
  std::string text = "plot ";
  for (std::size_t m = 0; m < methods.size(); ++m)
    text +=
        fmt::format("{}'{}' index {} using 1:{} with linespoints pt 7 ps 0.5 lw 1.8 lc rgb '{}' title '{}'",
                    m == 0 ? "" : ", \\\n  ", file, m, column, method_colour(methods[m]),
                    control::method_name(methods[m]));
  return text + "\n";
}

double ns_a_step(const RunSpec& spec, const Scenes& scenes) {
  double best = 1e300;
  for (int i = 0; i < 3; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    const Outcome outcome = run(spec, scenes);
    const double s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    best = std::min(best, 1e9 * s / static_cast<double>(outcome.ticks));
  }
  return best;
}

}  // namespace

Figure survival_figure(const std::vector<Row>& rows, const FigureFolder& folder) {
  Figure figure{
      "survival", "What goes through: delay against loss",
      "Share of runs (a firm hand's press, a hand that goes with the force, passive arms with resonances of "
      "4 Hz and 300 Hz; a wall and silicon oxide; planned scaling) in which no invariant was "
      "violated, promised or not, and the station did not stop. Loss in bursts of 20 ms in the mean, each "
      "way. Dark: all; pale: none; "
      "the number is the share in percent, a cell without one was not run.",
      ""};
  const std::vector<Method> methods = methods_of(rows);
  auto rtts = values_of(
      rows, [](const Row& r) { return r.spec.rtt_ms; }, in_map);
  const auto losses = values_of(
      rows, [](const Row& r) { return r.spec.loss; }, in_map);
  // A delay of a single run, as the adversaries bring them, is no column of the map.
  std::erase_if(rtts, [&](double rtt_ms) {
    const auto run_here = values_of(
        rows, [](const Row& r) { return r.spec.loss; },
        [&](const Row& r) { return in_map(r) && r.spec.rtt_ms == rtt_ms; });
    return 2 * run_here.size() < losses.size();
  });
  std::string csv = "# rtt place,loss place,survived %; one block a method\n";
  for (const Method method : methods) {
    for (std::size_t y = 0; y < losses.size(); ++y) {
      for (std::size_t x = 0; x < rtts.size(); ++x) {
        std::size_t all = 0, good = 0;
        for (const Row& row : rows) {
          if (row.spec.method != method || !in_map(row) || row.spec.rtt_ms != rtts[x] ||
              row.spec.loss != losses[y])
            continue;
          ++all;
          good += row.outcome.survived();
        }
        if (all > 0)
          csv += fmt::format("{},{},{:.0f}\n", x, y,
                             100.0 * static_cast<double>(good) / static_cast<double>(all));
      }
    }
    csv += "\n\n";
  }
  folder.write("survival.csv", csv);
  if (rtts.empty()) return figure;
  const std::size_t columns = 2, lines_of = (methods.size() + 1) / 2;
  std::string script =
      "set datafile separator ','\nunset key\nunset colorbox\nunset grid\nset palette defined (0 '#FBE3D6', "
      "50 '#F0C9A8', 99 "
      "'#9CC9DE', 100 '#0072B2')\nset cbrange [0:100]\n";
  script += fmt::format("set xrange [-0.5:{}]\nset yrange [-0.5:{}]\nset xtics ({})\nset ytics ({})\n",
                        static_cast<double>(rtts.size()) - 0.5, static_cast<double>(losses.size()) - 0.5,
                        tics(rtts, 1), tics(losses, 100));
  const auto height = static_cast<double>(60 + 240 * lines_of);
  script += fmt::format("set multiplot layout {},{} margins 0.07,0.99,{:.4f},{:.4f} spacing 0.07,{:.4f}\n",
                        lines_of, columns, 50 / height, 1 - 25 / height, 68 / height);
  for (std::size_t m = 0; m < methods.size(); ++m) {
    script += fmt::format("set title '{}' offset 0,-0.6\n", control::method_name(methods[m]));
    script += fmt::format(
        "{}\n", m + columns >= methods.size() ? "set xlabel 'round trip (ms)' offset 0,0.6" : "unset xlabel");
    script += fmt::format("{}\n", m % columns == 0 ? "set ylabel 'loss (%)' offset 0.3,0" : "unset ylabel");
    script += fmt::format(
        "plot 'survival.csv' index {} using 1:2:(0.49):(0.49):3 with boxxyerror fs solid noborder lc "
        "palette, "
        "'' index {} using 1:2:(sprintf('%d',$3)):($3 > 99.5 ? 0xFFFFFF : 0x222222) with labels font ',9' tc "
        "rgb variable\n",
        m, m);
  }
  folder.draw(figure, 900, static_cast<int>(height), script + "unset multiplot\n");
  return figure;
}

Figure round_trip_figure(const std::vector<Row>& rows, const FigureFolder& folder) {
  Figure figure{
      "round_trip", "What is shown over the round trip",
      "First panel: stiffness shown of a wall of 1000 N/m by a firm hand's second and third press "
      "(telenano-lab "
      "methods; holds that swing by more than 0.2 mm have no point). The others, from the table: a firm "
      "hand presses once on a wall that nobody knows (planned scaling, no loss). Shown over local force, "
      "least squares over all "
      "samples in which the wall itself would push; how far the tip's command is at the end from where "
      "the hand left it; the most net energy that the hand had got out (what is below 0.01 mJ is drawn "
      "there). "
      "Runs that were stopped have no point.",
      ""};
  const std::vector<Method> methods = methods_of(rows);
  const auto which = [](const Row& r) {
    return is_plain(r.spec) && r.spec.hand == HandKind::kPress && r.spec.scene == SceneKind::kWall &&
           r.spec.loss == 0;
  };
  const auto rtts = values_of(
      rows, [](const Row& r) { return r.spec.rtt_ms; }, which);
  std::string csv = "# place,rtt_ms,shown_ratio,drift_um,most_got_out_mj; one block a method\n";
  for (const Method method : methods) {
    for (std::size_t i = 0; i < rtts.size(); ++i) {
      for (const Row& row : rows) {
        if (row.spec.method != method || !which(row) || row.spec.rtt_ms != rtts[i] ||
            row.outcome.stopped_s >= 0)
          continue;
        csv += fmt::format("{},{:g},{:.6g},{:.6g},{:.6g}\n", i, rtts[i], row.outcome.shown_ratio,
                           1e3 * std::fabs(row.outcome.drift_mm), std::max(0.01, row.outcome.given_mj));
      }
    }
    csv += "\n\n";
  }
  folder.write("round_trip.csv", csv);
  if (rtts.empty()) return figure;
  std::vector<double> rtts_ms = rtts;
  const std::vector<PressResult> presses = run_presses(methods, rtts_ms, rtts_ms.front(), 1);
  std::string stiffness = "# place,rtt_ms,stiffness_n_m; one block a method\n";
  for (const Method method : methods) {
    for (const PressResult& press : presses) {
      if (press.config.method != method || press.stopped_at_s >= 0 || press.worst_swing_mm() > 0.2) continue;
      const auto place = std::find_if(rtts.begin(), rtts.end(), [&](double rtt_ms) {
        return std::fabs(1e-3 * rtt_ms - press.config.rtt_s) < 1e-9;
      });
      stiffness += fmt::format("{},{:g},{:.6g}\n", place - rtts.begin(), 1e3 * press.config.rtt_s,
                               press.later_stiffness_n_m());
    }
    stiffness += "\n\n";
  }
  folder.write("shown_stiffness.csv", stiffness);
  std::string script = fmt::format(
      "set datafile separator ','\nset xtics ({})\nset xrange [-0.3:{}]\nset multiplot layout 4,1 margins "
      "0.09,0.98,0.06,0.96 spacing 0.05\nset key at graph 1, graph 1.02 bottom right horizontal\nset ylabel "
      "'shown (N/m)' offset 0.5,0\nset yrange [0:*]\n",
      tics(rtts, 1), static_cast<double>(rtts.size()) - 0.7);
  script += lines("shown_stiffness.csv", methods, 3) + "unset key\nset ylabel 'shown / local force'\n" +
            lines("round_trip.csv", methods, 3) + "set ylabel 'drift (µm)'\n" +
            lines("round_trip.csv", methods, 4) +
            "set ylabel 'got out (mJ)'\nset logscale y\nset yrange [0.007:*]\nset xlabel 'round trip (ms)' "
            "offset 0,0.4\n" +
            lines("round_trip.csv", methods, 5);
  folder.draw(figure, 900, 960, script + "unset multiplot\n");
  return figure;
}

Figure error_figure(const std::vector<Row>& rows, const Scenes& scenes, const FigureFolder& folder) {
  Figure figure{
      "force_error", "Force error over rate and over run time",
      "RMS of the force against the same wall felt locally, while it pushes: a firm hand's press, planned "
      "scaling. Left: over the "
      "station's rate, round trip 20 ms. Right: over what a step of the whole loop costs (hand, station, "
      "link, server, slave and "
      "invariants; the quickest of three runs on this machine, beside its other work), 1 kHz, 20 ms; colours "
      "as on the left.",
      ""};
  const std::vector<Method> methods = methods_of(rows);
  const auto which = [](const Row& r) {
    RunSpec s = r.spec;
    s.rate_hz = RunSpec{}.rate_hz;
    return is_plain(s) && s.hand == HandKind::kPress && s.scene == SceneKind::kWall && s.loss == 0 &&
           s.rtt_ms == 20;
  };
  const auto rates = values_of(
      rows, [](const Row& r) { return r.spec.rate_hz; }, which);
  std::string csv = "# place,rate_hz,force_error_n; one block a method\n",
              cost = "# us_per_step,force_error_n; one block a method\n";
  double slowest_ns = 0;
  for (const Method method : methods) {
    for (std::size_t i = 0; i < rates.size(); ++i) {
      for (const Row& row : rows) {
        if (row.spec.method == method && which(row) && row.spec.rate_hz == rates[i])
          csv += fmt::format("{},{:g},{:.6g}\n", i, rates[i], row.outcome.force_error_n);
      }
    }
    RunSpec spec;
    spec.method = method;
    spec.rtt_ms = 20;
    const double ns = ns_a_step(spec, scenes);
    slowest_ns = std::max(slowest_ns, ns);
    cost += fmt::format("{:.4g},{:.6g}\n\n\n", 1e-3 * ns, run(spec, scenes).force_error_n);
    csv += "\n\n";
  }
  folder.write("force_error_rate.csv", csv);
  folder.write("force_error_time.csv", cost);
  std::string script =
      "set datafile separator ','\nset multiplot layout 1,2 margins 0.09,0.98,0.16,0.88 spacing 0.07\nset "
      "logscale y\nset ylabel 'force error RMS (N)' offset 1.5,0\nset key at graph 1, graph 1.02 bottom "
      "right horizontal font ',9'\n";
  if (!rates.empty())
    script += fmt::format("set xtics ({})\nset xrange [-0.3:{}]\nset xlabel 'rate (Hz)' offset 0,0.3\n",
                          tics(rates, 1), static_cast<double>(rates.size()) - 0.7) +
              lines("force_error_rate.csv", methods, 3);
  script += fmt::format(
      "unset key\nunset ylabel\nset xtics auto\nset xrange [0:{:.6g}]\nset xlabel 'run time of a step "
      "(µs)' offset 0,0.3\nplot ",
      1.1e-3 * slowest_ns);
  for (std::size_t m = 0; m < methods.size(); ++m)
    script += fmt::format("{}'force_error_time.csv' index {} using 1:2 with points pt 7 ps 1 lc rgb '{}'",
                          m == 0 ? "" : ", \\\n  ", m, method_colour(methods[m]));
  folder.draw(figure, 900, 380, script + "\nunset multiplot\n");
  return figure;
}

Figure budget_figure(const Scenes& scenes, const FigureFolder& folder) {
  Figure figure{
      "budget", "Energy budget through a burst of loss, and through a server's death",
      "A passive arm (masses and springs without loss, 4 Hz) leans on the wall, four times the planned "
      "scaling, 50 ms round trip. "
      "Above: what it has extracted (true account, the device's certain loss taken off); below zero it has "
      "put "
      "in. Middle: what the method's own account says is owed, and the allowance, which it must not pass. "
      "Below: the force. "
      "Without control the arm is thrown off at the first touch, and the station stops. "
      "Left: everything is lost for 150 ms, shaded. Right: the server dies as the tip touches and is back "
      "after "
      "500 ms, shaded for model (others touch at other moments), as another epoch: the deficit is carried "
      "over, nothing is granted.",
      ""};
  RunSpec burst;
  burst.hand = HandKind::kPassive;
  burst.hand_a = 1;
  burst.hand_b = 4;
  burst.rtt_ms = 50;
  burst.scale = 4;
  burst.seconds = 6;
  burst.outage_ms = 150;
  RunSpec death = burst;
  death.outage_ms = 0;
  death.restart = Restart::kSnapIn;
  death.down_ms = 500;
  constexpr Method kShown[] = {Method::kNone, Method::kTank, Method::kModel};
  std::string panels[3];
  std::string shades[2];
  int column = 0;
  for (const RunSpec& spec : {burst, death}) {
    std::string csv = "# time_s,extracted_mj,owed_mj,force_n; one block a method\n";
    for (const Method method : kShown) {
      RunSpec of = spec;
      of.method = method;
      std::vector<TraceRow> trace;
      RunExtras extras;
      extras.trace = &trace;
      run(of, scenes, extras);
      double from_s = -1;
      int object = 0;
      shades[column].clear();
      for (std::size_t k = 0; k < trace.size(); ++k) {
        const TraceRow& row = trace[k];
        if (k % 4 == 0)
          csv += fmt::format("{:.6g},{:.6g},{:.6g},{:.6g}\n", row.time_s, row.extracted_mj, -row.account_mj,
                             row.force_n);
        if (row.link_down && from_s < 0) from_s = row.time_s;
        if (row.link_down || from_s < 0) continue;
        shades[column] += fmt::format(
            "set object {} rectangle from {:.6g}, graph 0 to {:.6g}, graph 1 behind fc rgb '#FBEFD9' fs "
            "solid 1 noborder\n",
            ++object, from_s, row.time_s);
        from_s = -1;
      }
      csv += "\n\n";
    }
    const std::string file = fmt::format("budget_{}.csv", column);
    folder.write(file, csv);
    const char* const y[] = {"extracted (mJ)", "owed (mJ)", "force (N)"};
    for (int row = 0; row < 3; ++row) {
      panels[row] += fmt::format("unset object\n{}set ylabel '{}' offset 0.5,0\n", shades[column],
                                 column == 0 ? y[row] : "");
      panels[row] += row == 0 ? fmt::format(
                                    "set title '{}' offset 0,0.4\nset key at graph 1, graph 1.0 bottom right "
                                    "horizontal\nset format x ''\nset xrange [0:6.4]\nset yrange [-20:35]\n",
                                    column == 0 ? "a burst of loss" : "the server dies at a touch")
                              : std::string("unset title\nunset key\n");
      if (row == 1) panels[row] += "set yrange [-5:15]\n";
      if (row == 2)
        panels[row] += "set yrange [*:*]\nset format x '%g'\nset xlabel 'time (s)' offset 0,0.4\n";
      panels[row] += "plot ";
      for (int m = row == 1 ? 1 : 0; m < 3; ++m)
        panels[row] += fmt::format("{}'{}' index {} using 1:{} with lines lw 1.5 lc rgb '{}' title '{}'",
                                   panels[row].ends_with("plot ") ? "" : ", ", file, m, row + 2,
                                   method_colour(kShown[m]), control::method_name(kShown[m]));
      if (row == 1) panels[row] += fmt::format(", 10 with lines dt (4,4) lc rgb '{}' notitle", kGrey);
      panels[row] += "\n";
    }
    ++column;
  }
  folder.draw(
      figure, 900, 640,
      "set datafile separator ','\nset multiplot layout 3,2 margins 0.08,0.98,0.08,0.92 spacing 0.08,0.04\n" +
          panels[0] + panels[1] + panels[2] + "unset multiplot\n");
  return figure;
}

}  // namespace telenano::studies::stress
