#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// `telenano-nve check`: what a scene computes, what it leaves out, and what a step costs.
void add_check_command(CLI::App& app);

}  // namespace telenano::app
