#include "common/config/program.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "common/base/error.h"
#include "common/config/usage_error.h"

namespace telenano::config {
namespace {

// What the parser could not make out, in one line.
std::string explain(const CLI::App& app, const CLI::ParseError& error,
                    const std::vector<std::string>& arguments) {
  std::vector<std::string> commands;
  std::vector<std::string> flags{"--help", "--version"};
  for (const CLI::App* command : app.get_subcommands({})) {
    commands.push_back(command->get_name());
    if (arguments.empty() || arguments[0] != command->get_name()) continue;
    for (const CLI::Option* option : command->get_options()) {
      for (const std::string& name : option->get_lnames()) flags.push_back("--" + name);
    }
  }
  return usage_error(app.get_name(), error.what(), arguments, commands, flags);
}

}  // namespace

int run_program(CLI::App& app, int argc, char** argv, const int& exit_code) {
  const std::string name = app.get_name();
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    std::fprintf(stderr, "%s\n", explain(app, error, {argv + 1, argv + argc}).c_str());
    return 2;
  } catch (const UserError& error) {
    std::fprintf(stderr, "%s: %s\n", name.c_str(), error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", name.c_str(), error.what());
    return 1;
  }
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
    std::fprintf(stderr, "%s: cannot write to standard output\n", name.c_str());
    return 1;
  }
  return exit_code;
}

}  // namespace telenano::config
