#pragma once

#include <string>

namespace CLI {
class App;
}

namespace telenano::app {

/// Adds `run --server HOST:PORT …`: one session from handshake to Bye. `command_line` goes into the
/// recording. UserError and RunError go through to the caller.
CLI::App* add_run_command(CLI::App& app, const std::string& command_line, int& exit_code);

/// Adds `replay FILE.h5 --server HOST:PORT …`: run with the hand of a recording.
CLI::App* add_replay_command(CLI::App& app, const std::string& command_line, int& exit_code);

}  // namespace telenano::app
