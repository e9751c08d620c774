#include "telenano/master/viewer/layout.h"

#include <algorithm>
#include <cmath>

namespace telenano::viewer {

Layout layout_of(int width_px, int height_px, double scale, Views views) noexcept {
  const auto px = [](double v) { return static_cast<int>(std::lround(v)); };
  Layout layout;
  const int panel = px(std::clamp(0.26 * width_px, 236 * scale, 330 * scale));
  const int charts = px(std::clamp(0.25 * height_px, 118 * scale, 230 * scale));
  const int gap = px(std::max(2 * scale, 1.0));
  const int wide = std::max(width_px - panel, 4);
  const int high = std::max(height_px - charts, 4);
  layout.panel = {wide, 0, std::max(width_px - wide, 1), height_px};
  const int split = views == Views::kBoth ? px(0.6 * wide) : wide;
  // A window may be made smaller than there is room for: then what has none is a point or two, and never less.
  layout.overview = {0, 0, views == Views::kBoth ? std::max(split - gap, 1) : wide, high};
  layout.close_up = views == Views::kBoth ? Area{split, 0, std::max(wide - split, 1), high} : layout.overview;
  const int margin = px(6 * scale);
  const int each = std::max((wide - 5 * margin) / 4, 1);
  for (int i = 0; i < 4; ++i) {
    layout.charts[static_cast<std::size_t>(i)] = {margin + i * (each + margin), high + margin, each,
                                                  std::max(charts - 2 * margin, 1)};
  }
  return layout;
}

}  // namespace telenano::viewer
