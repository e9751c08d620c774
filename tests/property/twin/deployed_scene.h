#pragma once

#include <memory>
#include <string>

#include "telenano/nve_server/scene/scene.h"
#include "tests/source_dir.h"

namespace telenano::support {

/// A scene that comes with the programs, by its name.
inline std::shared_ptr<const scene::Scene> deployed(const std::string& name) {
  return scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml");
}

}  // namespace telenano::support
