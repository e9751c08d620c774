#pragma once

namespace CLI {
class App;
}

namespace telenano::studies {

/// Adds `flood`: a session with a server on this machine, alone and while hostile datagrams come from other
/// sockets; beside it the same with a bare echo. CSV, a row each.
void add_flood_command(CLI::App& app);

}  // namespace telenano::studies
