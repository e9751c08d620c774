#pragma once

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <numbers>
#include <optional>

#include "telenano/common/base/error.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/station/station.h"
#include "telenano/master/viewer/keys.h"
#include "telenano/master/viewer/offscreen.h"
#include "telenano/master/viewer/photographer.h"
#include "telenano/master/viewer/viewer.h"
#include "tests/source_dir.h"
#include "tests/support/view_scene.h"
#include "tests/unit/viewer/glyphs.h"

/// A window's picture without a display, and an independent projection to say where things must be in it.
namespace telenano::viewer {

using view_model::Rgb;
using view_model::ViewRequest;

inline constexpr int kWidth = 1000;
inline constexpr int kHeight = 640;

struct Pixel {
  double x = 0;
  double y = 0;
};

// A pinhole camera, and a parallel one, by hand: no matrix of the product's.
inline Pixel project(const view_model::Camera& camera, const Vec3& point, const Area& area) {
  const double az = camera.azimuth_deg * std::numbers::pi / 180;
  const double el = camera.elevation_deg * std::numbers::pi / 180;
  const Vec3 back(std::cos(az) * std::cos(el), std::sin(az) * std::cos(el), std::sin(el));
  const Vec3 side = Vec3::UnitZ().cross(back).normalized();
  const Vec3 over = back.cross(side);
  const Vec3 d = point - camera.target_nm;
  double px_per_nm = 0.5 * area.height_px / camera.half_height_nm;
  if (!camera.orthographic) {
    const double focal_px =
        0.5 * area.height_px / std::tan(0.5 * camera.field_of_view_deg * std::numbers::pi / 180);
    px_per_nm = focal_px / (camera.distance_nm - d.dot(back));
  }
  return {area.x_px + 0.5 * area.width_px + px_per_nm * d.dot(side),
          area.y_px + 0.5 * area.height_px - px_per_nm * d.dot(over)};
}

class Render : public ::testing::Test {
 protected:
  void SetUp() override {
    try {
      context_.emplace();
    } catch (const RunError& error) {
      GTEST_SKIP() << error.what();
    }
    facts_ = support::view_facts();
  }

  void make(bool scan = true) {
    view_model::Ground ground = scan ? view_model::Ground(support::view_scan(256))
                                     : view_model::Ground(0, Vec3(25, 25, -60), Vec3(575, 575, 100));
    viewer_.emplace(facts_, std::move(ground), port_, 1.0f);
  }
  void play(std::int64_t from, std::int64_t to) {
    for (std::int64_t tick = from; tick < to; ++tick) {
      port_.samples.push(support::view_sample(tick));
      if (tick % 4000 == 0) viewer_->take_samples();
    }
    viewer_->take_samples();
  }
  const Picture& draw() { return picture_ = draw_picture(*viewer_, kWidth, kHeight, {}); }
  // One frame with the mouse and keys as they are.
  void frame() {
    if (!canvas_) canvas_.emplace(kWidth, kHeight, 0);
    canvas_->bind();
    ImGui::GetIO().DeltaTime = 1.0f / 60;
    viewer_->draw(kWidth, kHeight, time_s_ += 1.0 / 60, {});
  }
  Rgb at(const Pixel& p) const {
    const auto x = static_cast<int>(std::lround(p.x));
    const auto y = static_cast<int>(std::lround(p.y));
    EXPECT_TRUE(x >= 0 && x < kWidth && y >= 0 && y < kHeight) << p.x << ", " << p.y;
    const auto i = static_cast<std::size_t>(3 * (y * kWidth + x));
    return {picture_.rgb.at(i) / 255.0f, picture_.rgb.at(i + 1) / 255.0f, picture_.rgb.at(i + 2) / 255.0f};
  }
  Layout layout() const { return layout_of(kWidth, kHeight, 1, Views::kBoth); }
  // The overview stands back where the picture is narrow: the same rule, written again.
  view_model::Camera overview_camera() const {
    view_model::Camera camera = viewer_->overview_camera();
    const double aspect = static_cast<double>(layout().overview.width_px) / layout().overview.height_px;
    camera.distance_nm /= std::min(std::max(aspect, 0.2), 1.25);
    return camera;
  }
  // Scene coordinates of the overview: about the middle of the scan, heights five times taller.
  Vec3 in_overview(double x, double y, double z) const {
    const auto& g = viewer_->ground();
    const Vec3 middle = 0.5 * (g.min_w_nm() + g.max_w_nm());
    return {x - middle.x(), y - middle.y(), (z - g.min_w_nm().z()) * 5};
  }
  std::optional<ViewRequest> asked() {
    ViewRequest request;
    if (!port_.requests.pop(request)) return std::nullopt;
    return request;
  }
  /// Since the last call.
  bool stop_asked() { return std::exchange(stops_, port_.stops.load()) != port_.stops.load(); }
  bool quit_asked() { return port_.quit.exchange(false); }
  void press(int key) {
    set_key(key, true);
    frame();
    set_key(key, false);
    frame();
  }

  std::optional<OffscreenContext> context_;
  ViewFacts facts_;
  view_model::ViewPort port_;
  std::optional<Viewer> viewer_;
  std::optional<Canvas> canvas_;
  Picture picture_;
  double time_s_ = 0;
  std::uint32_t stops_ = 0;
};

}  // namespace telenano::viewer
