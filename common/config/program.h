#pragma once

namespace CLI {
class App;
}

namespace telenano::config {

/// What every program does with its arguments: parses them (commands run as callbacks and leave their own
/// code in `exit_code`) and turns whatever is thrown into one line on standard error and an exit code: 0
/// done, 1 failed while running (also when standard output could not be written: half a table must not pass
/// for a whole one; nothing is said where its reader has gone, as `| head` does), 2 wrong usage or configuration.
int run_program(CLI::App& app, int argc, char** argv, const int& exit_code);

/// Throws RunError if standard output could not be written. For what prints many rows; run_program asks in the end.
void require_stdout();

}  // namespace telenano::config
