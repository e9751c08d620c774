#pragma once

#include <memory>

#include "telenano/nve_server/scene/scene.h"

namespace telenano::afm_sim {

/// What is simulated where no scene is named: flat silicon oxide under a silicon tip on a lever of 40 N/m.
std::shared_ptr<const scene::Scene> default_scene();

}  // namespace telenano::afm_sim
