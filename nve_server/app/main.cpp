#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <memory>
#include <string>
#include <vector>

#include "common/base/error.h"
#include "common/base/version.h"
#include "common/config/usage_error.h"
#include "nve_server/app/check_command.h"
#include "nve_server/app/curve_command.h"
#include "nve_server/app/serve_command.h"
#include "nve_server/scene/scene.h"
#include "nve_server/slave/nve_slave.h"

namespace {

telenano::server::ServedScene serve_scene(const std::string& path) {
  const auto scene = telenano::scene::load_scene(path);
  telenano::server::ServedScene served;
  served.name = telenano::server::scene_name(scene->name);
  served.hash = scene->hash;
  served.timeout_ms = scene->session_timeout_ms;
  served.make_slave = [scene] { return std::make_unique<telenano::slave::NveSlave>(scene); };
  return served;
}

// What the parser could not make out, in one line.
std::string explain(const CLI::App& app, const CLI::ParseError& error, const std::vector<std::string>& arguments) {
  std::vector<std::string> commands;
  std::vector<std::string> flags{"--help", "--version"};
  for (const CLI::App* command : app.get_subcommands({})) {
    commands.push_back(command->get_name());
    if (arguments.empty() || arguments[0] != command->get_name()) continue;
    for (const CLI::Option* option : command->get_options()) {
      for (const std::string& name : option->get_lnames()) flags.push_back("--" + name);
    }
  }
  return telenano::config::usage_error(app.get_name(), error.what(), arguments, commands, flags);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Telenano's nanoscale virtual environment: what the tip feels", "telenano-nve");
  app.set_version_flag("--version", std::string("telenano-nve ") + telenano::kVersion);
  app.require_subcommand(1);
  int exit_code = 0;
  try {
    telenano::app::add_serve_command(app, serve_scene, exit_code);
    telenano::app::add_curve_command(app);
    telenano::app::add_check_command(app);
    app.parse(argc, argv);
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    std::fprintf(stderr, "%s\n", explain(app, error, {argv + 1, argv + argc}).c_str());
    return 2;
  } catch (const telenano::UserError& error) {
    std::fprintf(stderr, "telenano-nve: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "telenano-nve: %s\n", error.what());
    return 1;
  }
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {  // half a table must not pass for a whole one
    std::fprintf(stderr, "telenano-nve: cannot write to standard output\n");
    return 1;
  }
  return exit_code;
}
