#pragma once

#include <string>

namespace telenano::app {

struct PictureSize {
  int width_px = 0;
  int height_px = 0;
};

/// "1280x800"; 320x240 to 4096x4096, else UserError.
PictureSize parse_picture_size(const std::string& text);

}  // namespace telenano::app
