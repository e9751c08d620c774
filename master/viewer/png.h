#pragma once

#include <string>
#include <vector>

namespace telenano::viewer {

struct Picture {
  int width_px = 0;
  int height_px = 0;
  std::vector<unsigned char> rgb;  ///< rows from top to bottom
};

/// Throws RunError: one line naming the file.
void write_png(const std::string& path, const Picture& picture);
/// Throws UserError: one line naming the file.
Picture read_png(const std::string& path);

}  // namespace telenano::viewer
