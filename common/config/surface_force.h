#pragma once

#include <string>

#include "telenano/common/config/toml_document.h"

namespace telenano::config {

/// What the ground is to the tip where a scene leaves [surface] force out: "potential" on the grids that the
/// balance on one potential takes (scan, step, grating, and any shape of a sample that keeps marks), "foot"
/// elsewhere and with a particle. In one place, for a station records it and a server computes by it.
std::string default_surface_force(const TomlTable& scene);

}  // namespace telenano::config
