#include "telenano/master/viewer/png.h"

#include <stb/stb_image.h>
#include <stb/stb_image_write.h>

#include "telenano/common/base/error.h"
#include "telenano/master/viewer/whole_file.h"

namespace telenano::viewer {

void write_png(const std::string& path, const Picture& picture) {
  // Through the memory: the library's own way to a file says nothing of a disk that is full.
  std::string bytes;
  const auto append = [](void* to, void* data, int size) {
    static_cast<std::string*>(to)->append(static_cast<const char*>(data), static_cast<std::size_t>(size));
  };
  if (stbi_write_png_to_func(append, &bytes, picture.width_px, picture.height_px, 3, picture.rgb.data(),
                             3 * picture.width_px) == 0)
    throw RunError(path + ": the picture cannot be made: there is no memory left for it");
  write_whole_file(path, bytes, "the picture");
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
