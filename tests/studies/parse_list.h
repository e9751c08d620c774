#pragma once

#include <string>
#include <vector>

namespace telenano::studies {

/// "0,0.5,1" to numbers; `what` (command and option) begins the UserError that anything else gives.
std::vector<double> parse_list(const std::string& text, const std::string& what);

}  // namespace telenano::studies
