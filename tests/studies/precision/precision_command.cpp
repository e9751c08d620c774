#include "tests/studies/precision/precision_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <memory>
#include <thread>

#include "telenano/common/base/error.h"
#include "telenano/common/base/version.h"
#include "tests/studies/precision/studies.h"
#include "tests/studies/report/page.h"

namespace telenano::studies {
namespace {

struct Part {
  const char* name;
  Section (*run)(const Effort&, const FigureFolder&);
};

/// Adding a part to the page is adding an entry.
constexpr Part kParts[] = {
    {"law", law_section},           {"ground", ground_section}, {"interpolation", interpolation_section},
    {"coupling", coupling_section}, {"probe", probe_section},   {"step", step_section},
    {"wire", wire_section}};

std::string part_names() {
  std::string names;
  for (const Part& part : kParts) names += (names.empty() ? "" : ", ") + std::string(part.name);
  return names;
}

/// "model name" of the processor, and how many the machine has: what the times depend on.
std::string machine() {
  std::ifstream info("/proc/cpuinfo");
  std::string line;
  std::string model = "unknown processor";
  while (std::getline(info, line)) {
    const auto colon = line.find(": ");
    if (line.rfind("model name", 0) != 0 || colon == std::string::npos) continue;
    model = line.substr(colon + 2);
    break;
  }
  return fmt::format("{}, {} cores", model, std::thread::hardware_concurrency());
}

std::string defaults_table(const std::vector<Section>& sections) {
  std::string html =
      "<div class=\"scroll\"><table>\n<thead><tr><th>part</th><th>condition</th><th>default</th><th>largest "
      "error</th><th>ns, p50</th><th>ns, p99</th></tr></thead>\n<tbody>\n";
  for (const Section& section : sections) {
    std::string last;
    for (const Row& row : section.rows) {
      // The finest setting only, where a default has several.
      if (!row.is_default || row.condition == last) continue;
      last = row.condition;
      html += fmt::format(
          "<tr><th>{}</th><td>{}</td><td>{}, {}</td><td>{:.2g}</td><td>{:.3g}</td><td>{:.3g}</td></tr>\n",
          html_escaped(section.title), html_escaped(row.condition), html_escaped(row.family),
          html_escaped(row.setting), row.errors.largest, row.cost.p50_ns, row.cost.p99_ns);
    }
  }
  return html + "</tbody></table></div>\n";
}

std::string page(const std::vector<Section>& sections, bool has_gnuplot, bool quick) {
  std::string html =
      page_begin("Error against run time",
                 fmt::format("{}; commit {}; {} blocks a method, median and 99th percentile of their "
                             "times. Times vary with what else the machine does; errors do not.",
                             machine(), kGitCommit, quick ? "few (quick run)" : "up to 2000"));
  if (!has_gnuplot) {
    html +=
        "<p class=\"note\">gnuplot is not installed, so there are no figures; the numbers are in the CSV "
        "files. Install gnuplot (Debian: apt install gnuplot-nox) and run again.</p>\n";
  }
  html += "<h2>The defaults</h2>\n" + defaults_table(sections);
  for (const Section& section : sections) {
    html += "<h2>" + html_escaped(section.title) + "</h2>\n<p>" + html_escaped(section.lead) +
            "</p>\n<p><b>" + html_escaped(section.choice.substr(0, section.choice.find(". ") + 1)) + "</b>" +
            html_escaped(section.choice.substr(section.choice.find(". ") + 1)) + "</p>\n";
    for (const Figure& figure : section.figures)
      html += "<h3>" + html_escaped(figure.title) + "</h3>\n" + figure_html(figure);
    for (const std::string& table : section.tables) html += table;
    html += fmt::format("<details><summary>All {} rows (data/{}_rows.csv)</summary>\n", section.rows.size(),
                        section.id) +
            rows_table(section.rows) + "</details>\n";
  }
  return html + page_end();
}

}  // namespace

void run_precision(const PrecisionOptions& options) {
  for (const std::string& name : options.only) {
    if (std::none_of(std::begin(kParts), std::end(kParts),
                     [&](const Part& part) { return name == part.name; }))
      throw UserError("precision: --only: '" + name + "' is unknown; expected some of " + part_names());
  }
  const FigureFolder folder(options.out / "data");
  if (!folder.has_gnuplot())
    std::fprintf(stderr, "precision: gnuplot is not installed: CSV only, no figures\n");
  std::vector<Section> sections;
  const auto begin = std::chrono::steady_clock::now();
  for (const Part& part : kParts) {
    if (!options.only.empty() &&
        std::find(options.only.begin(), options.only.end(), part.name) == options.only.end())
      continue;
    std::fprintf(stderr, "precision: %s ...\n", part.name);
    sections.push_back(part.run({options.quick}, folder));
    write_rows(sections.back(), folder);
  }
  const std::filesystem::path index = options.out / "index.html";
  std::ofstream out(index);
  out << page(sections, folder.has_gnuplot(), options.quick);
  if (!out.flush()) throw RunError(index.string() + ": cannot be written");
  std::fprintf(stderr, "precision: done in %.0f s\n",
               std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
  std::printf("precision: %s\n", index.c_str());
}

void add_precision_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "precision", "Compare error and run time of the numerical methods, as one HTML page with CSV");
  const auto options = std::make_shared<PrecisionOptions>();
  command->add_option("--out", options->out, "output folder for index.html and data/")->capture_default_str();
  command->add_flag("--quick", options->quick, "fewer points and repetitions: seconds instead of minutes");
  command->add_option("--only", options->only, "some of: " + part_names())->delimiter(',');
  command->callback([options] { run_precision(*options); });
}

}  // namespace telenano::studies
