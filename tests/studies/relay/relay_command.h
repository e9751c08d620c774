#pragma once

namespace CLI {
class App;
}

namespace telenano::studies {

/// Adds `relay`: UDP datagrams between clients and a server, with the impairments of the simulated link.
/// Statistics a second on standard error; at the end (SIGINT, SIGTERM, --duration-s) CSV, a row a direction.
void add_relay_command(CLI::App& app);

}  // namespace telenano::studies
