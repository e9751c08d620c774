// Nonsense in the fields of the start screen: nothing of it is lost, each has its one line right under it, and what begins
// a session stays in sight.
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/master/viewer/gl.h"
#include "telenano/master/viewer/keys.h"
#include "telenano/master/viewer/offscreen.h"
#include "telenano/master/viewer/png.h"
#include "telenano/master/viewer/start_screen.h"
#include "tests/unit/viewer/glyphs.h"

namespace telenano::viewer {
namespace {

class StartFields : public ::testing::Test {
 protected:
  void SetUp() override {
    try {
      context_.emplace();
    } catch (const RunError& error) {
      GTEST_SKIP() << error.what();
    }
    facts_.hands = {{"mouse", "mouse, in the pictures of the window", "", false},
                    {"sim", "simulated omega.3 with a simulated hand", "", true}};
    facts_.seen = {{"lab.example.org:5100", "/home/somebody/a##b.key", "flakes"}};
    facts_.command_line = "telenano-master run";
  }
  StartScreen::Wish draw(StartScreen& screen, int wide, int high) {
    canvas_.emplace(wide, high, 0);
    canvas_->bind();
    ImGuiIO& io = ImGui::GetIO();
    io.DeltaTime = 1.0f / 30;
    const StartScreen::Wish wish = screen.draw(wide, high, facts_, choice_);
    glyphs_ = drawn_glyphs(ink(palette::kBackground, 0.75f));
    text_ = drawn_text(glyphs_);
    return wish;
  }
  bool says(const std::string& words) const { return text_.find(words) != std::string::npos; }
  /// The first letter of these words, the first of them that begins left of `left_of`; null: they are not there.
  const Glyph* glyph_of(const std::string& words, float left_of = 1e9f) const {
    for (auto at = text_.find(words); at != std::string::npos; at = text_.find(words, at + 1))
      if (glyphs_[at].x0 < left_of) return &glyphs_[at];
    return nullptr;
  }
  /// That this line stands under the field of this name, where the field begins, and is whole.
  void expect_under(const std::string& field, const std::string& line, float scale) {
    const Glyph* const name = glyph_of(field, 40 * scale);
    const Glyph* const told = glyph_of(line);
    ASSERT_TRUE(name != nullptr && told != nullptr) << field << ": " << line << " in " << text_;
    EXPECT_GT(told->y0, name->y1) << field;
    EXPECT_LT(told->y0, name->y0 + 36 * scale) << field << ": the next row at most";
    EXPECT_NEAR(told->x0, name->x0 + 110 * scale, 3 * scale) << field;
    for (std::size_t i = 0; i < line.size(); ++i) EXPECT_FALSE(told[i].cut) << line << ", letter " << i;
  }
  void look(const std::string& name, int wide, int high) const {
    if (const char* folder = std::getenv("TELENANO_LOOK"))
      write_png(std::string(folder) + "/" + name + ".png", {wide, high, canvas_->read_rgb()});
  }

