// The picture itself, drawn without a display: things are where an independent projection puts them and have the
// colours that they should.
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

// Hue of the ground at places that nothing covers, against the colour of the formula's height. Light changes
// the lightness, not the hue; of the shine a little white remains.
TEST_F(Render, GroundHasTheColourOfItsHeightWhereAPinholeSeesIt) {
  make();
  play(0, 3000);
  draw();
  const view_model::Camera camera = overview_camera();
  const auto& ground = viewer_->ground();
  int seen = 0;
  for (const auto& [x, y] : {std::pair{430.0, 200.0},
                             {400.0, 120.0},
                             {100.0, 200.0},
                             {200.0, 100.0},
                             {540.0, 120.0},
                             {300.0, 180.0},
                             {190.0, 420.0}}) {
    const double z = support::view_height_nm(x, y);
    const Rgb shown = at(project(camera, in_overview(x, y, z), layout().overview));
    const double t = (z - ground.min_w_nm().z()) / (ground.max_w_nm().z() - ground.min_w_nm().z());
    const auto expected = view_model::to_oklab(view_model::height_colour(t));
    const auto found = view_model::to_oklab(shown);
    if (std::hypot(expected.a, expected.b) < 0.03) continue;  // near white there is no hue
    const double turn = std::remainder(std::atan2(found.b, found.a) - std::atan2(expected.b, expected.a),
                                       2 * std::numbers::pi);
    EXPECT_LT(std::abs(turn), 0.45) << x << ", " << y;  // 26 degrees: the map goes through 180
    ++seen;
  }
  EXPECT_GE(seen, 5);
}

TEST_F(Render, TipStandsWhereItIs) {
  make();
  play(0, 1000);  // 13.5 nm above the ground
  draw();
  const auto& tip = viewer_->live().now().tip_pos_w_nm;
  // The middle of the sphere, 20 nm above the apex, whatever the exaggeration of heights.
  const Vec3 middle = in_overview(tip[0], tip[1], tip[2]) + Vec3(0, 0, 20);
  const Rgb c = at(project(overview_camera(), middle, layout().overview));
  EXPECT_NEAR(c.r, c.b, 0.12);  // grey
  EXPECT_GT(c.g, 0.3f);         // and lit
  const Rgb beside = at(project(overview_camera(), middle + Vec3(60, 30, 60), layout().overview));
  EXPECT_GT(std::abs(beside.b - beside.r) + std::abs(beside.g - c.g), 0.1);
}

// As wide in the section as its radius, by the scale of the parallel projection: from one bright rim to the other at the
// height of its middle; and in the overview a sphere of that size.
TEST_F(Render, TheTipIsAsLargeAsTheSceneHasIt) {
  for (const double radius_nm : {5.0, 8.0, 10.0}) {
    make();
    viewer_->set_server_scene({radius_nm, "", ""}, 0);
    play(0, 1000);  // 13.5 nm above the ground
    draw();
    const view_model::Camera& section = viewer_->close_up_camera();
    const auto& tip = viewer_->live().now().tip_pos_w_nm;
    const auto& ground = viewer_->ground();
    const Vec3 middle_of_ground = 0.5 * (ground.min_w_nm() + ground.max_w_nm());
    const Vec3 middle(tip[0] - middle_of_ground.x(), tip[1] - middle_of_ground.y(),
                      tip[2] + radius_nm - ground.min_w_nm().z());
    const Area area = layout().close_up;
    const Pixel centre = project(section, middle, area);
    const double nm_per_px = 2 * section.half_height_nm / area.height_px;
    const auto rim_px = [&](int step) {  // outermost bright pixel of the row
      double rim = 0;
      for (int dx = 0; std::abs(dx) < 30 / nm_per_px; dx += step) {
        const double x = centre.x + dx;
        if (x < area.x_px + 3 || x > area.x_px + area.width_px - 3) break;
        const Rgb c = at({x, centre.y});
        if (c.r > 0.6f && c.g > 0.6f && c.b > 0.6f) rim = std::abs(dx);
      }
      return rim;
    };
    ASSERT_GT(centre.y, area.y_px + 50) << "the row is under the words";
    EXPECT_NEAR(nm_per_px * rim_px(1), radius_nm, 2 * nm_per_px) << radius_nm;
    EXPECT_NEAR(nm_per_px * rim_px(-1), radius_nm, 2 * nm_per_px) << radius_nm;
    // The overview: grey inside of the sphere, the ground or the dark beside it.
    const view_model::Camera overview = overview_camera();
    const Vec3 ball = in_overview(tip[0], tip[1], tip[2]) + radius_nm * Vec3::UnitZ();
    const auto grey = [&](double part) {
      const Rgb c = at(project(overview, ball + part * radius_nm * overview.right(), layout().overview));
      return std::abs(c.r - c.b) < 0.12f && c.g > 0.15f;
    };
    EXPECT_TRUE(grey(0.7)) << radius_nm;
    EXPECT_FALSE(grey(1.4)) << radius_nm;
  }
}

