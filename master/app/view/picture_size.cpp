#include "telenano/master/app/view/picture_size.h"

#include <charconv>
#include <string_view>

#include "telenano/common/base/error.h"

namespace telenano::app {

PictureSize parse_picture_size(const std::string& text) {
  const auto fail = [&text] {
    throw UserError("--screenshot-size: '" + text +
                    "' is not a size, expected WIDTHxHEIGHT, 320x240 to 4096x4096");
  };
  const std::size_t x = text.find('x');
  if (x == std::string::npos) fail();
  const auto number = [&](std::string_view part) {
    int value = 0;
    const auto [end, error] = std::from_chars(part.data(), part.data() + part.size(), value);
    if (error != std::errc() || end != part.data() + part.size()) fail();
    return value;
  };
  const std::string_view all = text;
  const PictureSize size{number(all.substr(0, x)), number(all.substr(x + 1))};
  if (size.width_px < 320 || size.height_px < 240 || size.width_px > 4096 || size.height_px > 4096) fail();
  return size;
}

}  // namespace telenano::app
