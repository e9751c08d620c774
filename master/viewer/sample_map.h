#pragma once

#include <optional>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/master/view_model/ground.h"
#include "telenano/master/viewer/gui.h"
#include "telenano/master/viewer/scene_renderer.h"

namespace telenano::viewer {

/// The whole sample seen from above, small, in a corner of the overview while that shows a part: which part,
/// and where the tip is.
class SampleMap {
 public:
  explicit SampleMap(const view_model::Ground& ground) { set_ground(ground); }
  void set_ground(const view_model::Ground& ground);

  /// Takes its place among the words of the frame: before them.
  void draw(const Gui& gui, const view_model::Ground& ground, const view_model::MapBox& part,
            const Vec3& tip_w_nm, const Area& overview);
  /// The place of the sample under a pixel, as drawn last; none: beside the map.
  std::optional<Vec3> place_at(const view_model::Ground& ground, ImVec2 pixel) const noexcept;
  /// It is not drawn now.
  void hide() noexcept { from_ = to_ = {0, 0}; }

 private:
  static constexpr int kCells = 32;
  std::vector<ImU32> colours_;  // by rows, from the lowest y
  ImVec2 from_{0, 0};
  ImVec2 to_{0, 0};
};

}  // namespace telenano::viewer
