// Keys between two frames, as GLFW's callback tells them and as ImGui takes them.
#include "telenano/master/viewer/window_keys.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <gtest/gtest.h>
#include <imgui.h>

#include <string>

namespace telenano::viewer {
namespace {

class WindowKeys : public ::testing::Test {
 protected:
  WindowKeys() : context_(ImGui::CreateContext()) {
    ImGuiIO& io = ImGui::GetIO();
    io.IniFilename = nullptr;
    io.DisplaySize = {100, 100};
    io.DeltaTime = 0.1f;
    unsigned char* pixels = nullptr;
    int wide = 0;
    int high = 0;
    io.Fonts->GetTexDataAsAlpha8(&pixels, &wide, &high);
  }
  ~WindowKeys() override { ImGui::DestroyContext(context_); }

  /// One frame: is `key` pressed in it?
  bool pressed(int key) {
    taps_.press();
    ImGui::NewFrame();
    const bool now = ImGui::IsKeyPressed(key, false);
    ctrl_ = ImGui::GetIO().KeyCtrl;
    ImGui::EndFrame();
    taps_.release();
    return now;
  }
  int presses(int key, int frames) {
    int count = 0;
    for (int i = 0; i < frames; ++i) count += pressed(key) ? 1 : 0;
    return count;
  }
  /// As GLFW and ImGui's backend hear a key, in whatever order.
  void press_and_release(int key, int mods = 0) { taps_.note(key, mods); }
  void press(int key) {
    taps_.note(key, 0);
    ImGui::GetIO().KeysDown[key] = true;
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
  EXPECT_FALSE(ImGui::GetIO().KeysDown[GLFW_KEY_M]);
}

TEST_F(WindowKeys, AHeldKeyIsOnePressAndStaysDown) {
  press(GLFW_KEY_C);
  EXPECT_EQ(presses(GLFW_KEY_C, 10), 1);
  EXPECT_TRUE(ImGui::GetIO().KeysDown[GLFW_KEY_C]);
  // Let go and pressed again within a frame.
  press(GLFW_KEY_C);
  EXPECT_EQ(presses(GLFW_KEY_C, 10), 1);
  EXPECT_TRUE(ImGui::GetIO().KeysDown[GLFW_KEY_C]);
  ImGui::GetIO().KeysDown[GLFW_KEY_C] = false;
  EXPECT_EQ(presses(GLFW_KEY_C, 10), 0);
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
    taps_.press();
    ImGui::NewFrame();
    for (const int key : {GLFW_KEY_M, GLFW_KEY_Q, GLFW_KEY_C, GLFW_KEY_ESCAPE})
      if (ImGui::IsKeyPressed(key, false)) seen += key == GLFW_KEY_ESCAPE ? '!' : static_cast<char>(key);
    ImGui::EndFrame();
    taps_.release();
  }
  EXPECT_EQ(seen, "M!MMQC");
}

TEST_F(WindowKeys, NoKeyThatGlfwDoesNotKnow) {
  press_and_release(-1);
  press_and_release(GLFW_KEY_LAST + 1);
  press_and_release(GLFW_KEY_LAST);
  EXPECT_TRUE(pressed(GLFW_KEY_LAST));
}

}  // namespace
}  // namespace telenano::viewer
