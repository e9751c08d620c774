#include "tests/studies/zwidth/zwidth_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>

#include "tests/studies/parse_list.h"
#include "tests/studies/zwidth/paper_study.h"
#include "tests/studies/zwidth/zwidth_figures.h"
#include "tests/studies/zwidth/zwidth_study.h"

namespace telenano::studies {
namespace {

struct Arguments {
  ZWidthOptions options;
  std::string virtual_damping;
  bool paper = false;
  std::string out = "zwidth-out";
  std::string plot;
};

/// Figures 3 and 4a-d of the paper, and what each factor buys on standard output.
void draw_paper(const std::string& out) {
  run_paper_study(out);
  const FigureFolder folder(out);
  if (!folder.has_gnuplot()) std::fputs("zwidth: gnuplot is not installed: CSV only\n", stderr);
  draw_cb03(folder);
  for (const char part : {'a', 'b', 'c', 'd'}) draw_cb04(part, folder);
  std::fputs(factor_table(factor_gains(read_paper_study(out))).c_str(), stdout);
}

}  // namespace

void add_zwidth_command(CLI::App& app) {
  auto arguments = std::make_shared<Arguments>();
  ZWidthOptions& options = arguments->options;
  CLI::App* command = app.add_subcommand(
      "zwidth",
      "Stiffest passive virtual wall of a haptic display (Colgate & Brown): theory and simulation, as CSV");
  command->add_option("--damping", options.display.damping_n_s_m, "b of the device, N s/m")
      ->capture_default_str();
  command->add_option("--period-s", options.display.period_s, "Sample period T, s")->capture_default_str();
  command->add_option("--mass", options.display.mass_kg, "m of the device, kg")->capture_default_str();
  command->add_option("--virtual-damping", arguments->virtual_damping,
                      "Virtual damping values B of the wall, N s/m, separated by commas; one row each [0]");
  command
      ->add_option("--filter-hz", options.filter_hz,
                   "Cut-off of a first-order filter on the wall's velocity; 0: no filter")
      ->capture_default_str();
  command->add_option("--delay-samples", options.delay_samples, "Delay of the wall's force, samples")
      ->capture_default_str();
  command
      ->add_option("--encoder-counts-per-m", options.encoder_counts_per_m,
                   "Encoder resolution in the simulation; 0: not quantised")
      ->capture_default_str();
  command->add_option("--coulomb-n", options.coulomb_friction_n, "Coulomb friction in the simulation, N")
      ->capture_default_str();
  command
      ->add_option("--outside-damping", options.outside_damping_n_s_m,
                   "Virtual damping outside the wall in the simulation, N s/m; negative values reduce the "
                   "device's own damping")
      ->capture_default_str();
  command->add_flag("--paper", arguments->paper,
                    "Compute the sixteen configurations of the paper instead and write them to --out; "
                    "continues an interrupted run");
  command->add_option("--out", arguments->out, "Output folder for --paper")->capture_default_str();
  command->add_option("--plot", arguments->plot, "FILE.svg: also plot the rows with gnuplot");
  command->footer(
      "Columns, N/m: k_passive: the theorem of Colgate and Brown, evaluated; k_passive_closed: its closed "
      "form; k_coupled:\nsmallest K at which the free device, or a heavy hand with a resonance in (0, "
      "2.5/T], becomes unstable; k_free: the\nfree device alone; k_simulated: simulated one-sided wall with "
      "hands leaning on it (unstable: more than 0.5 mm and\n4 encoder steps peak to peak in the last "
      "second). nan: no K is stable, or there is no closed form.");
  command->callback([arguments, command] {
    if (command->count("--virtual-damping") > 0) {
      arguments->options.virtual_damping_n_s_m =
          parse_list(arguments->virtual_damping, "zwidth: --virtual-damping");
    }
    if (arguments->paper) {
      draw_paper(arguments->out);
    } else if (arguments->plot.empty()) {
      run_zwidth(arguments->options, stdout);
    } else {
      const PlotTarget target = plot_target(arguments->plot, "zwidth");
      draw_zwidth(arguments->options, run_zwidth(arguments->options, stdout), target.id, target.folder);
    }
  });
}

}  // namespace telenano::studies
