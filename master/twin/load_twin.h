#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "telenano/common/control/local_slave.h"

namespace telenano::twin {

/// `count` twins of the scene with this name or in this file, which share what is costly. Throws UserError.
std::vector<std::unique_ptr<control::LocalSlave>> load_twins(const std::string& name_or_path,
                                                             std::size_t count);

/// The same of a scene that a server let be fetched (nve_server/scene/scene_bundle.h). Throws UserError.
std::vector<std::unique_ptr<control::LocalSlave>> decode_twins(std::string_view bundle, std::size_t count);

}  // namespace telenano::twin
