#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// `telenano-nve curve`: the force–distance curve of a scene as CSV.
void add_curve_command(CLI::App& app);

}  // namespace telenano::app
