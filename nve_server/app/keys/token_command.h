#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// `telenano-nve token`: makes a connect token. Returns the command.
CLI::App* add_token_command(CLI::App& app);

}  // namespace telenano::app
