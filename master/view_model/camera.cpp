#include "telenano/master/view_model/camera.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace telenano::view_model {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;
constexpr double kElevationMax_deg = 89;

}  // namespace

Vec3 Camera::direction() const noexcept {
  const double azimuth = azimuth_deg * kRadPerDeg;
  const double elevation = elevation_deg * kRadPerDeg;
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

Vec3 Camera::right() const noexcept {
  const double azimuth = azimuth_deg * kRadPerDeg;
  return {-std::sin(azimuth), std::cos(azimuth), 0};
}

Vec3 Camera::up() const noexcept {
  return direction().cross(right());
}

Mat4 Camera::clip_of_scene(double aspect) const noexcept {
  const Vec3 eye = position_nm();
  Mat4 view = Mat4::Identity();
  view.block<1, 3>(0, 0) = right().transpose();
  view.block<1, 3>(1, 0) = up().transpose();
  view.block<1, 3>(2, 0) = direction().transpose();
  view(0, 3) = -right().dot(eye);
  view(1, 3) = -up().dot(eye);
  view(2, 3) = -direction().dot(eye);
  Mat4 lens = Mat4::Zero();
  if (orthographic) {
    const double near_nm = distance_nm - depth_range_nm;
    const double far_nm = distance_nm + depth_range_nm;
    lens(0, 0) = 1 / (half_height_nm * aspect);
    lens(1, 1) = 1 / half_height_nm;
    lens(2, 2) = -2 / (far_nm - near_nm);
    lens(2, 3) = -(far_nm + near_nm) / (far_nm - near_nm);
    lens(3, 3) = 1;
  } else {
    const double near_nm = std::max(distance_nm - depth_range_nm, 0.02 * distance_nm);
    const double far_nm = distance_nm + depth_range_nm;
    const double cot = 1 / std::tan(0.5 * field_of_view_deg * kRadPerDeg);
    lens(0, 0) = cot / aspect;
    lens(1, 1) = cot;
    lens(2, 2) = (far_nm + near_nm) / (near_nm - far_nm);
    lens(2, 3) = 2 * far_nm * near_nm / (near_nm - far_nm);
    lens(3, 2) = -1;
  }
  return lens * view;
}

double Camera::nm_per_pixel(double height_px) const noexcept {
  const double half_nm =
      orthographic ? half_height_nm : distance_nm * std::tan(0.5 * field_of_view_deg * kRadPerDeg);
  return 2 * half_nm / std::max(height_px, 1.0);
}

void Camera::orbit(double azimuth_deg_more, double elevation_deg_more) noexcept {
  azimuth_deg = std::remainder(azimuth_deg + azimuth_deg_more, 360);
  elevation_deg = std::clamp(elevation_deg + elevation_deg_more, -kElevationMax_deg, kElevationMax_deg);
}

void Camera::zoom(double factor) noexcept {
  if (!(factor > 0)) return;
  distance_nm = std::clamp(distance_nm / factor, 1.0, 1e7);
  half_height_nm = std::clamp(half_height_nm / factor, 0.5, 1e6);
}

ScreenPoint project(const Mat4& clip_of_scene, const Vec3& point_nm, double width_px,
                    double height_px) noexcept {
  const Eigen::Vector4d clip = clip_of_scene * point_nm.homogeneous();
  ScreenPoint point;
  point.in_front = clip.w() > 0;
  const double w = std::abs(clip.w()) > 1e-12 ? clip.w() : 1e-12;
  point.x_px = 0.5 * (clip.x() / w + 1) * width_px;
  point.y_px = 0.5 * (1 - clip.y() / w) * height_px;
  point.depth = clip.z() / w;
  return point;
}

}  // namespace telenano::view_model
