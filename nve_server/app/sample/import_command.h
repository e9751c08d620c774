#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// `telenano-nve import`: a scan as an instrument or Gwyddion wrote it becomes a scene.
void add_import_command(CLI::App& app);

}  // namespace telenano::app
