#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/control/local_slave.h"

namespace telenano::twin {

/// `count` twins of the scene with this name or in this file, which share what is costly. Throws UserError.
std::vector<std::unique_ptr<control::LocalSlave>> load_twins(const std::string& name_or_path,
                                                             std::size_t count);

}  // namespace telenano::twin
