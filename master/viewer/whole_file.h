#pragma once

#include <string>
#include <string_view>

namespace telenano::viewer {

/// Writes the file whole, or leaves none. `what`: of a picture, "the picture". Throws RunError with the system's reason.
void write_whole_file(const std::string& path, std::string_view bytes, const std::string& what);

}  // namespace telenano::viewer
