#pragma once

#include <array>
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
  /// Before ImGui's own callback, which calls this one.
  explicit KeyTaps(GLFWwindow* window);
  KeyTaps(const KeyTaps&) = delete;
  KeyTaps& operator=(const KeyTaps&) = delete;

  /// A press of a key (GLFW's number), with the modifiers held then.
  void note(int key, int mods);
  /// Between polling and drawing.
  void press();
  /// After drawing.
  void release();

 private:
  static constexpr std::size_t kKeys = 349;    ///< as many as GLFW knows
  static constexpr std::size_t kTapsMax = 64;  ///< nobody means more of them in one frame

  struct Tap {
    int key = 0;
    int mods = 0;
  };
  void show(const Tap& tap);

  std::vector<Tap> taps_;            // not yet shown, in their order
  std::array<bool, kKeys> down_{};   // as ImGui's backend has them
  std::array<bool, kKeys> shown_{};  // as shown in the newest frame
  bool ctrl_ = false;
  bool shift_ = false;
};

}  // namespace telenano::viewer
