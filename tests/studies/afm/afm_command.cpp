#include "tests/studies/afm/afm_command.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <cmath>
#include <cstdio>
#include <memory>

#include "telenano/common/base/error.h"
#include "telenano/common/base/version.h"
#include "tests/studies/afm/over_force.h"
#include "tests/studies/afm/touch.h"
#include "tests/studies/report/gnuplot.h"
#include "tests/studies/report/page.h"

namespace telenano::studies {
namespace {

constexpr double kRates[] = {200, 100, 50, 20};
constexpr double kRttMs[] = {0, 20, 50, 100};

std::string slave_name(const TouchConfig& c) {
  return c.afm ? fmt::format("AFM, {:g} Hz", c.force_rate_hz) : "NVE";
}

std::string touch_section(const FigureFolder& folder) {
  std::vector<TouchResult> all;
  for (const double rtt_ms : kRttMs) {
    TouchConfig config;
    config.rtt_s = 1e-3 * rtt_ms;
    config.afm = false;
    all.push_back(run_touch(config));
    config.afm = true;
    for (const double rate : kRates) {
      config.force_rate_hz = rate;
      all.push_back(run_touch(config));
    }
  }
  std::string csv =
      "slave,rtt_ms,shown_n_m,port_n_m,swing_percent,peak_tip_nn,static_tip_nn,age_ms,lag_nm,extracted_mj,"
      "stopped\n";
  std::string body;
  for (const TouchResult& r : all) {
    csv += fmt::format("{},{:g},{:.5g},{:.5g},{:.4g},{:.5g},{:.5g},{:.4g},{:.4g},{:.3g},{:d}\n",
                       r.config.afm ? fmt::format("afm_{:g}hz", r.config.force_rate_hz) : "nve",
                       1e3 * r.config.rtt_s, r.stiffness_n_m, r.port_n_m, 100 * r.swing_part, r.peak_tip_nn,
                       r.static_tip_nn, r.age_ms, r.lag_nm, r.extracted_mj, r.stopped);
    body += fmt::format(
        "<tr><th>{}</th><td>{:g}</td><td>{:.0f}</td><td>{:.0f}</td><td>{:.2g}</td><td>{:.0f}</td><td>{:.0f}</"
        "td>"
        "<td>{:.1f}</td><td>{:.2g}</td><td>{}</td></tr>\n",
        slave_name(r.config), 1e3 * r.config.rtt_s, r.stiffness_n_m, r.port_n_m, 100 * r.swing_part,
        r.peak_tip_nn, r.static_tip_nn, r.age_ms, r.lag_nm, r.stopped ? "yes" : "no");
  }
  folder.write("touch.csv", csv);
  std::fputs(csv.c_str(), stdout);
  return "<h2>Touch on silicon oxide</h2>\n<p>A simulated operator presses at two levels, method model. "
         "Shown: "
         "rise of the force at the hand over its depth, between the levels. Port: the same of the true force "
         "on "
         "the tip over the true base of the lever, at the hand's scale; the virtual environment's coupling "
         "is "
         "made as good as rigid, as an AFM has none. Swing: of the force at the hand over a level. Age: of "
         "the "
         "measured force.</p>\n<div class=\"scroll\"><table>\n<thead><tr><th>slave</th><th>round trip, "
         "ms</th>"
         "<th>shown, N/m</th><th>port, N/m</th><th>swing, %</th><th>peak at the tip, nN</th><th>at rest, "
         "nN</th>"
         "<th>age, ms</th><th>lag, nm RMS</th><th>stopped</th></tr></thead>\n<tbody>\n" +
         body + "</tbody></table></div>\n";
}

std::string task_section(const FigureFolder& folder) {
  std::string html =
      "<h2>The three tasks, beside the virtual environment</h2>\n<p>Round trip 20 ms, method model; left the "
      "virtual environment, then the AFM at 200 and at 20 readings of the force a second.</p>\n";
  std::string summary = "task,slave,peak_tip_nn,lag_nm,age_ms,touched_s,stopped\n";
  for (const device::Task task : {device::Task::kPosition, device::Task::kContact, device::Task::kIndent}) {
    const std::string task_text(device::task_name(task));
    std::string csv = "# time_s,target_nm,tip_nm,tip_nn,hand_mm,hand_n; one block a slave\n";
    std::vector<Panel> heights, forces;
    int block = 0;
    for (const double rate : {0.0, 200.0, 20.0}) {
      TouchConfig config;
      config.presses = false;
      config.task = task;
      config.afm = rate > 0;
      config.force_rate_hz = rate > 0 ? rate : config.force_rate_hz;
      config.rtt_s = 0.02;
      const TouchResult r = run_touch(config);
      for (const auto& row : r.rows)
        csv += fmt::format("{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g}\n", row.time_s, row.target_nm,
                           row.tip_nm, row.force_nn, row.hand_mm, row.hand_n);
      csv += "\n\n";
      summary += fmt::format("{},{},{:.4g},{:.4g},{:.4g},{:.4g},{:d}\n", task_text,
                             config.afm ? fmt::format("afm_{:g}hz", rate) : "nve", r.peak_tip_nn, r.lag_nm,
                             r.age_ms, r.touched_s, r.stopped);
      const std::string file = fmt::format("'task_{}.csv' index {}", task_text, block++);
      heights.push_back({slave_name(config) + ": nm",
                         {fmt::format("{} using 1:2 lc rgb '{}' lw 1 title 'commanded'", file, kPale),
                          fmt::format("{} using 1:3 lc rgb '{}' lw 1.2 title 'tip'", file, kBlue)}});
      forces.push_back(
          {slave_name(config) + ": force",
           {fmt::format("{} using 1:4 lc rgb '{}' lw 1.2 title 'tip, nN'", file, kGreen),
            fmt::format("{} using 1:($6*50) lc rgb '{}' lw 1 title 'hand, N at 50 nN'", file, kRed)}});
    }
    folder.write("task_" + task_text + ".csv", csv);
    Figure figure{"afm_" + task_text, "Task " + task_text, "Heights and forces; time in seconds.", ""};
    std::vector<Panel> panels;
    for (std::size_t i = 0; i < heights.size(); ++i) {
      panels.push_back(heights[i]);
      panels.push_back(forces[i]);
    }
    folder.draw(figure, 1000, 900, "set multiplot\n" + column_of_panels(panels, {}, ""));
    html += figure_html(figure);
  }
  folder.write("tasks.csv", summary);
  std::fputs(summary.c_str(), stdout);
  return html;
}

}  // namespace

void run_afm(const AfmOptions& options) {
  if (!options.only.empty() && options.only != "faults" && options.only != "touch" && options.only != "tasks")
    throw UserError("afm: --only: '" + options.only + "' is unknown; expected faults, touch or tasks");
  const FigureFolder folder(options.out);
  if (!folder.has_gnuplot()) std::fprintf(stderr, "afm: gnuplot is not installed: CSV only, no figures\n");
  std::string html =
      page_begin("An AFM behind the slave's port",
                 fmt::format("commit {}; seed {}; simulated controller", kGitCommit, options.seed));
  const auto wants = [&](const char* part) { return options.only.empty() || options.only == part; };
  if (wants("touch")) {
    std::fprintf(stderr, "afm: touch ...\n");
    html += touch_section(folder);
  }
  if (wants("tasks")) {
    std::fprintf(stderr, "afm: tasks ...\n");
    html += task_section(folder);
  }
  if (wants("faults")) {
    std::fprintf(stderr, "afm: %d faults ...\n", options.trials);
    const afm::AfmConfig config;
    const auto trials = run_fault_trials(config, afm_sim::SimConfig{}, options.trials, options.seed);
    folder.write("faults.csv", fault_csv(trials));
    if (options.only == "faults") std::fputs(fault_csv(trials).c_str(), stdout);
    html += fault_section(trials, config);
  }
  folder.write("index.html", html + page_end());
  std::fprintf(stderr, "afm: %s\n", (options.out / "index.html").c_str());
}

void add_afm_command(CLI::App& app) {
  const auto options = std::make_shared<AfmOptions>();
  CLI::App* const command = app.add_subcommand("afm",
                                               "A simulated AFM as the slave: contact and tasks compared "
                                               "with the virtual environment, and faults during indentation");
  command->add_option("--out", options->out, "output folder for index.html, CSV files and figures")
      ->capture_default_str();
  command->add_option("--trials", options->trials, "number of faults, each at a random moment")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000000));
  command->add_option("--only", options->only, "run only this part: faults, touch or tasks [all]");
  command->add_option("--seed", options->seed, "random seed; the same seed gives the same bits")
      ->capture_default_str();
  command->callback([options] { run_afm(*options); });
}

}  // namespace telenano::studies
