#pragma once

namespace CLI {
class App;
}

namespace telenano::config {

/// What every program does with its arguments: parses them (commands run as callbacks and leave their own
/// code in `exit_code`) and turns whatever is thrown into one line on standard error and an exit code: 0
/// done, 1 failed while running (also when standard output could not be written: half a table must not pass
/// for a whole one), 2 wrong usage or configuration.
int run_program(CLI::App& app, int argc, char** argv, const int& exit_code);

}  // namespace telenano::config
