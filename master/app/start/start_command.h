#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// Adds `start`: the window in which a session is chosen, begun, and begun again. UserError and RunError go
/// through to the caller.
CLI::App* add_start_command(CLI::App& app, int& exit_code);

}  // namespace telenano::app
