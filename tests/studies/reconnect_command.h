#pragma once

namespace CLI {
class App;
}

namespace telenano::studies {

/// `telenano-lab reconnect`: many sessions at one server, and how long they take to come back to it.
void add_reconnect_command(CLI::App& app, int& exit_code);

}  // namespace telenano::studies
