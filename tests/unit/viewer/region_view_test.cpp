// The overview of a region, and the map of the whole beside it.
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <gtest/gtest.h>
#include <imgui.h>

#include <optional>

#include "telenano/common/base/error.h"
#include "telenano/master/viewer/keys.h"
#include "telenano/master/viewer/offscreen.h"
#include "telenano/master/viewer/photographer.h"
#include "telenano/master/viewer/viewer.h"
#include "tests/support/view_scene.h"

namespace telenano::viewer {
namespace {

constexpr int kWidth = 960;
constexpr int kHeight = 600;

class RegionView : public ::testing::Test {
 protected:
  void SetUp() override {
    try {
      context_.emplace();
    } catch (const RunError& error) {
      GTEST_SKIP() << error.what();
    }
    ViewFacts facts = support::view_facts();
    facts.mouse_is_hand = true;
    viewer_.emplace(facts, view_model::Ground(support::view_scan(256)), port_, 1.0f);
    show(3000);
  }
  void show(std::int64_t tick) {
    port_.samples.push(support::view_sample(tick));
    viewer_->take_samples();
  }
  void frame() {
    if (!canvas_) canvas_.emplace(kWidth, kHeight, 0);
    canvas_->bind();
    ImGui::GetIO().DeltaTime = 1.0f / 60;
    viewer_->draw(kWidth, kHeight, time_s_ += 1.0 / 60, {});
  }
  void press(int key) {
    set_key(key, true);
    frame();
    set_key(key, false);
    frame();
  }
  void click(ImVec2 at) {
    ImGuiIO& io = ImGui::GetIO();
    io.MousePos = at;
    frame();
    io.MouseDown[0] = true;
    frame();
    clicked_buttons_ = viewer_->hand().buttons(time_s_);
    io.MouseDown[0] = false;
    frame();
  }
  /// Of the map, which stands at the right border of the overview under the badges: found by what a click
  /// there does.
  ImVec2 map_middle() const {
    const Area area = layout_of(kWidth, kHeight, 1, Views::kBoth).overview;
    return {static_cast<float>(area.x_px + area.width_px - 60), static_cast<float>(area.y_px + 50)};
  }
  Vec3 tip() const {
    const recording::Xyz& tip = viewer_->live().now().tip_pos_w_nm;
    return {tip[0], tip[1], tip[2]};
  }

  std::optional<OffscreenContext> context_;
  view_model::ViewPort port_;
  std::optional<Viewer> viewer_;
  std::optional<Canvas> canvas_;
  std::uint32_t clicked_buttons_ = 0;
  double time_s_ = 0;
};

TEST_F(RegionView, ZShowsAQuarterRoundTheTipAsLargeAsTheWhole) {
  frame();
  const double whole_nm = viewer_->shown_overview_camera().distance_nm;
  press(GLFW_KEY_Z);
  ASSERT_TRUE(viewer_->region().box());
  EXPECT_TRUE(viewer_->region().box()->contains(tip()));
  EXPECT_NEAR(viewer_->region().box()->width_nm(), viewer_->ground().width_nm() / 4, 1e-9);
  EXPECT_NEAR(viewer_->shown_overview_camera().distance_nm, whole_nm / 4, 0.05 * whole_nm);
  // A sixteenth would be narrower than the tip: the whole again. And Home is the whole, too.
  press(GLFW_KEY_Z);
  EXPECT_FALSE(viewer_->region().box());
  press(GLFW_KEY_Z);
  press(GLFW_KEY_HOME);
  EXPECT_FALSE(viewer_->region().box());
  frame();
  EXPECT_EQ(viewer_->shown_overview_camera().distance_nm, whole_nm);
}

TEST_F(RegionView, AClickInTheMapMovesItAndTouchesNeitherHandNorCamera) {
  press(GLFW_KEY_Z);
  const view_model::MapBox before = *viewer_->region().box();
  const double azimuth_deg = viewer_->overview_camera().azimuth_deg;
  click(map_middle());
  const view_model::MapBox after = *viewer_->region().box();
  EXPECT_TRUE(before.x_min_nm != after.x_min_nm || before.y_min_nm != after.y_min_nm);
  EXPECT_EQ(after.width_nm(), before.width_nm());
  EXPECT_EQ(viewer_->overview_camera().azimuth_deg, azimuth_deg);
  EXPECT_EQ(clicked_buttons_, 0u);
  // Beside the map the mouse is the hand.
  click({map_middle().x - 200, map_middle().y + 200});
  EXPECT_NE(clicked_buttons_, 0u);
}

TEST_F(RegionView, GoesWithTheTip) {
  press(GLFW_KEY_Z);
  const view_model::MapBox before = *viewer_->region().box();
  for (std::int64_t tick = 3000; tick < 7000; tick += 20) {
    show(tick);
    frame();
    ASSERT_TRUE(viewer_->region().box()->contains(tip())) << tick;
  }
  const view_model::MapBox after = *viewer_->region().box();
  EXPECT_TRUE(before.x_min_nm != after.x_min_nm || before.y_min_nm != after.y_min_nm);
}

TEST_F(RegionView, AnotherSampleIsShownWhole) {
  press(GLFW_KEY_Z);
  surface::HeightGrid small{8, 8, 5, 5, 0, 0, std::vector<double>(64, 1)};
  viewer_->set_ground(view_model::Ground(std::move(small)));
  EXPECT_FALSE(viewer_->region().box());
  frame();
  // The same one with a mark in it is no other.
  viewer_->set_ground(view_model::Ground(support::view_scan(256)));
  press(GLFW_KEY_Z);
  ASSERT_TRUE(viewer_->region().box());
  viewer_->set_ground(view_model::Ground(support::view_scan(256)));
  EXPECT_TRUE(viewer_->region().box());
  frame();
}

}  // namespace
}  // namespace telenano::viewer
