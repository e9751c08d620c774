// Keys between two frames, as GLFW's callback tells them and as ImGui takes them.
#include "telenano/master/viewer/window_keys.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <gtest/gtest.h>
#include <imgui.h>

#include <string>
#include <utility>

#include "telenano/master/viewer/keys.h"

namespace telenano::viewer {
namespace {

class WindowKeys : public ::testing::Test {
 protected:
  WindowKeys() : context_(ImGui::CreateContext()) {
    ImGuiIO& io = ImGui::GetIO();
    io.IniFilename = nullptr;
    begin_keys();
    io.DisplaySize = {100, 100};
    io.DeltaTime = 0.1f;
    unsigned char* pixels = nullptr;
    int wide = 0;
    int high = 0;
    io.Fonts->GetTexDataAsAlpha8(&pixels, &wide, &high);
  }
  ~WindowKeys() override { ImGui::DestroyContext(context_); }

  void frame() {
    taps_.show();
    ImGui::NewFrame();
  }
  /// One frame: is `key` pressed in it?
  bool pressed(int key) {
    frame();
    const bool now = key_pressed(key);
    ctrl_ = ImGui::GetIO().KeyCtrl;
    ImGui::EndFrame();
    return now;
  }
  int presses(int key, int frames) {
    int count = 0;
    for (int i = 0; i < frames; ++i) count += pressed(key) ? 1 : 0;
    return count;
  }
  void press(int key, int mods = 0) { taps_.note(key, true, mods); }
  void release(int key) { taps_.note(key, false, 0); }
  void press_and_release(int key, int mods = 0) {
    press(key, mods);
    release(key);
  }

  ImGuiContext* context_;
  KeyTaps taps_;
  bool ctrl_ = false;
};

TEST_F(WindowKeys, EveryTapOfASlowFrameCounts) {
  EXPECT_EQ(presses(GLFW_KEY_M, 3), 0);
  for (int i = 0; i < 5; ++i) press_and_release(GLFW_KEY_M);
  EXPECT_TRUE(pressed(GLFW_KEY_M)) << "the first in the very next frame";
  EXPECT_EQ(presses(GLFW_KEY_M, 20), 4);
  EXPECT_FALSE(key_down(GLFW_KEY_M));
}

TEST_F(WindowKeys, AHeldKeyIsOnePressAndStaysDown) {
  press(GLFW_KEY_C);
  EXPECT_EQ(presses(GLFW_KEY_C, 10), 1);
  EXPECT_TRUE(key_down(GLFW_KEY_C));
  // Let go and pressed again within a frame.
  release(GLFW_KEY_C);
  press(GLFW_KEY_C);
  EXPECT_EQ(presses(GLFW_KEY_C, 10), 1);
  EXPECT_TRUE(key_down(GLFW_KEY_C));
  release(GLFW_KEY_C);
  EXPECT_EQ(presses(GLFW_KEY_C, 10), 0);
  EXPECT_FALSE(key_down(GLFW_KEY_C));
}

TEST_F(WindowKeys, ATapComesWithItsModifiersAndLeavesNone) {
  press_and_release(GLFW_KEY_Q, GLFW_MOD_CONTROL);
  press_and_release(GLFW_KEY_P);
  EXPECT_TRUE(pressed(GLFW_KEY_Q));
  EXPECT_TRUE(ctrl_);
  EXPECT_FALSE(pressed(GLFW_KEY_Q));
  EXPECT_FALSE(ctrl_);
}

// Marks and the end of the session, all while one picture was drawn: the marks come first.
TEST_F(WindowKeys, KeysKeepTheirOrderAndOnlyAStopOvertakes) {
  for (int i = 0; i < 3; ++i) press_and_release(GLFW_KEY_M);
  press_and_release(GLFW_KEY_Q, GLFW_MOD_CONTROL);
  press(GLFW_KEY_C);  // and held
  press_and_release(GLFW_KEY_ESCAPE);
  std::string seen;
  for (int i = 0; i < 12; ++i) {
    frame();
    for (const int key : {GLFW_KEY_M, GLFW_KEY_Q, GLFW_KEY_C, GLFW_KEY_ESCAPE})
      if (key_pressed(key)) seen += key == GLFW_KEY_ESCAPE ? '!' : static_cast<char>(key);
    ImGui::EndFrame();
  }
  EXPECT_EQ(seen, "M!MMQC");
}

// Dear ImGui from 1.87 on would leave a key for the frame after the letter or the click that came before it.
TEST_F(WindowKeys, AKeyCountsInTheFrameOfALetterAndAClick) {
  ImGui::GetIO().AddInputCharacter('x');
  set_mouse_button(0, true);
  press_and_release(GLFW_KEY_ESCAPE);
  EXPECT_TRUE(pressed(GLFW_KEY_ESCAPE));
  EXPECT_TRUE(ImGui::GetIO().MouseDown[0]);
}

TEST_F(WindowKeys, EveryKeyIsHeardAndNoOtherForIt) {
  for (const auto& [first, last] : {std::pair{GLFW_KEY_SPACE, GLFW_KEY_SPACE},
                                    {GLFW_KEY_APOSTROPHE, GLFW_KEY_APOSTROPHE},
                                    {GLFW_KEY_COMMA, GLFW_KEY_9},
                                    {GLFW_KEY_SEMICOLON, GLFW_KEY_SEMICOLON},
                                    {GLFW_KEY_EQUAL, GLFW_KEY_EQUAL},
                                    {GLFW_KEY_A, GLFW_KEY_RIGHT_BRACKET},
                                    {GLFW_KEY_GRAVE_ACCENT, GLFW_KEY_GRAVE_ACCENT},
                                    {GLFW_KEY_ESCAPE, GLFW_KEY_END},
                                    {GLFW_KEY_CAPS_LOCK, GLFW_KEY_PAUSE},
                                    {GLFW_KEY_F1, GLFW_KEY_F24},
                                    {GLFW_KEY_KP_0, GLFW_KEY_KP_EQUAL},
                                    {GLFW_KEY_LEFT_SHIFT, GLFW_KEY_MENU}}) {
    for (int key = first; key <= last; ++key) {
      press_and_release(key);
      frame();
      for (int other = 0; other <= GLFW_KEY_LAST; ++other)
        EXPECT_EQ(key_pressed(other), other == key) << key << ", " << other;
      ImGui::EndFrame();
      EXPECT_FALSE(pressed(key));
    }
  }
}

TEST_F(WindowKeys, NoKeyThatGlfwDoesNotKnow) {
  press_and_release(-1);
  press_and_release(GLFW_KEY_LAST + 1);
  press_and_release(GLFW_KEY_LAST);
  EXPECT_TRUE(pressed(GLFW_KEY_LAST));
}

}  // namespace
}  // namespace telenano::viewer
