// `serve` with a slave that can be computed by hand, for testing the command from outside.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "spring_slave.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/app/serve/serve_command.h"

int main(int argc, char** argv) {
  CLI::App app("serves an elastic floor");
  int exit_code = 2;
  telenano::app::add_serve_command(
      app, [](const std::string&, const std::string&) { return telenano::server::spring_scene(); },
      exit_code);
  app.require_subcommand(1);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  } catch (const telenano::UserError& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 2;
  }
  return exit_code;
}
