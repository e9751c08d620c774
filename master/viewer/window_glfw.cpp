#include "telenano/master/viewer/window_glfw.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <iterator>
#include <string>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/rt/background.h"
#include "telenano/master/viewer/keys.h"
#include "telenano/master/viewer/layout.h"

namespace telenano::viewer {
namespace {

constexpr int kWidth_px = 1280;
constexpr int kHeight_px = 800;

std::string& last_error() {
  static std::string text;
  return text;
}

// The window's one user pointer is taken, and there is one window.
std::array<bool, ImGuiMouseButton_COUNT>& pressed_buttons() {
  static std::array<bool, ImGuiMouseButton_COUNT> value{};
  return value;
}

[[noreturn]] void refuse() {
  throw RunError("no window can be opened: " + (last_error().empty() ? "no display" : last_error()) +
                 "; log in graphically or with ssh -X, or omit --view");
}

// What was scaled up may not fit; and what is written large needs more than the least size of small words.
void fit_to_screen(GLFWwindow* window) {
  int width = 0;
  int height = 0;
  glfwGetWindowSize(window, &width, &height);
  int x = 0;
  int y = 0;
  int wide = 0;
  int high = 0;
  if (GLFWmonitor* const monitor = glfwGetPrimaryMonitor(); monitor != nullptr)
    glfwGetMonitorWorkarea(monitor, &x, &y, &wide, &high);
  if (wide >= kLeastWidth_px && high >= kLeastHeight_px && (width > wide || height > high)) {
    width = std::min(width, wide);
    height = std::min(height, high);
    glfwSetWindowSize(window, width, height);
  }
  const double times = std::max(1.0, static_cast<double>(width) / kWidth_px);
  glfwSetWindowSizeLimits(window, static_cast<int>(times * kLeastWidth_px),
                          static_cast<int>(times * kLeastHeight_px), GLFW_DONT_CARE, GLFW_DONT_CARE);
}

bool is_set(const char* name) noexcept {
  const char* const value = std::getenv(name);
  return value != nullptr && *value != 0;
}

}  // namespace

bool has_display() noexcept {
  return is_set("DISPLAY") || is_set("WAYLAND_DISPLAY");
}

void try_window() {
  const GlfwWindow window(false);
}

GlfwWindow::GlfwWindow(bool visible) {
  std::vector<int> before = rt::threads_now();
  glfwSetErrorCallback([](int, const char* text) { last_error() = text; });
#ifdef GLFW_PLATFORM
  // From 3.4 on GLFW would take a Wayland first, and where DISPLAY is wrong not say so.
  if (is_set("DISPLAY")) glfwInitHint(GLFW_PLATFORM, GLFW_PLATFORM_X11);
#endif
  if (glfwInit() == GLFW_FALSE) refuse();
  glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
  glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
  glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
  glfwWindowHint(GLFW_OPENGL_FORWARD_COMPAT, GLFW_TRUE);
  glfwWindowHint(GLFW_VISIBLE, visible ? GLFW_TRUE : GLFW_FALSE);
  // As large to the eye on a screen with small pixels; the system knows which of them a size counts.
  glfwWindowHint(GLFW_SCALE_TO_MONITOR, GLFW_TRUE);
  window_ = glfwCreateWindow(kWidth_px, kHeight_px, "Telenano", nullptr, nullptr);
  if (window_ == nullptr) {
    glfwTerminate();
    refuse();
  }
  fit_to_screen(window_);
  glfwMakeContextCurrent(window_);
  glfwSwapInterval(1);
  std::vector<int> now = rt::threads_now();
  std::sort(before.begin(), before.end());
  std::sort(now.begin(), now.end());
  std::set_difference(now.begin(), now.end(), before.begin(), before.end(),
                      std::back_inserter(drawing_threads_));
}

void GlfwWindow::show() noexcept {
  glfwShowWindow(window_);
}

GlfwWindow::~GlfwWindow() {
  glfwDestroyWindow(window_);
  glfwTerminate();
}

float GlfwWindow::scale() const noexcept {
  float x = 1;
  float y = 1;
  glfwGetWindowContentScale(window_, &x, &y);
  return std::clamp(std::max(x, y), 1.0f, 4.0f);
}

bool GlfwWindow::poll() const noexcept {
  glfwPollEvents();
  return glfwWindowShouldClose(window_) == 0;
}

bool GlfwWindow::size_px(int& width_px, int& height_px) const noexcept {
  glfwGetFramebufferSize(window_, &width_px, &height_px);
  return width_px > 0 && height_px > 0;
}

void GlfwWindow::show_frame() const noexcept {
  glfwSwapBuffers(window_);
}

void GlfwWindow::tell(const std::string& about) {
  if (about == about_) return;
  about_ = about;
  glfwSetWindowTitle(window_, ("Telenano: " + about).c_str());
}

GlfwInput::GlfwInput(GLFWwindow* window) : window_(window) {
  pressed_buttons() = {};
  ImGui_ImplGlfw_InitForOpenGL(window, true);
  glfwSetMouseButtonCallback(window, [](GLFWwindow* from, int button, int action, int mods) {
    if (action == GLFW_PRESS && button < ImGuiMouseButton_COUNT)
      pressed_buttons()[static_cast<std::size_t>(button)] = true;
    ImGui_ImplGlfw_MouseButtonCallback(from, button, action, mods);
  });
}
GlfwInput::~GlfwInput() {
  ImGui_ImplGlfw_Shutdown();
}
void GlfwInput::begin_frame() const {
  ImGui_ImplGlfw_NewFrame();
  const auto pressed = std::exchange(pressed_buttons(), {});
  for (int button = 0; button < ImGuiMouseButton_COUNT; ++button)
    set_mouse_button(button, pressed[static_cast<std::size_t>(button)] ||
                                 glfwGetMouseButton(window_, button) == GLFW_PRESS);
}

}  // namespace telenano::viewer
