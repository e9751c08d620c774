// A recording in the window.
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
#include "telenano/master/viewer/offscreen.h"
#include "telenano/master/viewer/photographer.h"
#include "telenano/master/viewer/viewer.h"
#include "tests/source_dir.h"
#include "tests/support/view_scene.h"
#include "tests/unit/viewer/glyphs.h"
#include "tests/unit/viewer/render_fixture.h"

namespace telenano::viewer {
namespace {

class RenderRecording : public Render {
 protected:
  void open() {
    std::vector<recording::Sample> rows(8001);
    for (std::size_t i = 0; i < rows.size(); ++i)
      rows[i] = support::view_sample(static_cast<std::int64_t>(i));
    playback_.emplace(std::move(rows), std::vector<view_model::Playback::Mark>{{2.5, "mark 1"}});
    facts_.played = "made by formula";
    make();
    viewer_->play(*playback_);
  }
  void frames(int count) {
    for (int i = 0; i < count; ++i) frame();
  }
  std::optional<view_model::Playback> playback_;
};

TEST_F(RenderRecording, PlaysHaltsAndMovesAboutByKey) {
  open();
  frame();
  frames(30);
  EXPECT_NEAR(viewer_->live().now().time_s, 0.5, 0.002);  // thirty frames; a row a millisecond
  press(GLFW_KEY_SPACE);
  const double halted_s = viewer_->live().now().time_s;
  frames(5);
  EXPECT_EQ(viewer_->live().now().time_s, halted_s);
  press(GLFW_KEY_RIGHT);
  EXPECT_NEAR(viewer_->live().now().time_s, halted_s + 1, 0.002);
  set_modifiers(GLFW_MOD_SHIFT);
  press(GLFW_KEY_LEFT);
  set_modifiers(0);
  EXPECT_NEAR(viewer_->live().now().time_s, halted_s + 0.99, 0.002);
  press(GLFW_KEY_PAGE_DOWN);
  EXPECT_NEAR(viewer_->live().now().time_s, 2.5, 0.002);
  press(GLFW_KEY_PAGE_UP);
  EXPECT_EQ(viewer_->live().now().time_s, 0);
  press(GLFW_KEY_DOWN);
  EXPECT_EQ(playback_->speed(), 0.5);
  press(GLFW_KEY_UP);
  press(GLFW_KEY_UP);
  EXPECT_EQ(playback_->speed(), 2);
  // Nobody is asked for anything.
  for (const int key : {GLFW_KEY_ESCAPE, GLFW_KEY_R, GLFW_KEY_M, GLFW_KEY_3, GLFW_KEY_T, GLFW_KEY_C})
    press(key);
  EXPECT_FALSE(asked());
  EXPECT_FALSE(viewer_->quit_wanted());
  set_modifiers(GLFW_MOD_CONTROL);
  press(GLFW_KEY_Q);
  set_modifiers(0);
  EXPECT_TRUE(viewer_->quit_wanted());
}

// Where STOP is in a session there is play; under it the slider of time.
TEST_F(RenderRecording, TheMousePlaysAndScrubs) {
  open();
  frames(2);
  ImGuiIO& io = ImGui::GetIO();
  const auto click = [&](float x, float y) {
    io.MousePos = {x, y};
    frame();
    io.MouseDown[0] = true;
    frame();
    io.MouseDown[0] = false;
    frame();
  };
  const auto left = static_cast<float>(layout().panel.x_px);
  click(left + 0.5f * static_cast<float>(layout().panel.width_px), 30);
  EXPECT_FALSE(playback_->playing());
  click(left + 0.75f * static_cast<float>(layout().panel.width_px), 68);
  // Of 8 s; the slider has a margin and a grab.
  EXPECT_NEAR(viewer_->live().now().time_s, 6, 0.4);
  EXPECT_FALSE(asked());
}

// A moment looks the same whether it was played to or leapt to.
TEST_F(RenderRecording, AMomentLooksTheSameHoweverItIsReached) {
  open();
  playback_->play(false);
  playback_->seek(5);
  frame();
  const Picture leapt = draw();
  playback_->seek(7);
  frame();
  playback_->seek(0);
  frame();
  playback_->play(true);
  playback_->set_speed(10);
  while (playback_->time_s() < 4.99) frame();
  playback_->set_speed(1);  // it is written there
  playback_->play(false);
  playback_->seek(5);
  frame();
  const Picture again = draw();
  ASSERT_EQ(leapt.rgb.size(), again.rgb.size());
  std::size_t other = 0;
  int x_min = kWidth, x_max = 0, y_min = kHeight, y_max = 0;
  for (std::size_t i = 0; i < leapt.rgb.size(); ++i) {
    if (std::abs(int{leapt.rgb[i]} - int{again.rgb[i]}) <= 2) continue;
    ++other;
    const int x = static_cast<int>(i / 3) % leapt.width_px;
    const int y = static_cast<int>(i / 3) / leapt.width_px;
    x_min = std::min(x_min, x), x_max = std::max(x_max, x);
    y_min = std::min(y_min, y), y_max = std::max(y_max, y);
  }
  // The section has come to rest but for 0.88^120 of its way: a few edges may differ, a trail would be more.
  EXPECT_LT(other, leapt.rgb.size() / 2000)
      << "x " << x_min << " to " << x_max << ", y " << y_min << " to " << y_max;
}

}  // namespace
}  // namespace telenano::viewer
