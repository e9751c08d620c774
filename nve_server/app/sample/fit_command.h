#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// `telenano-nve fit`: the material of a scene from force curves.
void add_fit_command(CLI::App& app);

}  // namespace telenano::app
