#include "telenano/master/viewer/sample_map.h"

#include <algorithm>
#include <cmath>

#include "telenano/master/viewer/palette.h"

namespace telenano::viewer {

void SampleMap::set_ground(const view_model::Ground& ground) {
  colours_.clear();
  colours_.reserve(kCells * kCells);
  for (int row = 0; row < kCells; ++row) {
    for (int column = 0; column < kCells; ++column) {
      const double x = ground.min_w_nm().x() + ground.width_nm() * (column + 0.5) / kCells;
      const double y = ground.min_w_nm().y() + ground.depth_nm() * (row + 0.5) / kCells;
      colours_.push_back(ink(view_model::height_colour(ground.colour_height(ground.height_w_nm(x, y)))));
    }
  }
}

void SampleMap::draw(const Gui& gui, const view_model::Ground& ground, const view_model::MapBox& part,
                     const Vec3& tip_w_nm, const Area& overview) {
  const float s = gui.scale();
  const float side = std::clamp(0.26f * static_cast<float>(overview.width_px), 60 * s, 150 * s);
  const auto longest = static_cast<float>(std::max(ground.width_nm(), ground.depth_nm()));
  const float wide = side * static_cast<float>(ground.width_nm()) / longest;
  const float high = side * static_cast<float>(ground.depth_nm()) / longest;
  const float right = static_cast<float>(overview.x_px + overview.width_px) - 10 * s;
  from_ = {right - wide, static_cast<float>(overview.y_px) + 10 * s};
  // Under the badges, which take more rows in a narrow picture.
  for (int i = 0; i < 40 && !gui.words().is_free(from_, {from_.x + wide, from_.y + high}); ++i)
    from_.y += 4 * s;
  to_ = {from_.x + wide, from_.y + high};
  gui.words().take({from_.x - 3 * s, from_.y - 3 * s}, {to_.x + 3 * s, to_.y + 3 * s});
  ImDrawList* const list = ImGui::GetBackgroundDrawList();
  list->AddRectFilled({from_.x - 2 * s, from_.y - 2 * s}, {to_.x + 2 * s, to_.y + 2 * s},
                      ink(palette::kBackground, 0.8f));
  const auto at = [&](double x_nm, double y_nm) {
    const double u = (x_nm - ground.min_w_nm().x()) / ground.width_nm();
    const double v = (y_nm - ground.min_w_nm().y()) / ground.depth_nm();
    return ImVec2{from_.x + static_cast<float>(std::clamp(u, 0.0, 1.0)) * wide,
                  to_.y - static_cast<float>(std::clamp(v, 0.0, 1.0)) * high};
  };
  for (int row = 0; row < kCells; ++row) {
    for (int column = 0; column < kCells; ++column) {
      const float x = from_.x + wide * static_cast<float>(column) / kCells;
      const float y = to_.y - high * static_cast<float>(row + 1) / kCells;
      list->AddRectFilled({x, y}, {x + wide / kCells + 0.5f, y + high / kCells + 0.5f},
                          colours_[static_cast<std::size_t>(row * kCells + column)]);
    }
  }
  const ImVec2 low = at(part.x_min_nm, part.y_max_nm);
  const ImVec2 far = at(part.x_max_nm, part.y_min_nm);
  list->AddRect({low.x - s, low.y - s}, {far.x + s, far.y + s}, ink(palette::kBackground), 0, 0, 3 * s);
  list->AddRect({low.x - s, low.y - s}, {far.x + s, far.y + s}, ink(palette::kText), 0, 0, 1.5f * s);
  if (!std::isfinite(tip_w_nm.x()) || !std::isfinite(tip_w_nm.y())) return;
  const ImVec2 tip = at(tip_w_nm.x(), tip_w_nm.y());
  list->AddCircleFilled(tip, 3.5f * s, ink(palette::kBackground));
  list->AddCircleFilled(tip, 2.5f * s, ink(palette::kRepulsion));
}

std::optional<Vec3> SampleMap::place_at(const view_model::Ground& ground, ImVec2 pixel) const noexcept {
  if (!(pixel.x >= from_.x && pixel.x < to_.x && pixel.y >= from_.y && pixel.y < to_.y)) return std::nullopt;
  const double u = (pixel.x - from_.x) / (to_.x - from_.x);
  const double v = (to_.y - pixel.y) / (to_.y - from_.y);
  const double x = ground.min_w_nm().x() + u * ground.width_nm();
  const double y = ground.min_w_nm().y() + v * ground.depth_nm();
  return Vec3(x, y, ground.height_w_nm(x, y));
}

}  // namespace telenano::viewer
