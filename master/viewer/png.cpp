#include "telenano/master/viewer/png.h"

#include <stb/stb_image.h>
#include <stb/stb_image_write.h>

#include "telenano/common/base/error.h"

namespace telenano::viewer {

void write_png(const std::string& path, const Picture& picture) {
  if (stbi_write_png(path.c_str(), picture.width_px, picture.height_px, 3, picture.rgb.data(),
                     3 * picture.width_px) == 0) {
    throw RunError(path + ": the picture cannot be written: check that the folder exists and has free space");
  }
}

Picture read_png(const std::string& path) {
  Picture picture;
  int channels = 0;
  unsigned char* const texels = stbi_load(path.c_str(), &picture.width_px, &picture.height_px, &channels, 3);
  if (texels == nullptr) throw UserError(path + ": not a picture that can be read: " + stbi_failure_reason());
  picture.rgb.assign(texels, texels + static_cast<std::ptrdiff_t>(3) * picture.width_px * picture.height_px);
  stbi_image_free(texels);
  return picture;
}

}  // namespace telenano::viewer
