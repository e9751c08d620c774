#include "telenano/master/viewer/window_keys.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <imgui.h>

namespace telenano::viewer {

KeyTaps::KeyTaps(GLFWwindow* window) {
  static_assert(kKeys == GLFW_KEY_LAST + 1);
  glfwSetWindowUserPointer(window, this);
  glfwSetKeyCallback(window, [](GLFWwindow* from, int key, int, int action, int mods) {
    if (action == GLFW_PRESS) static_cast<KeyTaps*>(glfwGetWindowUserPointer(from))->note(key, mods);
  });
}

void KeyTaps::note(int key, int mods) {
  if (key < 0 || key >= static_cast<int>(kKeys)) return;
  tapped_[static_cast<std::size_t>(key)] = true;
  mods_ = mods;
}

void KeyTaps::press() {
  ImGuiIO& io = ImGui::GetIO();
  ctrl_ = io.KeyCtrl;
  shift_ = io.KeyShift;
  for (std::size_t key = 0; key < kKeys; ++key) {
    held_[key] = tapped_[key] && !io.KeysDown[key];
    tapped_[key] = false;
    if (!held_[key]) continue;
    io.KeysDown[key] = true;
    io.KeyCtrl |= (mods_ & GLFW_MOD_CONTROL) != 0;
    io.KeyShift |= (mods_ & GLFW_MOD_SHIFT) != 0;
  }
}

void KeyTaps::release() {
  ImGuiIO& io = ImGui::GetIO();
  io.KeyCtrl = ctrl_;
  io.KeyShift = shift_;
  for (std::size_t key = 0; key < kKeys; ++key) {
    if (held_[key]) io.KeysDown[key] = false;
  }
}

}  // namespace telenano::viewer
