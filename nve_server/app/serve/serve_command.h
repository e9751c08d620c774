#pragma once

#include <functional>
#include <string>

#include "telenano/common/surface/height_grid.h"
#include "telenano/nve_server/server/server.h"

namespace CLI {
class App;
}

namespace telenano::app {

/// Loads the scene that a file describes; throws UserError with one line that names file, key and what is
/// expected. `surface_folder`: where the sessions' marked surfaces are to be kept; empty: nowhere.
using SceneLoader =
    std::function<server::ServedScene(const std::string& scene_path, const std::string& surface_folder)>;

/// The heights of the scene that was loaded last, for `--web`.
using SceneHeights = std::function<surface::HeightGrid()>;

/// Adds `serve --scene FILE --listen HOST:PORT …`. When the command is given, it runs inside app.parse()
/// until SIGINT or SIGTERM, says Bye to its sessions and leaves 0 in `exit_code`; UserError and RunError go
/// through to the caller.
/// `heights` empty: browsers are told that the surface is not known.
CLI::App* add_serve_command(CLI::App& app, SceneLoader load_scene, int& exit_code, SceneHeights heights = {});

}  // namespace telenano::app
