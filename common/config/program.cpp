#include "telenano/common/config/program.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/config/completion.h"
#include "telenano/common/config/usage_error.h"

namespace telenano::config {
namespace {

// What the parser could not make out, in one line: by the words and flags of the command that was reached
// ("keys new" is two words).
std::string explain(const CLI::App& app, const CLI::ParseError& error, std::vector<std::string> arguments) {
  std::vector<std::string> commands;
  std::vector<std::string> flags{"--help", "--version"};
  for (const CLI::App* level = &app; level != nullptr;) {
    const auto subcommands = level->get_subcommands({});
    if (subcommands.empty()) break;
    commands.clear();
    const CLI::App* next = nullptr;
    for (const CLI::App* command : subcommands) {
      commands.push_back(command->get_name());
      if (!arguments.empty() && arguments[0] == command->get_name()) next = command;
    }
    level = next;
    if (level == nullptr) break;
    for (const CLI::Option* option : level->get_options()) {
      for (const std::string& name : option->get_lnames()) flags.push_back("--" + name);
    }
    if (!level->get_subcommands({}).empty()) arguments.erase(arguments.begin());
  }
  return usage_error(app.get_name(), error.what(), arguments, commands, flags);
}

}  // namespace

int run_program(CLI::App& app, int argc, char** argv, const int& exit_code) {
  const std::string name = app.get_name();
  app.add_flag_callback(
      "--completion",
      [&app] {
        std::fputs(bash_completion(app).c_str(), stdout);
        throw CLI::Success();
      },
      "Print a bash completion script");
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
