#include <CLI/CLI.hpp>
#include <string>

#include "telenano/common/base/version.h"
#include "telenano/common/config/program.h"
#include "tests/studies/afm/afm_command.h"
#include "tests/studies/bench/bench_command.h"
#include "tests/studies/contact_command.h"
#include "tests/studies/fidelity/fidelity_command.h"
#include "tests/studies/figures/figures_command.h"
#include "tests/studies/flood/flood_command.h"
#include "tests/studies/loop_bench/loop_bench_command.h"
#include "tests/studies/methods/methods_command.h"
#include "tests/studies/precision/precision_command.h"
#include "tests/studies/relay/relay_command.h"
#include "tests/studies/replay/replay_command.h"
#include "tests/studies/report/report_command.h"
#include "tests/studies/session_command.h"
#include "tests/studies/stress/stress_command.h"
#include "tests/studies/zwidth/zwidth_command.h"

// What flags are made of throws for want of memory only. NOLINTNEXTLINE(bugprone-exception-escape)
int main(int argc, char** argv) {
  CLI::App app("Telenano's laboratory: studies and measurements, as CSV and plots", "telenano-lab");
  app.set_version_flag("--version", std::string("telenano-lab ") + telenano::kVersion);
  app.require_subcommand(1);
  int exit_code = 0;
  telenano::studies::add_afm_command(app);
  telenano::studies::add_contact_command(app);
  telenano::studies::add_fidelity_command(app, exit_code);
  telenano::studies::add_figures_command(app);
  telenano::studies::add_flood_command(app);
  CLI::App* bench =
      app.add_subcommand("bench", "Benchmarks: the product and the lower limit of the machine, in one run");
  bench->require_subcommand(1);
  telenano::studies::add_loop_bench(*bench);
  telenano::studies::add_throughput_benches(*bench);
  telenano::studies::add_methods_command(app);
  telenano::studies::add_precision_command(app);
  telenano::studies::add_relay_command(app);
  telenano::studies::add_replay_command(app, exit_code);
  telenano::studies::add_report_command(app);
  telenano::studies::add_session_command(app, exit_code);
  telenano::studies::add_scaling_command(app);
  telenano::studies::add_stress_command(app, exit_code);
  telenano::studies::add_zwidth_command(app);
  return telenano::config::run_program(app, argc, argv, exit_code);
}
