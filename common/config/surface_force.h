#pragma once

#include <string>

#include "telenano/common/config/toml_document.h"

namespace telenano::config {

/// What the ground is to the tip: "law" on a level sample without particle and marks, where the law of the
/// contact alone says the force; elsewhere "potential", one potential of tip and ground. In one place, for a
/// station records it and a server computes by it.
std::string surface_force(const TomlTable& scene);

}  // namespace telenano::config
