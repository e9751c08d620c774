#include "telenano/master/viewer/window_keys.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <imgui.h>

#include <array>

#include "telenano/master/viewer/keys.h"

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
  for (int key = GLFW_KEY_SPACE; key <= GLFW_KEY_LAST; ++key)
    held_[static_cast<std::size_t>(key)] = glfwGetKey(window, key) == GLFW_PRESS;
  glfwSetWindowUserPointer(window, this);
  glfwSetKeyCallback(window, [](GLFWwindow* from, int key, int, int action, int mods) {
    if (action != GLFW_REPEAT)
      static_cast<KeyTaps*>(glfwGetWindowUserPointer(from))->note(key, action == GLFW_PRESS, mods);
  });
}

void KeyTaps::note(int key, bool down, int mods) {
  if (key < 0 || key >= static_cast<int>(kKeys)) return;
  held_[static_cast<std::size_t>(key)] = down;
  if (down && (taps_.size() < kTapsMax || key == GLFW_KEY_ESCAPE)) taps_.push_back({key, mods});
}

void KeyTaps::show() {
  std::bitset<kKeys> down = held_;
  int mods = 0;
  for (const auto& [left, right, mod] :
       {std::array{GLFW_KEY_LEFT_CONTROL, GLFW_KEY_RIGHT_CONTROL, GLFW_MOD_CONTROL},
        {GLFW_KEY_LEFT_SHIFT, GLFW_KEY_RIGHT_SHIFT, GLFW_MOD_SHIFT},
        {GLFW_KEY_LEFT_ALT, GLFW_KEY_RIGHT_ALT, GLFW_MOD_ALT},
        {GLFW_KEY_LEFT_SUPER, GLFW_KEY_RIGHT_SUPER, GLFW_MOD_SUPER}})
    if (held_[static_cast<std::size_t>(left)] || held_[static_cast<std::size_t>(right)]) mods |= mod;
  const auto press = [&](const Tap& tap) {
    down[static_cast<std::size_t>(tap.key)] = true;
    mods |= tap.mods & (GLFW_MOD_CONTROL | GLFW_MOD_SHIFT);
  };
  const auto stops = [](const Tap& tap) { return tap.key == GLFW_KEY_ESCAPE; };
  const bool stop = std::erase_if(taps_, stops) > 0;
  if (ImGui::GetIO().WantTextInput)
    std::erase_if(taps_, [](const Tap& tap) { return writes(tap.key, tap.mods); });
  // Keys are up until their turn: a press is one only after a frame in which the key was up.
  for (const Tap& tap : taps_) down[static_cast<std::size_t>(tap.key)] = false;
  std::size_t turn = 0;
  for (; turn < taps_.size(); ++turn) {
    const Tap& tap = taps_[turn];
    if (shown_[static_cast<std::size_t>(tap.key)] || down[static_cast<std::size_t>(tap.key)]) break;
    press(tap);
    if (!is_modifier(tap.key)) {
      ++turn;
      break;
    }
  }
  taps_.erase(taps_.begin(), taps_.begin() + static_cast<std::ptrdiff_t>(turn));
  if (stop) press({GLFW_KEY_ESCAPE, 0});
  for (std::size_t key = 0; key < kKeys; ++key) set_key(static_cast<int>(key), down[key]);
  set_modifiers(mods);
  shown_ = down;
}

}  // namespace telenano::viewer
