#pragma once

#include <cstddef>
#include <string>

namespace telenano::app {

/// All of a file; throws UserError for what is no regular file of at most `mib_most` MiB. `what`: what is expected
/// there, "a scan".
std::string read_user_file(const std::string& path, const char* what, std::size_t mib_most);

/// The old file or the new one whole. Throws RunError where it cannot be written.
void write_text(const std::string& path, const std::string& text);

}  // namespace telenano::app
