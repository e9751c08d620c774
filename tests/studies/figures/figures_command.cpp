#include "tests/studies/figures/figures_command.h"

#include <CLI/CLI.hpp>
#include <memory>
#include <string>
#include <vector>

#include "tests/studies/figures/named_figures.h"

namespace telenano::studies {

void add_figures_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "figures", "Reproduce the figures of the source papers as CSV, SVG and one HTML page");
  struct Options {
    std::string out = "figures";
    std::vector<std::string> only;
  };
  const auto options = std::make_shared<Options>();
  std::string names;
  for (const NamedFigure& figure : named_figures())
    names += (names.empty() ? "" : ", ") + std::string(figure.name);
  command->add_option("--out", options->out, "output folder")->capture_default_str();
  command->add_option("--only", options->only, "some of: " + names)->delimiter(',');
  command->callback([options] { draw_figures(options->only, options->out); });
}

}  // namespace telenano::studies
