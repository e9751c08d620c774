#include "telenano/master/viewer/window_glfw.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>

#include <algorithm>
#include <cstdlib>
#include <string>

#include "telenano/common/base/error.h"

namespace telenano::viewer {
namespace {

constexpr int kWidth_px = 1280;
constexpr int kHeight_px = 800;
constexpr int kLeastWidth_px = 640;
constexpr int kLeastHeight_px = 480;

std::string& last_error() {
  static std::string text;
  return text;
}

[[noreturn]] void refuse() {
  throw RunError("no window can be opened: " + (last_error().empty() ? "no display" : last_error()) +
                 "; log in graphically or with ssh -X, or leave --view out");
}

}  // namespace

bool has_display() noexcept {
  const auto set = [](const char* name) {
    const char* const value = std::getenv(name);
    return value != nullptr && *value != 0;
  };
  return set("DISPLAY") || set("WAYLAND_DISPLAY");
}

void try_window() {
  const GlfwWindow window(false);
}

GlfwWindow::GlfwWindow(bool visible) {
  glfwSetErrorCallback([](int, const char* text) { last_error() = text; });
  if (glfwInit() == GLFW_FALSE) refuse();
  glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
  glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
  glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
  glfwWindowHint(GLFW_OPENGL_FORWARD_COMPAT, GLFW_TRUE);
  glfwWindowHint(GLFW_VISIBLE, visible ? GLFW_TRUE : GLFW_FALSE);
  int width_px = kWidth_px;
  int height_px = kHeight_px;
  if (GLFWmonitor* const monitor = glfwGetPrimaryMonitor(); monitor != nullptr) {
    int x = 0;
    int y = 0;
    int wide = 0;
    int high = 0;
    glfwGetMonitorWorkarea(monitor, &x, &y, &wide, &high);
    if (wide >= kLeastWidth_px && high >= kLeastHeight_px) {
      width_px = std::min(width_px, wide);
      height_px = std::min(height_px, high);
    }
  }
  window_ = glfwCreateWindow(width_px, height_px, visible ? "Telenano" : "", nullptr, nullptr);
  if (window_ == nullptr) {
    glfwTerminate();
    refuse();
  }
  glfwSetWindowSizeLimits(window_, kLeastWidth_px, kLeastHeight_px, GLFW_DONT_CARE, GLFW_DONT_CARE);
  glfwMakeContextCurrent(window_);
  glfwSwapInterval(1);
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

GlfwInput::GlfwInput(GLFWwindow* window) {
  ImGui_ImplGlfw_InitForOpenGL(window, true);
}
GlfwInput::~GlfwInput() {
  ImGui_ImplGlfw_Shutdown();
}
void GlfwInput::begin_frame() const {
  ImGui_ImplGlfw_NewFrame();
}

}  // namespace telenano::viewer