// Sand-coloured where the two projections put its middle, and nothing there without one.
TEST_F(Render, AParticleLiesWhereItIs) {
  make(false);
  play(0, 1000);
  const auto& tip = viewer_->live().now().tip_pos_w_nm;
  const auto sandy = [](const Rgb& c) { return c.r > 1.25f * c.b && c.g > 1.1f * c.b && c.r > 0.2f; };
  const auto& g = viewer_->ground();
  const Vec3 middle = 0.5 * (g.min_w_nm() + g.max_w_nm());
  const Vec3 place(tip[0] - 80, tip[1] - 60, 30);
  const auto scene = [&](const Vec3& p) {
    return Vec3(p.x() - middle.x(), p.y() - middle.y(), p.z() - g.min_w_nm().z());
  };
  draw();
  EXPECT_FALSE(sandy(at(project(overview_camera(), scene(place), layout().overview))));
  const auto lie = [&](const Vec3& at, link::ParticleStatus status) {
    recording::Sample s = viewer_->live().now();
    ++s.tick;
    s.time_s += 1e-3;
    s.particle_pos_w_nm = recording::xyz(at);
    s.particle_radius_nm = 30;
    s.particle_state = static_cast<std::int64_t>(status);
    port_.samples.push(s);
    viewer_->take_samples();
  };
  lie(place, link::ParticleStatus::kRests);
  draw();
  const view_model::Camera camera = overview_camera();
  EXPECT_TRUE(sandy(at(project(camera, scene(place), layout().overview))));
  EXPECT_TRUE(sandy(at(project(camera, scene(place) + 27 * camera.right(), layout().overview))));
  EXPECT_FALSE(sandy(at(project(camera, scene(place) + 34 * camera.right(), layout().overview))));
  // The section: cut open beside the tip, in true proportions.
  const Vec3 beside(tip[0] + 50, tip[1], tip[2] + 20);
  lie(beside, link::ParticleStatus::kPushed);
  draw();
  const view_model::Camera& section = viewer_->close_up_camera();
  const auto cut = [&](double dx) {
    return at(project(section, scene(beside) + Vec3(dx, 0, 0), layout().close_up));
  };
  EXPECT_TRUE(sandy(cut(-27)));
  EXPECT_TRUE(sandy(cut(-21)));
  EXPECT_FALSE(sandy(cut(-36)));
}

TEST_F(Render, ConeIsOrangeAboveTheTipWhenPushedAndBlueBelowWhenPulled) {
  make();
  play(0, 5000);
  draw();
  const auto orange = [](const Rgb& c) { return c.r > 1.3f * c.b && c.r > 0.25f; };
  const auto blue = [](const Rgb& c) { return c.b > 1.2f * c.r && c.b > 0.4f; };
  view_model::Camera camera = viewer_->close_up_camera();
  const auto& tip = viewer_->live().now().tip_pos_w_nm;
  const auto& ground = viewer_->ground();
  const Vec3 middle = 0.5 * (ground.min_w_nm() + ground.max_w_nm());
  Vec3 apex(tip[0] - middle.x(), tip[1] - middle.y(), tip[2] - ground.min_w_nm().z());
  const double up = 0.15 * camera.half_height_nm;
  EXPECT_TRUE(orange(at(project(camera, apex + Vec3(0, 0, up), layout().close_up))));

  make();
  for (std::int64_t tick = 0; tick < 50; ++tick) {
    recording::Sample s = support::view_sample(tick);
    s.force_w_nn = {0, 0, -20};
    port_.samples.push(s);
  }
  viewer_->take_samples();
  draw();
  camera = viewer_->close_up_camera();
  const auto& tip2 = viewer_->live().now().tip_pos_w_nm;
  apex = {tip2[0] - middle.x(), tip2[1] - middle.y(), tip2[2] - ground.min_w_nm().z()};
  const Rgb below = at(project(camera, apex - Vec3(0, 0, 0.2 * camera.half_height_nm), layout().close_up));
  EXPECT_TRUE(blue(below)) << below.r << " " << below.g << " " << below.b;
}

