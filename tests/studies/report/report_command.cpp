#include "tests/studies/report/report_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <memory>

#include "common/base/error.h"
#include "common/recording/summary.h"
#include "tests/studies/report/figures.h"
#include "tests/studies/report/page.h"
#include "tests/studies/report/run_data.h"

namespace telenano::studies {
namespace {

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
  if (!request.pair.empty() && request.pair.size() != 2) {
    throw UserError("report: --pair takes two recordings, without control first");
  }
  std::vector<RunData> all;
  for (const auto& [label, file] : request.runs) all.push_back(load_run(label, file));
  for (const auto& [label, file] : request.pair) all.push_back(load_run(label, file));
  make_slugs_unique(all);

  FigureMaker maker(request.out / "data");
  std::vector<Figure> figures;
  const std::size_t single = request.runs.size();
  for (std::size_t i = 0; i < single; ++i) figures.push_back(maker.position_and_force(all[i]));
  for (std::size_t i = 0; i < single; ++i) {
    if (!all[i].legs.empty()) figures.push_back(maker.force_distance(all[i]));
  }
  for (std::size_t i = 0; i < single; ++i) figures.push_back(maker.energy_and_damper(all[i]));
  if (!request.pair.empty()) figures.push_back(maker.with_and_without(all[single], all[single + 1]));
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
  CLI::App* command = app.add_subcommand("report", "Summary and figures of recordings as one HTML page");
  struct Options {
    ReportRequest request;
    std::string out = "report";
    std::vector<std::string> runs;
    std::vector<std::string> pair;
  };
  const auto options = std::make_shared<Options>();
  command->add_option("--out", options->out, "folder to write index.html and data/ into")
      ->capture_default_str();
  command->add_option("--title", options->request.title, "title of the page")->capture_default_str();
  command->add_option("--run", options->runs, "LABEL=FILE of a recording; may be repeated");
  command
      ->add_option("--pair", options->pair, "LABEL=FILE LABEL=FILE: without and with control, side by side")
      ->expected(2);
  command->callback([options] {
    options->request.out = options->out;
    for (const std::string& run : options->runs) options->request.runs.push_back(labelled("--run", run));
    for (const std::string& run : options->pair) options->request.pair.push_back(labelled("--pair", run));
    std::fputs(make_report(options->request).c_str(), stdout);
  });
}

}  // namespace telenano::studies