  std::optional<OffscreenContext> context_;
  StartFacts facts_;
  view_model::StartChoice choice_;
  std::optional<Canvas> canvas_;
  std::vector<Glyph> glyphs_;
  std::string text_;
};

TEST_F(StartFields, EachFaultStandsUnderItsFieldAtEverySize) {
  choice_.server = "lab:99999";
  choice_.key = std::string(10000, 'k');
  choice_.identity = "omega.id";
  choice_.record = true;
  choice_.recording.clear();
  choice_.server_scene = std::string(300, 's');
  facts_.faults.identity = "This is a folder: name a file in it";
  facts_.command_line = "telenano-master run --key " + choice_.key;
  for (const auto& [text, scale] : {std::pair{1.0, 1.0f}, {1.5, 1.0f}, {2.0, 1.0f}, {1.0, 2.0f}}) {
    choice_.text_size = text;
    const int wide = static_cast<int>(900 * text * scale);
    const int high = static_cast<int>(700 * text * scale);
    SCOPED_TRACE(std::to_string(wide) + " x " + std::to_string(high));
    StartScreen screen(scale);
    for (int i = 0; i < 4; ++i) draw(screen, wide, high);
    look("start_faults_" + std::to_string(wide), wide, high);
    const auto s = scale * static_cast<float>(text);
    expect_under("Server", "Port'99999'isnotanumberfrom1to65535", s);
    expect_under("Keyfile", "Akeyfileorakeypairofitsown:clearone", s);
    expect_under("Identity", "Thisisafolder:nameafileinit", s);
    expect_under("Server'skey", "Nametheserver'skeytoo", s);
    expect_under("Sample", "Asample'snamehasatmost255characters", s);
    expect_under("Recording", "Nametherecording'sfile,orswitchitoff", s);
    EXPECT_EQ(overlaps(glyphs_), "");
    EXPECT_TRUE(says("Correctthisfieldfirst:Server")) << text_;
    EXPECT_TRUE(says("Start(Enter)") && says("Close")) << text_;
    EXPECT_TRUE(says("a##b.key")) << "whole: " << text_;
  }
}

// In the smallest window the fields scroll, and the foot leads to them.
TEST_F(StartFields, HoweverLongTheTextsAreTheSessionsButtonsStayInSight) {
  const std::string longest(10000, 'w');
  choice_.server = longest + "\xff\x01";
  choice_.key = choice_.identity = choice_.server_key = choice_.server_scene = choice_.recording = longest;
  choice_.record = true;
  facts_.trouble = longest;
  facts_.command_line = longest;
  facts_.seen.front().key = longest;
  StartScreen screen(1);
  for (const auto& [wide, high] : {std::pair{640, 480}, {1280, 800}}) {
    for (int i = 0; i < 4; ++i) EXPECT_EQ(draw(screen, wide, high), StartScreen::Wish::kNone);
    look("start_longest_" + std::to_string(wide), wide, high);
    EXPECT_TRUE(says("Correctthisfieldfirst:Server")) << wide;
    EXPECT_TRUE(says("Start(Enter)") && says("Copythecommand") && says("Close")) << wide;
    EXPECT_TRUE(says("Server")) << "the fields have a place too";
    for (const Glyph& g : glyphs_) EXPECT_LE(g.y1, static_cast<float>(high));
    set_key(GLFW_KEY_ENTER, true);
    EXPECT_EQ(draw(screen, wide, high), StartScreen::Wish::kNone) << "and Enter begins nothing";
    set_key(GLFW_KEY_ENTER, false);
  }
}

// Dear ImGui from 1.89 on presses by Enter what has the focus: the box beside the recording would be cleared.
TEST_F(StartFields, EnterBeginsAndPressesNothingElse) {
  choice_.server = "127.0.0.1:5100";
  choice_.record = false;
  StartScreen screen(1);
  const auto press = [&](int key) {
    set_key(key, true);
    const StartScreen::Wish wish = draw(screen, 1280, 800);
    set_key(key, false);
    draw(screen, 1280, 800);
    return wish;
  };
  for (int i = 0; i < 3; ++i) draw(screen, 1280, 800);
  press(GLFW_KEY_UP);
  press(GLFW_KEY_SPACE);
  EXPECT_TRUE(choice_.record) << "the box, which is above Start";
  EXPECT_EQ(press(GLFW_KEY_ENTER), StartScreen::Wish::kStart) << text_;
  EXPECT_TRUE(choice_.record);
  press(GLFW_KEY_SPACE);
  EXPECT_FALSE(choice_.record) << "and it has the focus still";
}

TEST_F(StartFields, WhatIsTypedIsKeptHoweverMuchItIs) {
  StartScreen screen(1);
  for (int i = 0; i < 3; ++i) draw(screen, 1280, 800);
  const Glyph* const server = glyph_of("127.0.0.1:5100");
  ASSERT_NE(server, nullptr);
  ImGuiIO& io = ImGui::GetIO();
  io.MousePos = {server->x0 + 300, server->y0 + 5};
  draw(screen, 1280, 800);
  io.MouseDown[0] = true;
  draw(screen, 1280, 800);
  io.MouseDown[0] = false;
  draw(screen, 1280, 800);
  for (int i = 0; i < 100; ++i) {
    for (int k = 0; k < 100; ++k) io.AddInputCharacter(k % 2 == 0 ? 'x' : 0xFC);
    draw(screen, 1280, 800);
  }
  draw(screen, 1280, 800);
  EXPECT_EQ(choice_.server.size(), std::string("127.0.0.1:5100").size() + 15000)
      << "two bytes each second one";
  EXPECT_TRUE(says("Atmost4095characters,theseare15014")) << text_;
  // Keys that are no text, halves of UTF-16 and what is no character.
  const std::string before = choice_.server;
  for (const unsigned c : {1u, 7u, 8u, 27u, 127u, 0xD800u, 0xE000u, 0x110000u}) io.AddInputCharacter(c);
  draw(screen, 1280, 800);
  EXPECT_TRUE(choice_.server.starts_with(before)) << "nothing before is touched";
  for (const char c : choice_.server) EXPECT_FALSE(static_cast<unsigned char>(c) < 0x20 || c == 0x7F);
}

// A name that no server has confirmed can be left by mouse.
TEST_F(StartFields, ASampleThatTheServerDoesNotHaveCanBeLeft) {
  StartScreen screen(1);
  choice_.server_scene = "nonsense";
  facts_.faults.server_scene = "--server-scene 'nonsense': the server serves only 'flakes'";
  for (int i = 0; i < 3; ++i) draw(screen, 1280, 800);
  ASSERT_TRUE(says("Samplenonsense")) << text_;
  const Glyph* const shown = glyph_of("nonsense");
  ImGuiIO& io = ImGui::GetIO();
  const auto click = [&](ImVec2 at) {
    StartScreen::Wish wish = StartScreen::Wish::kNone;
    io.MousePos = at;
    draw(screen, 1280, 800);
    for (const bool down : {true, false}) {
      io.MouseDown[0] = down;
      if (const auto now = draw(screen, 1280, 800); now != StartScreen::Wish::kNone) wish = now;
    }
    return wish;
  };
  click({shown->x0 + 5, shown->y0 + 4});
  draw(screen, 1280, 800);
  const Glyph* const first = glyph_of("theserver'sfirst");
  ASSERT_NE(first, nullptr) << text_;
  EXPECT_EQ(click({first->x0 + 5, first->y0 + 4}), StartScreen::Wish::kLook);
  EXPECT_EQ(choice_.server_scene, "");
}

}  // namespace
}  // namespace telenano::viewer
