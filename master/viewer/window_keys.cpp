#include "telenano/master/viewer/window_keys.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <imgui.h>

#include <algorithm>
#include <iterator>

namespace telenano::viewer {
namespace {

// Text comes as letters, not as keys.
bool writes(int key, int mods) {
  return key < GLFW_KEY_ESCAPE && (mods & GLFW_MOD_CONTROL) == 0;
}

bool is_modifier(int key) {
  return key >= GLFW_KEY_LEFT_SHIFT && key <= GLFW_KEY_RIGHT_SUPER;
}

}  // namespace

KeyTaps::KeyTaps(GLFWwindow* window) {
  static_assert(kKeys == GLFW_KEY_LAST + 1);
  glfwSetWindowUserPointer(window, this);
  glfwSetKeyCallback(window, [](GLFWwindow* from, int key, int, int action, int mods) {
    if (action == GLFW_PRESS) static_cast<KeyTaps*>(glfwGetWindowUserPointer(from))->note(key, mods);
  });
}

void KeyTaps::note(int key, int mods) {
  if (key < 0 || key >= static_cast<int>(kKeys)) return;
  if (taps_.size() < kTapsMax || key == GLFW_KEY_ESCAPE) taps_.push_back({key, mods});
}

void KeyTaps::show(const Tap& tap) {
  ImGuiIO& io = ImGui::GetIO();
  io.KeysDown[tap.key] = true;
  io.KeyCtrl |= (tap.mods & GLFW_MOD_CONTROL) != 0;
  io.KeyShift |= (tap.mods & GLFW_MOD_SHIFT) != 0;
}

void KeyTaps::press() {
  ImGuiIO& io = ImGui::GetIO();
  ctrl_ = io.KeyCtrl;
  shift_ = io.KeyShift;
  std::copy_n(std::begin(io.KeysDown), kKeys, down_.begin());
  const auto stops = [](const Tap& tap) { return tap.key == GLFW_KEY_ESCAPE; };
  const bool stop = std::erase_if(taps_, stops) > 0;
  if (io.WantTextInput) std::erase_if(taps_, [](const Tap& tap) { return writes(tap.key, tap.mods); });
  // Keys are up until their turn: a press is one only after a frame in which the key was up.
  for (const Tap& tap : taps_) io.KeysDown[tap.key] = false;
  std::size_t turn = 0;
  for (; turn < taps_.size(); ++turn) {
    const Tap& tap = taps_[turn];
    if (shown_[static_cast<std::size_t>(tap.key)] || io.KeysDown[tap.key]) break;
    show(tap);
    if (!is_modifier(tap.key)) {
      ++turn;
      break;
    }
  }
  taps_.erase(taps_.begin(), taps_.begin() + static_cast<std::ptrdiff_t>(turn));
  if (stop) show({GLFW_KEY_ESCAPE, 0});
  std::copy_n(std::begin(io.KeysDown), kKeys, shown_.begin());
}

void KeyTaps::release() {
  ImGuiIO& io = ImGui::GetIO();
  io.KeyCtrl = ctrl_;
  io.KeyShift = shift_;
  std::copy(down_.begin(), down_.end(), std::begin(io.KeysDown));
}

}  // namespace telenano::viewer
