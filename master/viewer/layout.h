#pragma once

#include <array>
#include <cstdint>

#include "telenano/master/viewer/scene_renderer.h"

namespace telenano::viewer {

/// The smallest window, in points of its screen: in it the layout has room for words of the screen's own size.
inline constexpr double kLeastWidth_px = 640;
inline constexpr double kLeastHeight_px = 480;

enum class Views : std::uint8_t { kBoth, kOverview, kCloseUp };

/// Where everything is in a window: two pictures side by side, four charts under them, the panel at the
/// right.
struct Layout {
  Area overview;
  Area close_up;
  std::array<Area, 4> charts;
  Area panel;
};

Layout layout_of(int width_px, int height_px, double scale, Views views) noexcept;

}  // namespace telenano::viewer
