#include "tests/studies/report/report_command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <memory>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/summary.h"
#include "tests/studies/report/figures.h"
#include "tests/studies/report/page.h"
#include "tests/studies/report/run_data.h"

namespace telenano::studies {
namespace {

/// LABEL=FILE is split at the first '=': a path may hold one, a label may not.
std::pair<std::string, std::filesystem::path> labelled(const char* option, const std::string& text) {
  const auto equals = text.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == text.size()) {
    throw UserError(std::string(option) + " " + text + ": LABEL=FILE is expected");
  }
  return {text.substr(0, equals), text.substr(equals + 1)};
}

/// Labels name files and figures, so two runs may not share one.
void make_slugs_unique(std::vector<RunData>& runs) {
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const std::string wanted = runs[i].slug;
    for (int suffix = 2;; ++suffix) {
      bool taken = false;
      for (std::size_t j = 0; j < i; ++j) taken = taken || runs[j].slug == runs[i].slug;
      if (!taken) break;
      runs[i].slug = wanted + "_" + std::to_string(suffix);
    }
  }
}

}  // namespace

std::string make_report(const ReportRequest& request) {
  if (request.runs.empty() && request.pair.empty())
    throw UserError("report: at least one --run LABEL=FILE is needed");
  if (!request.pair.empty() && request.pair.size() != 2 && request.pair.size() != 3) {
    throw UserError("report: --pair is given two or three times (side by side, without control first), not " +
                    std::to_string(request.pair.size()));
  }
  std::vector<RunData> all;
  for (const auto& [label, file] : request.runs) all.push_back(load_run(label, file));
  std::vector<RunData> pair;
  for (const auto& [label, file] : request.pair) {
    // A recording that is among the runs is summarised there, not twice.
    const auto known =
        std::find_if(all.begin(), all.end(), [&](const RunData& run) { return run.path == file; });
    pair.push_back(known == all.end() ? load_run(label, file) : *known);
    if (known == all.end()) all.push_back(pair.back());
    pair.back().label = label;
    pair.back().slug = slug_of(label);
  }
  make_slugs_unique(all);
  make_slugs_unique(pair);

  FigureMaker maker(request.out / "data");
  std::vector<Figure> figures;
  if (!pair.empty()) figures.push_back(maker.side_by_side(pair));
  if (!request.curve.empty()) figures.push_back(maker.force_curve(load_curve(request.curve)));
  const std::size_t single = request.runs.size();
  for (std::size_t i = 0; i < single; ++i) figures.push_back(maker.position_and_force(all[i]));
  for (std::size_t i = 0; i < single; ++i) {
    if (!all[i].segments.empty()) figures.push_back(maker.force_distance(all[i]));
  }
  for (std::size_t i = 0; i < single; ++i) figures.push_back(maker.energy_and_damper(all[i]));
  figures.push_back(maker.round_trips(all));

  std::string note;
  if (!maker.has_gnuplot()) {
    note =
        "gnuplot is not installed, so there are no figures; the curves are in data/*.csv. Install gnuplot "
        "(Debian: "
        "apt install gnuplot-nox) and run the report again.";
    std::fprintf(stderr, "report: %s\n", note.c_str());
  }
  const std::filesystem::path index = request.out / "index.html";
  std::ofstream out(index);
  out << make_page(request.title, all, figures, note);
  if (!out.flush()) throw RunError(index.string() + ": cannot be written");

  std::string text = request.title + "\n";
  for (const RunData& run : all) text += "\n" + run.label + "\n" + recording::summary_text(run.summary);
  return text + "\nreport: " + index.string() + "\n";
}

void add_report_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand("report", "Summary and figures of recordings, as one HTML page");
  struct Options {
    ReportRequest request;
    std::string out = "report";
    std::vector<std::string> runs;
    std::vector<std::string> pair;
    std::string curve;
  };
  const auto options = std::make_shared<Options>();
  command->add_option("--out", options->out, "output folder for index.html and data/")->capture_default_str();
  command->add_option("--title", options->request.title, "title of the page")->capture_default_str();
  command->add_option("--run", options->runs, "LABEL=FILE of a recording; may be repeated");
  command->add_option(
      "--pair", options->pair,
      "LABEL=FILE of a recording to show side by side with the other --pair ones: two or three, "
      "without control first");
  command->add_option("--curve", options->curve, "CSV of telenano-nve curve");
  command->callback([options] {
    options->request.out = options->out;
    options->request.curve = options->curve;
    for (const std::string& run : options->runs) options->request.runs.push_back(labelled("--run", run));
    for (const std::string& run : options->pair) options->request.pair.push_back(labelled("--pair", run));
    std::fputs(make_report(options->request).c_str(), stdout);
  });
}

}  // namespace telenano::studies
