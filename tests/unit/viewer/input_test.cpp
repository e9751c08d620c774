// Keys and mouse do what the help says.
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

TEST_F(Render, KeysAskForWhatTheHelpSays) {
  make();
  play(0, 100);
  frame();
  press(GLFW_KEY_ESCAPE);
  ASSERT_TRUE(stop_asked());
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
  set_key(GLFW_KEY_C, true);
  frame();
  EXPECT_EQ(port_.buttons.load(), static_cast<std::uint32_t>(device::kButtonClutch));
  set_key(GLFW_KEY_C, false);
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
    set_key(GLFW_KEY_SPACE, true);
    frame();
    const std::uint32_t buttons = viewer_->hand().buttons(time_s_);
    set_key(GLFW_KEY_SPACE, false);
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
  ASSERT_TRUE(stop_asked());
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

// A slow picture sees both keys at once.
TEST_F(Render, ANoteAndTheWayOutInOneFrameAreBothHeard) {
  facts_.recording = "r.h5";
  make();
  play(0, 1);
  ImGuiIO& io = ImGui::GetIO();
  press(GLFW_KEY_N);
  frame();
  io.AddInputCharactersUTF8("it held on");
  frame();
  view_model::Note note;
  ASSERT_FALSE(port_.notes.pop(note));
  set_key(GLFW_KEY_ENTER, true);
  set_modifiers(GLFW_MOD_CONTROL);
  press(GLFW_KEY_Q);
  set_modifiers(0);
  set_key(GLFW_KEY_ENTER, false);
  frame();
  ASSERT_TRUE(port_.notes.pop(note));
  EXPECT_STREQ(note.text.data(), "it held on");
  EXPECT_TRUE(quit_asked());
  // And while one is written.
  press(GLFW_KEY_N);
  set_modifiers(GLFW_MOD_CONTROL);
  press(GLFW_KEY_Q);
  set_modifiers(0);
  EXPECT_TRUE(quit_asked());
}

// A slow picture sees whole words at once, in the very next frame after the one that opened the box.
TEST_F(Render, WhatIsTypedBeforeTheNoteIsDrawnIsInIt) {
  facts_.recording = "r.h5";
  facts_.mouse_is_hand = true;
  ImGuiIO* io = nullptr;
  const auto open = [&] {
    make();
    play(0, 1);
    io = &ImGui::GetIO();
    frame();
    set_key(GLFW_KEY_N, true);
    io->AddInputCharacter('n');
    frame();
    set_key(GLFW_KEY_N, false);
  };
  open();
  io->AddInputCharactersUTF8("it held");
  set_key(GLFW_KEY_SPACE, true);
  frame();
  EXPECT_EQ(viewer_->hand().buttons(time_s_) & static_cast<std::uint32_t>(device::kButtonDeadman), 0u)
      << "a space of the note is no hand";
  set_key(GLFW_KEY_SPACE, false);
  io->AddInputCharactersUTF8(" on");
  frame();
  io->AddInputCharactersUTF8("; lets go");
  frame();
  press(GLFW_KEY_ENTER);
  view_model::Note note;
  ASSERT_TRUE(port_.notes.pop(note));
  EXPECT_STREQ(note.text.data(), "it held on; lets go");
  // Enter too.
  open();
  io->AddInputCharactersUTF8("it held on");
  press(GLFW_KEY_ENTER);
  frame();
  ASSERT_TRUE(port_.notes.pop(note));
  EXPECT_STREQ(note.text.data(), "it held on");
  EXPECT_FALSE(viewer_->writes_note());
  // And what comes before a Ctrl that is held when it is drawn.
  open();
  io->AddInputCharactersUTF8("it held on");
  frame();
  frame();
  io->AddInputCharactersUTF8("; lets go");
  set_key(GLFW_KEY_ENTER, true);
  set_modifiers(GLFW_MOD_CONTROL);
  frame();
  set_key(GLFW_KEY_ENTER, false);
  set_modifiers(0);
  ASSERT_TRUE(port_.notes.pop(note));
  EXPECT_STREQ(note.text.data(), "it held on; lets go");
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

// Of a server with one sample there is nothing to choose.
TEST_F(Render, TheSamplesOfAServerWithSeveralAreInThePanelAndAnotherIsChosenByAClick) {
  const auto words = [&] {
    draw_picture(*viewer_, kWidth, kHeight, {});
    return drawn_text(drawn_glyphs(ink(palette::kBackground, 0.75f)));
  };
  make();
  EXPECT_EQ(words().find("Sample:"), std::string::npos);
  facts_.scenes = {facts_.scene_name, "flat PDMS"};
  make();
  EXPECT_NE(words().find("Sample:"), std::string::npos);
  view_model::ViewRequest request;
  EXPECT_FALSE(port_.requests.pop(request)) << "nobody has chosen another";
}

// Asked of a server that can, and with the tip off the sample; else it is said why not, and nobody is asked.
TEST_F(Render, UndoIsAskedOfAServerThatCanWithTheTipOffTheSample) {
  facts_.can_undo = true;
  make();
  recording::Sample s = support::view_sample(10);
  s.contact_state = static_cast<std::uint32_t>(link::ContactState::kFree);
  const auto shown = [&] {
    s.time_s += 1e-3;
    ++s.tick;
    port_.samples.push(s);
    viewer_->take_samples();
  };
  const auto words = [&] {
    draw_picture(*viewer_, kWidth, kHeight, {});
    return drawn_text(drawn_glyphs(ink(palette::kBackground, 0.75f)));
  };
  shown();
  frame();
  EXPECT_NE(words().find("Undothelastmarks"), std::string::npos) << "a button";
  press(GLFW_KEY_U);
  ASSERT_EQ(asked().value().kind, ViewRequest::Kind::kUndo);
  EXPECT_FALSE(asked());
  port_.undo.store({view_model::UndoText::kDone, 1});
  frame();
  EXPECT_NE(words().find("Thelastmarksareundone"), std::string::npos) << words();
  s.contact_state = static_cast<std::uint32_t>(link::ContactState::kContact);
  shown();
  press(GLFW_KEY_U);
  EXPECT_FALSE(asked());
  EXPECT_NE(words().find("liftthetipoff"), std::string::npos) << words();
  s.contact_state = static_cast<std::uint32_t>(link::ContactState::kFree);
  s.limit_flags = recording::kLimitObserves;
  shown();
  for (int i = 0; i < 2; ++i) press(GLFW_KEY_U);
  EXPECT_FALSE(asked()) << "who looks on undoes nothing";
  EXPECT_NE(words().find("Onlywhomovesthetip"), std::string::npos) << words();
  facts_.can_undo = false;
  make();
  shown();
  press(GLFW_KEY_U);
  EXPECT_FALSE(asked());
}

}  // namespace
}  // namespace telenano::viewer
