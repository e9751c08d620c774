#include <CLI/CLI.hpp>
#include <string>

#include "telenano/common/base/version.h"
#include "telenano/common/config/program.h"
#include "telenano/master/app/devices/calibrate_command.h"
#include "telenano/master/app/devices/devices_command.h"
#include "telenano/master/app/enroll_command.h"
#include "telenano/master/app/plan/plan_command.h"
#include "telenano/master/app/recordings/export_command.h"
#include "telenano/master/app/recordings/recover_command.h"
#include "telenano/master/app/run/run_command.h"
#include "telenano/master/app/start/start_command.h"
#include "telenano/master/app/view/view_command.h"

// What flags are made of throws for want of memory only. NOLINTNEXTLINE(bugprone-exception-escape)
int main(int argc, char** argv) {
  CLI::App app("Telenano's master station: the hand's side of a session", "telenano-master");
  app.set_version_flag("--version", std::string("telenano-master ") + telenano::kVersion);
  app.require_subcommand(1);
  std::string command_line = "telenano-master";
  for (int i = 1; i < argc; ++i) command_line += std::string(" ") + argv[i];
  int exit_code = 0;
  telenano::app::add_start_command(app, exit_code);
  telenano::app::add_run_command(app, command_line, exit_code);
  telenano::app::add_replay_command(app, command_line, exit_code);
  telenano::app::add_view_command(app);
  telenano::app::add_plan_command(app);
  telenano::app::add_devices_command(app);
  telenano::app::add_calibrate_command(app);
  telenano::app::add_enroll_command(app);
  telenano::app::add_recover_command(app);
  telenano::app::add_export_command(app);
  return telenano::config::run_program(app, argc, argv, exit_code);
}