// The section's line runs through the formula's heights.
TEST_F(Render, SectionShowsTheProfileThroughTheTip) {
  make();
  play(0, 1200);
  draw();
  const view_model::Camera camera = viewer_->close_up_camera();
  const auto& tip = viewer_->live().now().tip_pos_w_nm;
  const auto& ground = viewer_->ground();
  const Vec3 middle = 0.5 * (ground.min_w_nm() + ground.max_w_nm());
  for (const double dx : {-0.5, -0.3, 0.35}) {
    const double x = tip[0] + dx * camera.half_height_nm;
    const Vec3 place(x - middle.x(), tip[1] - middle.y(),
                     support::view_height_nm(x, tip[1]) - ground.min_w_nm().z());
    const Pixel line = project(camera, place, layout().close_up);
    double brightest = 0;
    double brightest_y = 0;
    for (int dy = -12; dy <= 12; ++dy) {
      const Rgb c = at({line.x, line.y + dy});
      if (c.r <= brightest) continue;
      brightest = c.r;
      brightest_y = dy;
    }
    EXPECT_GT(brightest, 0.6);
    EXPECT_LE(std::abs(brightest_y), 2) << dx;  // pixels; the patch's cells are straight
  }
}

// A yellow line where the tip can be led no farther, hatched on the far side of it: the server's workspace,
// and the box of a hand that is pointed at, mouse or SpaceMouse.
TEST_F(Render, WallsStandInTheSectionWhereTheTipCanGoNoFarther) {
  // Behind it all is blue.
  const auto yellow = [](const Rgb& c) { return c.r > c.b + 0.1f && c.g > c.b; };
  // Yellow points of the upright line at x of the sample, and of a line so many pixels to the side.
  const auto upright = [&](double x, double beside_px) {
    const Area area = layout().close_up;
    const auto& ground = viewer_->ground();
    const Vec3 middle = 0.5 * (ground.min_w_nm() + ground.max_w_nm());
    const auto& tip = viewer_->live().now().tip_pos_w_nm;
    const Pixel at_wall =
        project(viewer_->close_up_camera(),
                {x - middle.x(), tip[1] - middle.y(), tip[2] - ground.min_w_nm().z()}, area);
    int count = 0;
    for (int y = area.y_px + 60; y < area.y_px + area.height_px - 60; ++y)
      count += yellow(at({at_wall.x + beside_px, static_cast<double>(y)})) ? 1 : 0;
    return count / (area.height_px - 120.0);
  };
  recording::Sample s = support::view_sample(1200);
  const auto shown = [&] {
    make();
    play(0, 1200);
    port_.samples.push(s);
    viewer_->take_samples();
    draw();
  };
  const double x = s.tip_pos_w_nm[0];
  shown();
  EXPECT_LT(upright(x - 6, 0), 0.02) << "no wall is known";
  facts_.workspace_min_w_nm.x() = x - 6;
  shown();
  EXPECT_GT(upright(x - 6, 0), 0.95);
  if (const char* folder = std::getenv("TELENANO_LOOK"))
    write_png(std::string(folder) + "/walls.png", picture_);
  EXPECT_GT(upright(x - 6, -5), 0.05) << "hatched outside";
  EXPECT_LT(upright(x - 6, 5), 0.02) << "and not inside";
  // A SpaceMouse's hand, 6 mm before the right wall of its box: 6 nm of the tip at a scale of 1e-6.
  facts_.workspace_min_w_nm.x() = -std::numeric_limits<double>::infinity();
  facts_.hand_in_box = true;
  s.hand_pos_h_m = {facts_.hand_half_m - 6e-3, 0, 0};
  const double wall = s.tip_target_w_nm[0] + 6;
  shown();
  EXPECT_GT(upright(wall, 0), 0.95);
  EXPECT_LT(upright(wall, -5), 0.02);
  s.station_mode = static_cast<std::uint32_t>(station::Mode::kReady);
  shown();
  EXPECT_LT(upright(wall, 0), 0.02) << "let go, it leads nothing";
  // At the border a person is told.
  s.station_mode = static_cast<std::uint32_t>(station::Mode::kEngaged);
  s.hand_pos_h_m = {facts_.hand_half_m, 0, 0};
  shown();
  const auto text = [] { return drawn_text(drawn_glyphs(ink(palette::kBackground, 0.75f))); };
  EXPECT_NE(text().find("Thehandleadsthetipbyatmost55.0nm"), std::string::npos) << text();
  // The mouse's hand from where it has hold.
  facts_.hand_in_box = false;
  facts_.mouse_is_hand = true;
  facts_.hand_half_m = 7e-3;
  make();
  play(0, 1200);
  ImGuiIO& io = ImGui::GetIO();
  io.MousePos = {static_cast<float>(layout().close_up.x_px + 60), 260};
  frame();
  io.MouseDown[0] = true;
  frame();
  frame();
  draw();
  const double target = viewer_->live().now().tip_target_w_nm[0];
  EXPECT_GT(upright(target - 7, 0), 0.95);
  EXPECT_GT(upright(target + 7, 0), 0.95);
  io.MouseDown[0] = false;
  frame();
}

