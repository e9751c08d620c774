#pragma once

#include <array>
#include <cstdint>

#include "telenano/master/viewer/scene_renderer.h"

namespace telenano::viewer {

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
