#include "telenano/common/config/program.h"

#include <poll.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <csignal>
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

/// A write to a pipe that nobody reads fails, and ends no program. A handler, not SIG_IGN, because programs that are
/// started here do not inherit it.
void outlive_broken_pipes() {
  struct sigaction action {};
  action.sa_handler = [](int) {};
  action.sa_flags = SA_RESTART;
  sigaction(SIGPIPE, &action, nullptr);
}

/// Whoever read standard output wants no more of it, as `| head` does: nothing that has to be told.
bool reader_has_gone() {
  pollfd output{STDOUT_FILENO, 0, 0};
  return std::ferror(stdout) != 0 && ::poll(&output, 1, 0) > 0 && (output.revents & (POLLERR | POLLHUP)) != 0;
}

}  // namespace

void require_stdout() {
  if (std::ferror(stdout) != 0) throw RunError("cannot write to standard output");
}

int run_program(CLI::App& app, int argc, char** argv, const int& exit_code) {
  const std::string name = app.get_name();
  outlive_broken_pipes();
  app.add_flag_callback(
      "--completion",
      [&app] {
        std::fputs(bash_completion(app).c_str(), stdout);
        throw CLI::Success();
      },
      "Print a bash completion script");
  try {
    app.parse(argc, argv);
    std::fflush(stdout);
    require_stdout();
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    std::fprintf(stderr, "%s\n", explain(app, error, {argv + 1, argv + argc}).c_str());
    return 2;
  } catch (const UserError& error) {
    std::fprintf(stderr, "%s: %s\n", name.c_str(), error.what());
    return 2;
  } catch (const std::exception& error) {
    if (!reader_has_gone()) std::fprintf(stderr, "%s: %s\n", name.c_str(), error.what());
    return 1;
  }
  return exit_code;
}

}  // namespace telenano::config
