// The picture itself, drawn without a display: things are where an independent projection puts them, have the
// colours that they should, and the mouse and keys do what the help says.
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

namespace telenano::viewer {
namespace {

using view_model::Rgb;
using view_model::ViewRequest;

constexpr int kWidth = 1000;
constexpr int kHeight = 640;

struct Pixel {
  double x = 0;
  double y = 0;
};

// A pinhole camera, and a parallel one, by hand: no matrix of the product's.
Pixel project(const view_model::Camera& camera, const Vec3& point, const Area& area) {
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
  void press(int key) {
    ImGui::GetIO().KeysDown[key] = true;
    frame();
    ImGui::GetIO().KeysDown[key] = false;
    frame();
  }

  std::optional<OffscreenContext> context_;
  ViewFacts facts_;
  view_model::ViewPort port_;
  std::optional<Viewer> viewer_;
  std::optional<Canvas> canvas_;
  Picture picture_;
  double time_s_ = 0;
};

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

TEST_F(Render, KeysAskForWhatTheHelpSays) {
  make();
  play(0, 100);
  frame();
  press(GLFW_KEY_ESCAPE);
  ASSERT_EQ(asked().value().kind, ViewRequest::Kind::kStop);
  press(GLFW_KEY_R);
  ASSERT_EQ(asked().value().kind, ViewRequest::Kind::kClearStop);
  press(GLFW_KEY_M);
  ASSERT_EQ(asked().value().kind, ViewRequest::Kind::kMarker);
  press(GLFW_KEY_3);
  const ViewRequest method = asked().value();
  EXPECT_EQ(method.kind, ViewRequest::Kind::kMethod);
  EXPECT_EQ(method.method, control::kAllMethods[2]);
  press(GLFW_KEY_7);  // the one in use
  EXPECT_FALSE(asked());
  press(GLFW_KEY_P);
  EXPECT_TRUE(viewer_->take_picture_wanted());
  EXPECT_FALSE(viewer_->take_picture_wanted());
  ImGui::GetIO().KeysDown[GLFW_KEY_C] = true;
  frame();
  EXPECT_EQ(port_.buttons.load(), static_cast<std::uint32_t>(device::kButtonClutch));
  ImGui::GetIO().KeysDown[GLFW_KEY_C] = false;
  frame();
  EXPECT_EQ(port_.buttons.load(), 0u);
}

TEST_F(Render, AMethodThatIsNotSafeHereBringsItsScalingWithIt) {
  facts_.region.impedance_bound[0] = 5;  // alpha_v alpha_F is 20
  make();
  play(0, 10);
  frame();
  press(GLFW_KEY_1);
  const ViewRequest scaling = asked().value();
  ASSERT_EQ(scaling.kind, ViewRequest::Kind::kScaling);
  EXPECT_LE(scaling.scaling.impedance(), 5);
  EXPECT_EQ(asked().value().kind, ViewRequest::Kind::kMethod);
}

TEST_F(Render, AMethodThatTheServerDoesNotOfferIsNotAskedFor) {
  facts_.method_offered[5] = false;
  make();
  play(0, 10);
  frame();
  press(GLFW_KEY_6);
  EXPECT_FALSE(asked());
}

// The next task that fits into the hand's box; and while the mouse leads the hand, a drag holds it.
TEST_F(Render, TasksGoRoundAndThoseThatDoNotFitAreLeftOut) {
  facts_.hand_box_half_m = Vec3::Constant(0.05);
  facts_.tasks = {{"indent", "press", Vec3(0, 0, 45)},
                  {"scan", "lines", Vec3(20, 20, 45)},
                  {"wide", "too wide", Vec3(60, 0, 45)},  // alpha_v is 1e-6: 60 mm
                  {"free hand", "your mouse leads it", Vec3::Zero(), true}};
  make();
  play(0, 100);
  frame();
  press(GLFW_KEY_T);
  ViewRequest request = asked().value();
  ASSERT_EQ(request.kind, ViewRequest::Kind::kTask);
  EXPECT_EQ(request.task, 1);
  port_.task.store({1, false, 2, 10});
  press(GLFW_KEY_T);
  EXPECT_EQ(asked().value().task, 3);
  const auto grip = [&] {
    ImGui::GetIO().KeysDown[GLFW_KEY_SPACE] = true;
    frame();
    const std::uint32_t buttons = viewer_->hand().buttons(time_s_);
    ImGui::GetIO().KeysDown[GLFW_KEY_SPACE] = false;
    frame();
    return buttons & device::kButtonDeadman;
  };
  EXPECT_EQ(grip(), 0u);
  port_.task.store({3, false, 0, std::numeric_limits<double>::infinity()});
  EXPECT_NE(grip(), 0u);
  port_.task.store({0, true, 0, 10});
  EXPECT_EQ(grip(), 0u);
  EXPECT_FALSE(asked());
}

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
  ImGui::GetIO().KeyShift = true;
  press(GLFW_KEY_LEFT);
  ImGui::GetIO().KeyShift = false;
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
  ImGui::GetIO().KeyCtrl = true;
  press(GLFW_KEY_Q);
  ImGui::GetIO().KeyCtrl = false;
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

TEST_F(Render, StopIsABigButtonInTheCorner) {
  make();
  play(0, 10);
  frame();
  frame();
  ImGuiIO& io = ImGui::GetIO();
  io.MousePos = {kWidth - 100.0f, 30};
  frame();
  io.MouseDown[0] = true;
  frame();
  io.MouseDown[0] = false;
  frame();
  ASSERT_EQ(asked().value().kind, ViewRequest::Kind::kStop);
}

// Dragging the slider of alpha_F to its end asks for the border, not for the end; and once, when let go.
TEST_F(Render, SlidersEndAtTheBorderOfTheSafeRegion) {
  make();
  play(0, 10);
  for (int i = 0; i < 3; ++i) frame();
  ImGuiIO& io = ImGui::GetIO();
  // Searched downwards in the panel: the first row at which holding the button at the right end asks for a
  // force.
  std::optional<ViewRequest> request;
  for (int y = 100; y < 400 && !(request && request->scaling.force != 2e7); y += 5) {
    io.MousePos = {kWidth - 30.0f, static_cast<float>(y)};
    frame();
    io.MouseDown[0] = true;
    frame();
    frame();
    io.MouseDown[0] = false;
    frame();
    if (const auto r = asked(); r && r->kind == ViewRequest::Kind::kScaling && r->scaling.velocity == 1e-6)
      request = r;
    while (asked()) {
    }
    press(GLFW_KEY_ENTER);  // nothing: lets a list that was opened close
  }
  ASSERT_TRUE(request);
  EXPECT_NEAR(request->scaling.impedance(), 30, 1e-6);
  EXPECT_LE(request->scaling.impedance(), 30);
}

TEST_F(Render, DraggingInTheSectionMovesTheHandByWhatThePictureSays) {
  facts_.mouse_is_hand = true;
  make();
  play(0, 1500);
  viewer_->settle(100);
  ImGuiIO& io = ImGui::GetIO();
  const Area area = layout().close_up;
  io.MousePos = {static_cast<float>(area.x_px + 60), static_cast<float>(area.y_px + 200)};
  frame();
  io.MouseDown[0] = true;
  frame();
  EXPECT_EQ(viewer_->hand().buttons(time_s_), static_cast<std::uint32_t>(device::kButtonDeadman));
  const double nm_per_px = 2 * viewer_->close_up_camera().half_height_nm / area.height_px;
  io.MousePos = {io.MousePos.x + 30, io.MousePos.y - 12};
  frame();
  // 1 nm of the tip is 1 mm of the hand.
  EXPECT_NEAR(viewer_->hand().hand_pos_h_m().x(), 30 * nm_per_px * 1e-3, 1e-9);
  EXPECT_NEAR(viewer_->hand().hand_pos_h_m().z(), 12 * nm_per_px * 1e-3, 1e-9);
  EXPECT_EQ(viewer_->hand().hand_pos_h_m().y(), 0);
  io.MouseDown[0] = false;
  frame();
  EXPECT_EQ(viewer_->hand().buttons(time_s_), 0u);
}

// A touch screen, a tablet or a remote desktop puts the pointer down far from where it was last: between two
// frames it jumps and presses. The press is where the hand takes hold; the way there was nobody's drag.
TEST_F(Render, APressAnchorsThePointerAndNeverJumps) {
  facts_.mouse_is_hand = true;
  make();
  play(0, 1500);
  viewer_->settle(100);
  ImGuiIO& io = ImGui::GetIO();
  for (const Area& area : {layout().close_up, layout().overview}) {
    io.MousePos = {static_cast<float>(area.x_px + 40), static_cast<float>(area.y_px + 60)};
    frame();
    io.MousePos = {static_cast<float>(area.x_px + 160), static_cast<float>(area.y_px + 380)};
    io.MouseDown[0] = true;
    frame();
    EXPECT_NE(viewer_->hand().buttons(time_s_) & device::kButtonDeadman, 0u);
    EXPECT_EQ(viewer_->hand().hand_pos_h_m().norm(), 0) << "moved by the way to the press";
    io.MousePos.x += 10;
    frame();
    EXPECT_GT(viewer_->hand().hand_pos_h_m().norm(), 0) << "a drag moves it";
    io.MouseDown[0] = false;
    frame();
    time_s_ += 1;  // back in the middle
    frame();
  }
}

// Let go and pressed elsewhere within one frame looks like a button that was held all the time.
TEST_F(Render, APressThatIsOnlySeenByTheWindowAnchorsToo) {
  facts_.mouse_is_hand = true;
  make();
  play(0, 1500);
  viewer_->settle(100);
  ImGuiIO& io = ImGui::GetIO();
  const Area area = layout().close_up;
  io.MousePos = {static_cast<float>(area.x_px + 40), static_cast<float>(area.y_px + 60)};
  frame();
  io.MouseDown[0] = true;
  frame();
  io.MousePos = {static_cast<float>(area.x_px + 160), static_cast<float>(area.y_px + 380)};
  viewer_->note_press(io.MousePos);
  frame();
  EXPECT_EQ(viewer_->hand().hand_pos_h_m().norm(), 0);
  io.MousePos.y -= 8;
  frame();
  EXPECT_GT(viewer_->hand().hand_pos_h_m().z(), 0);
}

// Where a frame is late, the pointer has come by a jump, gone down and gone on since the last one: the way
// after the press is the drag, as if it had been drawn in time.
TEST_F(Render, WhatFollowsAPressWithinOneFrameIsADrag) {
  facts_.mouse_is_hand = true;
  const auto drag_of = [&](bool late) {
    make();
    play(0, 1500);
    viewer_->settle(1000);
    ImGuiIO& io = ImGui::GetIO();
    io.MouseDown[0] = false;
    const Area area = layout().close_up;
    io.MousePos = {static_cast<float>(area.x_px + 40), static_cast<float>(area.y_px + 60)};
    frame();
    io.MousePos = {static_cast<float>(area.x_px + 160), static_cast<float>(area.y_px + 380)};
    io.MouseDown[0] = true;
    viewer_->note_press(io.MousePos);
    if (!late) frame();
    io.MousePos.x += 12;
    io.MousePos.y += 30;
    frame();
    io.MouseDown[0] = false;
    return viewer_->hand().hand_pos_h_m();
  };
  const Vec3 in_time = drag_of(false);
  const Vec3 late = drag_of(true);
  EXPECT_GT(in_time.x(), 0);
  EXPECT_LT(in_time.z(), 0);
  EXPECT_LT((late - in_time).norm(), 1e-6 * in_time.norm())
      << late.transpose() << ", " << in_time.transpose();
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

// Every letter of the frame as the driver gets it, in the states that put the most words on the screen.
TEST_F(Render, NoWordLiesOnAnotherAtAnySize) {
  facts_.mouse_is_hand = true;
  facts_.give_up_s = 10;
  for (const std::string what : {"scan", "plane", "region"}) {
    make(what != "plane");
    play(0, 5000);
    if (what == "region") press(GLFW_KEY_Z);
    for (const int state : {0, 1, 2, 3, 4, 5, 6, 7}) {
      recording::Sample s = support::view_sample(5000 + state);
      if (state >= 5) s.reply_age_ms = 3200;
      if (state == 6) s.station_mode = static_cast<std::uint32_t>(station::Mode::kHeld);
      if (state == 7) {
        s.station_mode = static_cast<std::uint32_t>(station::Mode::kStopped);
        s.station_faults = station::kFaultStopPressed;
        s.limit_flags = recording::kLimitObserves;
        s.measurement_age_ms = 1;
      }
      if (state == 1) s.force_w_nn = {-126.3, 88.8, -101.7};
      if (state == 2) {
        s.tip_pos_w_nm = s.tip_target_w_nm = {300, 300, 115};
        s.station_mode = static_cast<std::uint32_t>(station::Mode::kStopped);
        s.station_faults = station::kFaultStopPressed;
      }
      if (state == 3) s.tip_pos_w_nm = s.tip_target_w_nm = {30, 30, 4};
      if (state == 4) s.rtt_us = 126'000;
      s.particle_pos_w_nm = recording::xyz(Vec3(s.tip_pos_w_nm[0] + 20, s.tip_pos_w_nm[1], 15));
      s.particle_radius_nm = state > 2 ? 20.0 : 0.0;
      s.particle_state = static_cast<std::int64_t>(link::ParticleStatus::kPushed);
      for (int i = 0; i < 300; ++i) {
        ++s.tick;
        s.time_s += 1e-3;
        ++s.reply_sequence;
        port_.samples.push(s);
      }
      viewer_->take_samples();
      for (const auto& [wide, high] : {std::pair{640, 480}, {800, 600}, {1280, 800}}) {
        draw_picture(*viewer_, wide, high, {});
        EXPECT_EQ(overlaps(drawn_glyphs(ink(palette::kBackground, 0.75f))), "")
            << what << ", state " << state << ", " << wide << " x " << high;
        if (const char* folder = std::getenv("TELENANO_LOOK")) {
          const Picture look = draw_picture(*viewer_, wide, high, {});
          write_png(
              std::string(folder) + "/" + what + std::to_string(state) + "_" + std::to_string(wide) + ".png",
              look);
        }
      }
    }
  }
}

// Letters that lie beyond an edge are not drawn at all, or in part: what a wide window says must be said by
// every other, and no letter may be cut. The numbers are the longest that a session can have.
TEST_F(Render, NoNumberOfThePanelIsCutAtAnySizeAndScale) {
  facts_.mouse_is_hand = false;
  facts_.can_record = true;
  facts_.practice = link::PracticeLink{};
  for (const float scale : {1.0f, 1.5f, 2.0f}) {
    viewer_.reset();
    viewer_.emplace(facts_, view_model::Ground(support::view_scan(64)), port_, scale);
    play(0, 1000);
    recording::Sample s = support::view_sample(1000);
    s.tip_pos_w_nm = {-1234.5, -1234.5, -123.45};
    s.force_w_nn = {-1234.6, -1234.6, -1234.6};
    s.deflection_nm = -12.34;
    s.hand_force_applied_h_n[2] = -11.23;
    s.energy_j = -0.12345;
    s.rtt_us = 123456;
    s.lost = 1234567;
    s.jitter_us = 123456;
    s.force_age_ms = 123.4;
    s.lateness_us = 123.4;
    s.overruns = 1234567;
    port_.samples.push(s);
    port_.contact.store({1.234, 123.4, true});
    viewer_->take_samples();
    // Top and bottom of a panel that scrolls, each without blanks.
    // STOP is in sight wherever it scrolls.
    const auto panel_text = [&](int wide, int high) {
      std::string text;
      std::string cut;
      const Layout where = layout_of(wide, high, scale, Views::kBoth);
      const Canvas canvas(wide, high, 0);
      ImGuiIO& io = ImGui::GetIO();
      for (const float wheel : {100.0f, -100.0f}) {
        for (int i = 0; i < 4; ++i) {
          canvas.bind();
          io.DeltaTime = 1.0f / 60;
          io.MousePos = {static_cast<float>(where.panel.x_px) + 40 * scale,
                         static_cast<float>(high) - 40 * scale};
          io.MouseWheel = i == 1 ? wheel : 0;
          viewer_->draw(wide, high, time_s_ += 1.0 / 60, {});
        }
        std::string shown;
        for (const Glyph& g : drawn_glyphs(ink(palette::kBackground, 0.75f))) {
          if (g.x0 < static_cast<float>(where.panel.x_px)) continue;
          shown.push_back(g.letter < 128 ? static_cast<char>(g.letter) : '?');
          if (g.cut) cut.push_back(shown.back());
        }
        EXPECT_NE(shown.find("STOP(Esc)"), std::string::npos) << shown;
        text += shown + " | ";
        if (const char* folder = std::getenv("TELENANO_LOOK"); folder != nullptr && wheel < 0)
          write_png(fmt::format("{}/panel_{}x{}_{:g}.png", folder, wide, high, scale),
                    {wide, high, canvas.read_rgb()});
      }
      EXPECT_EQ(cut, "") << wide << " x " << high << ", scale " << scale << ": " << text;
      return text;
    };
    for (const auto& [wide, high] : {std::pair{640, 480}, {900, 600}, {1280, 800}}) {
      // The least window of a dense screen has as many of its points.
      const std::string text = panel_text(static_cast<int>(static_cast<float>(wide) * scale),
                                          static_cast<int>(static_cast<float>(high) * scale));
      for (const std::string words :
           {"-1234.5-1234.5-123.45nm", "-1235-1235-1235", "bent-12.3nm", "-11.23of9.6N", "-123.45mJputin",
            "RTT123ms,", "lost1234567", "123ms,", "force123msold", "123?s,", "1234567overruns", "1.23nm"}) {
        EXPECT_NE(text.find(words), std::string::npos)
            << words << ", " << wide << " x " << high << ", scale " << scale << ": " << text;
      }
    }
  }
}

// Words grow as far as the window has room for all of them: in the least window not at all.
TEST_F(Render, WordsAreAsLargeAsAskedForAndLieOnNoOthers) {
  facts_.mouse_is_hand = true;
  facts_.can_record = true;
  facts_.recording.clear();
  make();
  play(0, 5000);
  const auto tallest = [&](int wide, int high) {
    draw_picture(*viewer_, wide, high, {});
    const std::vector<Glyph> glyphs = drawn_glyphs(ink(palette::kBackground, 0.75f));
    EXPECT_EQ(overlaps(glyphs), "") << wide << " x " << high << ", text " << viewer_->text_size();
    float most = 0;
    for (const Glyph& g : glyphs) most = std::max(most, g.y1 - g.y0);
    return most;
  };
  const float least = tallest(640, 480);
  const float first = tallest(1280, 960);
  EXPECT_NEAR(first, least, 1);
  viewer_->set_text_size(1.5);
  EXPECT_NEAR(tallest(1280, 960), 1.5 * first, 2);
  EXPECT_NEAR(tallest(640, 480), least, 1);
  viewer_->set_text_size(9);
  EXPECT_NEAR(tallest(1280, 960), 2 * first, 2) << "twice 640 x 480";
}

// The mouse goes farther against a push, in the picture as in the hand.
TEST_F(Render, AForceHoldsThePointerBackWhereThereAreNoMotors) {
  const auto drag = [&](double force_nn, bool motors) {
    facts_.mouse_is_hand = true;
    facts_.shows_force = motors;
    facts_.hand_force_limit_n = 4;
    make();
    recording::Sample s = support::view_sample(1500);
    s.force_scale = 1e8;  // 4 N are 40 nN: at 10 nN the pointer goes twice as far
    s.force_w_nn = {0, 0, force_nn};
    port_.samples.push(s);
    viewer_->take_samples();
    viewer_->settle(1000);
    ImGuiIO& io = ImGui::GetIO();
    io.MouseDown[0] = false;
    const Area area = layout().close_up;
    io.MousePos = {static_cast<float>(area.x_px + 40), static_cast<float>(area.y_px + 60)};
    frame();
    io.MouseDown[0] = true;
    frame();
    io.MousePos.y += 20;
    frame();
    io.MouseDown[0] = false;
    return viewer_->hand().hand_pos_h_m().z();
  };
  const double free_m = drag(0, false);
  EXPECT_LT(free_m, 0);
  EXPECT_NEAR(drag(10, false), free_m / 2, 1e-3 * std::abs(free_m));
  EXPECT_NEAR(drag(30, false), free_m / 4, 1e-3 * std::abs(free_m));
  EXPECT_NEAR(drag(-30, false), free_m, 1e-3 * std::abs(free_m)) << "a pull helps on the way down";
  EXPECT_NEAR(drag(30, true), free_m, 1e-3 * std::abs(free_m)) << "motors say it";
}

// What is told in the picture, read back letter by letter.
TEST_F(Render, TellsWhatAPersonHasToKnow) {
  facts_.mouse_is_hand = true;
  facts_.give_up_s = 10;
  facts_.surface_doubt = "not the scan of 'flakes'";
  make();
  play(0, 1500);
  recording::Sample s = support::view_sample(1500);
  s.force_w_nn = {12.6, -0.1, 1.7};
  const auto shown = [&] {
    s.time_s += 1e-3;
    ++s.tick;
    port_.samples.push(s);
    viewer_->take_samples();
    draw_picture(*viewer_, 640, 480, {});
    return drawn_text(drawn_glyphs(ink(palette::kBackground, 0.75f)));
  };
  const auto has = [](const std::string& text, const std::string& words) {
    return text.find(words) != std::string::npos;
  };
  std::string text = shown();
  EXPECT_TRUE(has(text, "push12.7nN")) << text;
  EXPECT_TRUE(has(text, "x+12.6y-0.1z+1.7nN")) << text;
  EXPECT_TRUE(has(text, "notthescanof'flakes'")) << text;
  EXPECT_TRUE(has(text, "SIM"));
  EXPECT_FALSE(has(text, "STALE"));
  EXPECT_FALSE(has(text, "Observing"));
  s.limit_flags = recording::kLimitObserves;
  text = shown();
  EXPECT_TRUE(has(text, "Observing:thetipisanothersession's")) << text;
  s.limit_flags = 0;
  s.reply_age_ms = 3200;
  s.time_s = 60;
  text = shown();
  EXPECT_TRUE(has(text, "STALE3.2s,7sleft")) << text;
  EXPECT_TRUE(has(text, "3.2sold")) << text;
  EXPECT_TRUE(has(text, "thesessionendsin7s")) << text;
  s.reply_age_ms = 1;
  shown();
  // The hand's box: 55 nm at this scale.
  ImGuiIO& io = ImGui::GetIO();
  const Area area = layout().close_up;
  io.MousePos = {static_cast<float>(area.x_px + 60), static_cast<float>(area.y_px + 60)};
  frame();
  io.MouseDown[0] = true;
  frame();
  for (int i = 0; i < 20; ++i) {
    io.MousePos.x += 300;
    frame();
  }
  text = drawn_text(drawn_glyphs(ink(palette::kBackground, 0.75f)));
  EXPECT_TRUE(has(text, "byatmost55.0nm")) << text;
  io.MouseDown[0] = false;
  frame();
  viewer_->end({true, {"the server at 127.0.0.1:5100 has been silent for 10 s", "after 63.0 s"}});
  text = shown();
  EXPECT_TRUE(has(text, "Thesessionhasended")) << text;
  EXPECT_TRUE(has(text, "hasbeensilentfor10s")) << text;
  EXPECT_FALSE(has(text, "STOP")) << text;
  while (asked()) {
  }
  press(GLFW_KEY_ESCAPE);
  EXPECT_FALSE(asked()) << "there is nobody to ask";
  io.KeyCtrl = true;
  press(GLFW_KEY_Q);
  io.KeyCtrl = false;
  EXPECT_TRUE(viewer_->quit_wanted());
}

// Down in 2 s and the same way up: the pull is 3 nN at the surface, 0.06 nN less a step of the tip farther
// (at most 25 pm a row, exp(-0.025/2)), and nothing is lost but what the grid's heights differ from the
// formula.
TEST_F(Render, FShowsForceOverDistanceWithNumbers) {
  make();
  const auto text = [&] {
    draw_picture(*viewer_, 1280, 800, {});
    return drawn_text(drawn_glyphs(ink(palette::kBackground, 0.75f)));
  };
  const auto has = [](const std::string& shown, const std::string& words) {
    return shown.find(words) != std::string::npos;
  };
  EXPECT_FALSE(has(text(), "overdistance"));
  press(GLFW_KEY_F);
  EXPECT_TRUE(has(text(), "Force[nN]overdistance[nm]"));
  EXPECT_TRUE(has(text(), "notouchyet"));
  play(0, 2000);
  EXPECT_TRUE(has(text(), "retract:tocome")) << text();
  for (std::int64_t i = 0; i < 2000; ++i) {
    recording::Sample s = support::view_sample(2000 - i);
    s.tick = 2000 + i;
    s.time_s = 1e-3 * static_cast<double>(s.tick);
    s.reply_sequence = s.tick + 1;
    port_.samples.push(s);
  }
  viewer_->take_samples();
  const std::string shown = text();
  EXPECT_TRUE(has(shown, "approach:mostpull")) << shown << ": a lever this stiff does not leap";
  EXPECT_TRUE(has(shown, "retract:pull-off")) << shown;
  const auto at = shown.find("retract:pull-off");
  ASSERT_NE(at, std::string::npos);
  EXPECT_NEAR(std::strtod(shown.c_str() + at + std::string("retract:pull-off").size(), nullptr), -3, 0.06)
      << shown;
  EXPECT_TRUE(has(shown, "lost0.0aJ")) << shown;
  EXPECT_FALSE(viewer_->take_data_wanted());
  press(GLFW_KEY_D);
  EXPECT_TRUE(viewer_->take_data_wanted());
  EXPECT_FALSE(viewer_->take_data_wanted()) << "once";
  EXPECT_NE(viewer_->data().find("# pull-off: -"), std::string::npos);
  if (const char* folder = std::getenv("TELENANO_LOOK")) {
    for (const auto& [wide, high] : {std::pair{640, 480}, {1280, 800}})
      write_png(std::string(folder) + "/force_" + std::to_string(wide) + ".png",
                draw_picture(*viewer_, wide, high, {}));
  }
  press(GLFW_KEY_F);
  EXPECT_FALSE(has(text(), "overdistance"));
}

// A slow picture sees both keys at once.
TEST_F(Render, ANoteAndTheWayOutInOneFrameAreBothHeard) {
  facts_.recording = "r.h5";
  make();
  play(0, 1);
  ImGuiIO& io = ImGui::GetIO();
  io.KeyMap[ImGuiKey_Enter] = GLFW_KEY_ENTER;
  press(GLFW_KEY_N);
  frame();
  io.AddInputCharactersUTF8("it held on");
  frame();
  view_model::Note note;
  ASSERT_FALSE(port_.notes.pop(note));
  io.KeysDown[GLFW_KEY_ENTER] = true;
  io.KeyCtrl = true;
  press(GLFW_KEY_Q);
  io.KeyCtrl = false;
  io.KeysDown[GLFW_KEY_ENTER] = false;
  frame();
  ASSERT_TRUE(port_.notes.pop(note));
  EXPECT_STREQ(note.text.data(), "it held on");
  const auto request = asked();
  ASSERT_TRUE(request);
  EXPECT_EQ(request->kind, ViewRequest::Kind::kQuit);
  // And while one is written.
  press(GLFW_KEY_N);
  io.KeyCtrl = true;
  press(GLFW_KEY_Q);
  io.KeyCtrl = false;
  EXPECT_TRUE(asked());
}

TEST_F(Render, TheSurfaceThatIsDrawnIsWhatSSaves) {
  make();
  play(0, 1);
  press(GLFW_KEY_S);
  EXPECT_TRUE(viewer_->take_surface_wanted());
  EXPECT_FALSE(viewer_->take_surface_wanted()) << "once";
  const surface::HeightGrid scan = support::view_scan(256);
  const surface::Scan saved =
      surface::parse_gsf(surface::format_gsf(viewer_->drawn_surface(), "s.gsf"), "s.gsf");
  EXPECT_EQ(saved.title, facts_.scene_name);
  const surface::HeightGrid grid = surface::heights_in_frame_w(saved);
  EXPECT_NEAR(grid.x_first_nm, scan.x_first_nm, 1e-9);
  ASSERT_EQ(grid.z_nm.size(), scan.z_nm.size());
  for (std::size_t i = 0; i < scan.z_nm.size(); ++i) ASSERT_NEAR(grid.z_nm[i], scan.z_nm[i], 1e-5) << i;
  // A plane has nothing to save, and says so.
  make(false);
  press(GLFW_KEY_S);
  EXPECT_FALSE(viewer_->take_surface_wanted());
}

// From the least window to 4K, at the scales of a screen.
TEST_F(Render, WordsOfTheForceCurveLieOnNoOthersAtAnySizeAndScale) {
  for (const float scale : {1.0f, 1.5f, 2.0f}) {
    viewer_.reset();
    viewer_.emplace(facts_, view_model::Ground(support::view_scan(256)), port_, scale);
    viewer_->show_force_curve(true);
    play(0, 2000);
    for (const auto& [wide, high] : {std::pair{640, 480}, {1280, 800}, {3840, 2160}}) {
      const Canvas canvas(wide, high, 0);
      canvas.bind();
      ImGui::GetIO().DeltaTime = 1.0f / 60;
      for (int i = 0; i < 2; ++i) viewer_->draw(wide, high, i / 60.0, {});
      EXPECT_EQ(overlaps(drawn_glyphs(ink(palette::kBackground, 0.75f))), "")
          << wide << " x " << high << ", scale " << scale;
    }
  }
}

TEST_F(Render, DraggingTheOverviewTurnsItWhenTheMouseIsNoHand) {
  make();
  play(0, 10);
  ImGuiIO& io = ImGui::GetIO();
  io.MousePos = {200, 300};
  frame();
  io.MouseDown[0] = true;
  frame();
  const double before = viewer_->overview_camera().azimuth_deg;
  io.MousePos = {260, 300};
  frame();
  EXPECT_LT(viewer_->overview_camera().azimuth_deg, before);
  EXPECT_EQ(viewer_->hand().hand_pos_h_m().norm(), 0);
  EXPECT_EQ(viewer_->hand().buttons(time_s_), 0u);
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
