#pragma once

namespace CLI {
class App;
}

namespace telenano::studies {

void add_figures_command(CLI::App& app);

}  // namespace telenano::studies
