#pragma once

#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/master/view_model/camera.h"
#include "telenano/master/view_model/colour_map.h"

namespace telenano::viewer {

/// Lines of any width as triangles in clip space (a core profile promises no line wider than a pixel).
class LineBatch {
 public:
  LineBatch(const view_model::Mat4& clip_of_scene, double width_px, double height_px)
      : clip_of_scene_(clip_of_scene), width_px_(width_px), height_px_(height_px) {}

  void add(const Vec3& from_nm, const Vec3& to_nm, const view_model::Rgb& colour, double alpha,
           double wide_px);
  void add_point(const Vec3& at_nm, const view_model::Rgb& colour, double alpha);
  const std::vector<float>& corners() const noexcept { return corners_; }

 private:
  void push(const Eigen::Vector4d& clip, const view_model::Rgb& colour, double alpha);

  view_model::Mat4 clip_of_scene_;
  double width_px_;
  double height_px_;
  std::vector<float> corners_;
};

}  // namespace telenano::viewer
