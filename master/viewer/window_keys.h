#pragma once

#include <array>
#include <cstddef>

struct GLFWwindow;

namespace telenano::viewer {

/// A key that is pressed and released between two frames would not be seen: ImGui looks at keys once a frame.
/// Where drawing is slow that would lose a STOP. Such a key counts as held for one frame.
class KeyTaps {
 public:
  /// Before ImGui's own callback, which calls this one.
  explicit KeyTaps(GLFWwindow* window);
  KeyTaps(const KeyTaps&) = delete;
  KeyTaps& operator=(const KeyTaps&) = delete;

  /// Between polling and drawing.
  void press();
  /// After drawing.
  void release();

 private:
  static constexpr std::size_t kKeys = 349;  ///< as many as GLFW knows
  void note(int key, int mods);

  std::array<bool, kKeys> tapped_{};
  std::array<bool, kKeys> held_{};
  int mods_ = 0;
  bool ctrl_ = false;
  bool shift_ = false;
};

}  // namespace telenano::viewer
