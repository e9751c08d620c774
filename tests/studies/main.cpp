#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <string>

#include "common/base/error.h"
#include "common/base/version.h"
#include "tests/studies/contact_command.h"
#include "tests/studies/report/report_command.h"
#include "tests/studies/session_command.h"

int main(int argc, char** argv) {
  CLI::App app("Telenano's laboratory: the evidence, as CSV and plots", "telenano-lab");
  app.set_version_flag("--version", std::string("telenano-lab ") + telenano::kVersion);
  app.require_subcommand(1);
  int exit_code = 0;
  try {
    telenano::studies::add_contact_command(app);
    telenano::studies::add_report_command(app);
    telenano::studies::add_session_command(app, exit_code);
    app.parse(argc, argv);
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    std::fprintf(stderr, "telenano-lab: %s (see telenano-lab --help)\n", error.what());
    return 2;
  } catch (const telenano::UserError& error) {
    std::fprintf(stderr, "telenano-lab: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "telenano-lab: %s\n", error.what());
    return 1;
  }
  return exit_code;
}
