#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "telenano/nve_server/afm/afm_config.h"
#include "telenano/nve_server/afm/afm_port.h"

namespace telenano::afm {

/// The kinds of controllers, by the names that `serve --slave` takes.
std::vector<std::string> adapter_names();
/// Throws UserError for a name that is none of them.
std::unique_ptr<AfmPort> make_adapter(std::string_view name, const AfmConfig& config);

}  // namespace telenano::afm
