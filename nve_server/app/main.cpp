#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>

#include "common/base/error.h"
#include "nve_server/app/check_command.h"
#include "nve_server/app/curve_command.h"

int main(int argc, char** argv) {
  CLI::App app("Telenano's nanoscale virtual environment: what the tip feels", "telenano-nve");
  app.set_version_flag("--version", "telenano-nve " TELENANO_VERSION);
  app.require_subcommand(1);
  telenano::app::add_check_command(app);
  telenano::app::add_curve_command(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    app.exit(error);
    return 2;
  } catch (const telenano::UserError& error) {
    std::fprintf(stderr, "telenano-nve: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "telenano-nve: %s\n", error.what());
    return 1;
  }
  return 0;
}
