#pragma once

#include <string>
#include <vector>

struct GLFWwindow;

namespace telenano::viewer {

/// Is there a display that a window could be opened on?
bool has_display() noexcept;

/// Opens a window that nobody sees, and closes it: throws RunError, with the reason, where a real one would.
/// In the main thread.
void try_window();

/// GLFW and its window, with OpenGL 3.3 current in it, which go in the end whatever happens. One at a time,
/// in the main thread. Throws RunError when none can be opened.
class GlfwWindow {
 public:
  explicit GlfwWindow(bool visible);
  ~GlfwWindow();
  GlfwWindow(const GlfwWindow&) = delete;
  GlfwWindow& operator=(const GlfwWindow&) = delete;

  GLFWwindow* get() const noexcept { return window_; }
  /// One that was made without being seen.
  void show() noexcept;
  /// Of the graphics library, begun with the window: they draw where there is no graphics card.
  const std::vector<int>& drawing_threads() const noexcept { return drawing_threads_; }
  /// Of fonts and distances, as the screen asks: 1 to 4.
  float scale() const noexcept;
  /// Takes what has come in; false: a person has closed the window.
  bool poll() const noexcept;
  /// False while there is nothing to draw on.
  bool size_px(int& width_px, int& height_px) const noexcept;
  void show_frame() const noexcept;
  /// What the desktop lists the window by: "Telenano: ABOUT". Set once what it names has been drawn.
  void tell(const std::string& about);

 private:
  std::string about_;
  std::vector<int> drawing_threads_;
  GLFWwindow* window_ = nullptr;
};

/// ImGui's input from the window; made after the context of ImGui, gone before it.
class GlfwInput {
 public:
  explicit GlfwInput(GLFWwindow* window);
  ~GlfwInput();
  GlfwInput(const GlfwInput&) = delete;
  GlfwInput& operator=(const GlfwInput&) = delete;
  /// Before each frame. A button that was pressed since the last one counts as held in it.
  void begin_frame() const;

 private:
  GLFWwindow* window_;
};

}  // namespace telenano::viewer
