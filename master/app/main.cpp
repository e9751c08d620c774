#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "common/base/error.h"
#include "common/base/version.h"
#include "common/config/usage_error.h"
#include "master/app/recover_command.h"
#include "master/app/run_command.h"

namespace {

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
  CLI::App app("Telenano's master station: the hand's side of a session", "telenano-master");
  app.set_version_flag("--version", std::string("telenano-master ") + telenano::kVersion);
  app.require_subcommand(1);
  std::string command_line = "telenano-master";
  for (int i = 1; i < argc; ++i) command_line += std::string(" ") + argv[i];
  int exit_code = 0;
  try {
    telenano::app::add_run_command(app, command_line, exit_code);
    telenano::app::add_recover_command(app);
    app.parse(argc, argv);
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    std::fprintf(stderr, "%s\n", explain(app, error, {argv + 1, argv + argc}).c_str());
    return 2;
  } catch (const telenano::UserError& error) {
    std::fprintf(stderr, "telenano-master: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "telenano-master: %s\n", error.what());
    return 1;
  }
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {  // half a table must not pass for a whole one
    std::fprintf(stderr, "telenano-master: cannot write to standard output\n");
    return 1;
  }
  return exit_code;
}
