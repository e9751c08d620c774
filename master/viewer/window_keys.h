#pragma once

#include <bitset>
#include <cstddef>
#include <vector>

struct GLFWwindow;

namespace telenano::viewer {

/// A key that is pressed and released between two frames would not be seen: ImGui looks at keys once a frame.
/// Where drawing is slow that would lose a STOP. Such a key counts as held for one frame, and one key a
/// frame is pressed: every press counts, in the order in which they came, and finds what those before it have
/// done. Only Esc, which is STOP, never waits.
class KeyTaps {
 public:
  /// Told by note() alone.
  KeyTaps() = default;
  /// After GlfwInput: keys come here, and ImGui hears of them from here alone.
  explicit KeyTaps(GLFWwindow* window);
  KeyTaps(const KeyTaps&) = delete;
  KeyTaps& operator=(const KeyTaps&) = delete;

  /// A key (GLFW's number) goes down or up, with the modifiers held then.
  void note(int key, bool down, int mods);
  /// Between polling and drawing.
  void show();

 private:
  static constexpr std::size_t kKeys = 349;    ///< as many as GLFW knows
  static constexpr std::size_t kTapsMax = 64;  ///< nobody means more of them in one frame

  struct Tap {
    int key = 0;
    int mods = 0;
  };

  std::vector<Tap> taps_;     // not yet shown, in their order
  std::bitset<kKeys> held_;   // as the keyboard has them
  std::bitset<kKeys> shown_;  // as shown in the newest frame
};

}  // namespace telenano::viewer
