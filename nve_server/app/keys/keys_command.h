#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// Adds `keys new NAME | list | revoke NAME`. Runs as a callback; UserError and RunError go through.
CLI::App* add_keys_command(CLI::App& app);

}  // namespace telenano::app