TEST_F(Render, APlaneAndItsTouchedPointsAreDrawnWithoutAScan) {
  make(false);
  play(0, 6000);
  draw();
  EXPECT_GT(viewer_->live().touched().points_w_nm().size(), 50u);
  const Rgb ground = at(project(overview_camera(), Vec3(-200, -150, 0), layout().overview));
  EXPECT_GT(ground.g, ground.r);  // the colour of the middle of the map, teal
}

// The same state gives the picture that is committed: within what other versions of Mesa and of the fonts
// change. TELENANO_NEW_PICTURES=1 writes it anew; look at it before committing.
TEST_F(Render, LooksAsItDid) {
  make();
  play(0, 5000);
  const Picture now = draw_picture(*viewer_, 640, 480, {});
  const std::string file = std::string(TELENANO_SOURCE_DIR) + "/tests/unit/viewer/synthetic_640x480.png";
  if (std::getenv("TELENANO_NEW_PICTURES") != nullptr) write_png(file, now);
  const Picture before = read_png(file);
  ASSERT_EQ(before.rgb.size(), now.rgb.size());
  double sum = 0;
  int far = 0;
  for (std::size_t i = 0; i < now.rgb.size(); ++i) {
    const int difference = std::abs(int{now.rgb[i]} - int{before.rgb[i]});
    sum += difference;
    far += difference > 60;
  }
  const auto count = static_cast<double>(now.rgb.size());
  EXPECT_LT(sum / count, 2.0);
  EXPECT_LT(far / count, 0.01);
}

// A stop withdraws the tip to the top of the workspace, 100 nm above a scan of 15: five times as high in a
// picture whose heights are five times taller.
TEST_F(Render, TheTipStaysInTheOverviewAfterAStop) {
  make();
  play(0, 100);
  recording::Sample s = support::view_sample(100);
  s.station_mode = static_cast<std::uint32_t>(station::Mode::kStopped);
  for (const double z : {40.0, 80.0, 115.0}) {
    s.tip_pos_w_nm = s.tip_target_w_nm = {100, 500, z};
    ++s.reply_sequence;
    port_.samples.push(s);
    viewer_->take_samples();
    draw();
    const Area area = layout().overview;
    view_model::Camera camera = viewer_->shown_overview_camera();
    const Pixel apex = project(camera, in_overview(100, 500, z), area);
    EXPECT_GT(apex.y, area.y_px + 0.05 * area.height_px) << z;
    EXPECT_LT(apex.y, area.y_px + 0.95 * area.height_px) << z;
    EXPECT_GT(apex.x, area.x_px + 0.05 * area.width_px) << z;
    EXPECT_LT(apex.x, area.x_px + 0.95 * area.width_px) << z;
    // And it is drawn there: the sphere above the apex, lit; what is behind it is nearly black.
    const Rgb c = at(project(camera, in_overview(100, 500, z) + Vec3(0, 0, 20), area));
    EXPECT_GT(c.g, 0.3f) << z;
  }
}

TEST_F(Render, AnyStateDrawsWithoutHarm) {
  make();
  const double bad = std::numeric_limits<double>::quiet_NaN();
  recording::Sample s = support::view_sample(5);
  s.tip_pos_w_nm = {bad, bad, bad};
  s.force_w_nn = {bad, 0, bad};
  s.deflection_nm = bad;
  s.velocity_scale = 0;
  s.force_scale = bad;
  s.station_mode = 77;
  s.method = 2;
  s.station_faults = ~0u;
  s.fault_bits = ~0u;
  s.rtt_us = bad;
  port_.samples.push(s);
  viewer_->take_samples();
  frame();
  s.tip_pos_w_nm = {1e300, -1e300, 1e300};
  s.force_w_nn = {1e300, 1e300, -1e300};
  port_.samples.push(s);
  viewer_->take_samples();
  frame();
  play(6, 200);
  frame();
  for (const auto& [wide, high] : {std::pair{64, 48}, {320, 2000}, {3000, 200}}) {
    const Canvas canvas(wide, high, 0);
    canvas.bind();
    ImGui::GetIO().DeltaTime = 1.0f / 60;
    viewer_->draw(wide, high, time_s_ += 0.02, {});
  }
  EXPECT_EQ(glGetError(), static_cast<GLenum>(GL_NO_ERROR));
}

}  // namespace
}  // namespace telenano::viewer
