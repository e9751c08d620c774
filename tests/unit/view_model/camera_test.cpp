#include "telenano/master/view_model/camera.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace telenano::view_model {
namespace {

// A pinhole by similar triangles, from the camera's place and the angle that it sees: no matrix.
ScreenPoint pinhole(const Camera& camera, const Vec3& point, double width, double height) {
  const double az = camera.azimuth_deg * std::numbers::pi / 180;
  const double el = camera.elevation_deg * std::numbers::pi / 180;
  const Vec3 back(std::cos(az) * std::cos(el), std::sin(az) * std::cos(el), std::sin(el));
  const Vec3 eye = camera.target_nm + camera.distance_nm * back;
  const Vec3 side = Vec3::UnitZ().cross(back).normalized();
  const Vec3 over = back.cross(side);
  const Vec3 d = point - eye;
  const double deep = -d.dot(back);
  const double focal_px = 0.5 * height / std::tan(0.5 * camera.field_of_view_deg * std::numbers::pi / 180);
  return {0.5 * width + focal_px * d.dot(side) / deep, 0.5 * height - focal_px * d.dot(over) / deep, 0,
          deep > 0};
}

TEST(Camera, ProjectsAsAPinholeDoes) {
  Camera camera;
  camera.target_nm = {10, -20, 5};
  for (const double azimuth : {-170.0, -62.0, 0.0, 33.0, 120.0}) {
    for (const double elevation : {-40.0, 3.0, 32.0, 80.0}) {
      camera.azimuth_deg = azimuth;
      camera.elevation_deg = elevation;
      for (const Vec3& p : {Vec3(10, -20, 5), Vec3(100, 50, 0), Vec3(-200, 30, 60)}) {
        const ScreenPoint expected = pinhole(camera, p, 800, 500);
        const ScreenPoint shown = project(camera.clip_of_scene(1.6), p, 800, 500);
        EXPECT_NEAR(shown.x_px, expected.x_px, 1e-6);  // rounding of numbers of about 1e3
        EXPECT_NEAR(shown.y_px, expected.y_px, 1e-6);
        EXPECT_TRUE(shown.in_front);
      }
    }
  }
}

TEST(Camera, OrthographicPixelsAreNanometresEverywhere) {
  Camera camera;
  camera.orthographic = true;
  camera.azimuth_deg = -90;
  camera.elevation_deg = 0;
  camera.half_height_nm = 10;
  const Mat4 clip = camera.clip_of_scene(1.5);
  for (const double deep : {-300.0, 0.0, 300.0}) {
    const ScreenPoint p = project(clip, {3, deep, 4}, 600, 400);
    EXPECT_NEAR(p.x_px, 300 + 3 * 20, 1e-9);  // 400 px for 20 nm
    EXPECT_NEAR(p.y_px, 200 - 4 * 20, 1e-9);
  }
  EXPECT_DOUBLE_EQ(camera.nm_per_pixel(400), 0.05);
  // Depth grows away from the camera, within what is drawn.
  EXPECT_LT(project(clip, {0, -300, 0}, 600, 400).depth, project(clip, {0, 300, 0}, 600, 400).depth);
  EXPECT_LT(std::abs(project(clip, {0, 300, 0}, 600, 400).depth), 1);
}

TEST(Camera, APixelAtTheTargetSpansWhatItSays) {
  Camera camera;
  const double nm = camera.nm_per_pixel(700);
  const Mat4 clip = camera.clip_of_scene(1);
  const ScreenPoint a = project(clip, camera.target_nm, 700, 700);
  const ScreenPoint b = project(clip, camera.target_nm + 25 * nm * camera.right(), 700, 700);
  EXPECT_NEAR(b.x_px - a.x_px, 25, 1e-9);
  EXPECT_NEAR(b.y_px, a.y_px, 1e-9);
}

TEST(Camera, WhatIsBehindIsSaidToBe) {
  const Camera camera;
  const Vec3 behind = camera.position_nm() + 100 * camera.direction();
  EXPECT_FALSE(project(camera.clip_of_scene(1), behind, 100, 100).in_front);
}

TEST(Camera, NeverTurnsOverAndNeverZoomsThrough) {
  Camera camera;
  camera.orbit(1000, 1000);
  EXPECT_LE(camera.elevation_deg, 89);
  EXPECT_LE(std::abs(camera.azimuth_deg), 180);
  for (int i = 0; i < 1000; ++i) camera.zoom(2);
  EXPECT_GT(camera.distance_nm, 0);
  camera.zoom(0);
  camera.zoom(-1);
  EXPECT_TRUE(std::isfinite(camera.distance_nm));
}

}  // namespace
}  // namespace telenano::view_model
