#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// `telenano-nve trace`: drives the virtual environment along a path from a file, without a network.
void add_trace_command(CLI::App& app);

}  // namespace telenano::app
