#pragma once

#include <string>
#include <vector>

namespace telenano::config {

/// One line about a command line that was not understood. `what` is the parser's own message, which stays
/// unless a word of the command line is unknown: that word is then named, with the nearest known one.
/// `arguments` without the program's name; `commands` that it has; `flags` of the command in use, with their
/// dashes.
std::string usage_error(const std::string& program, const std::string& what,
                        const std::vector<std::string>& arguments, const std::vector<std::string>& commands,
                        const std::vector<std::string>& flags);

}  // namespace telenano::config
