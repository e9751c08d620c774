#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace telenano::app {

/// "6501-6504", "6501,6502,7001,6504" or "6501-6503,6514": four ports. Throws UserError, naming `what`; no port may come twice
/// but 0.
std::vector<std::uint16_t> parse_port_list(const std::string& text, const std::string& what);

}  // namespace telenano::app
