#pragma once

#include <Eigen/Core>

#include "telenano/common/base/vec3.h"

namespace telenano::view_model {

using Mat4 = Eigen::Matrix4d;

/// Where a point lies in a picture: pixels from its upper left corner, and depth.
struct ScreenPoint {
  double x_px = 0;
  double y_px = 0;
  double depth = 0;      ///< -1 near … 1 far
  bool in_front = true;  ///< of the camera
};

/// A camera that goes round a point, in scene coordinates (nm, z up). Right-handed; azimuth -90° looks along
/// +y.
struct Camera {
  Vec3 target_nm = Vec3::Zero();
  double azimuth_deg = -60;   ///< of the camera as seen from the target
  double elevation_deg = 35;  ///< -89 … 89
  double distance_nm = 1000;
  bool orthographic = false;
  double half_height_nm = 10;     ///< of the picture, orthographic only
  double field_of_view_deg = 32;  ///< vertical, perspective only
  double depth_range_nm = 2000;   ///< what is drawn before and behind the target

  Vec3 direction() const noexcept;  ///< from the target to the camera, of length 1
  Vec3 right() const noexcept;      ///< of the picture
  Vec3 up() const noexcept;         ///< of the picture
  Vec3 position_nm() const noexcept { return target_nm + distance_nm * direction(); }

  /// Scene (nm) → clip space of OpenGL.
  Mat4 clip_of_scene(double aspect) const noexcept;
  /// What a pixel at the target spans.
  double nm_per_pixel(double height_px) const noexcept;

  void orbit(double azimuth_deg_more, double elevation_deg_more) noexcept;
  void zoom(double factor) noexcept;  ///< > 1: nearer
};

ScreenPoint project(const Mat4& clip_of_scene, const Vec3& point_nm, double width_px,
                    double height_px) noexcept;

}  // namespace telenano::view_model
