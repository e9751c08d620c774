#include "telenano/master/viewer/window.h"

#include <epoxy/gl.h>
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/master/viewer/png.h"
#include "telenano/master/viewer/viewer.h"

namespace telenano::viewer {
namespace {

constexpr int kWidth_px = 1280;
constexpr int kHeight_px = 800;
constexpr int kLeastWidth_px = 640;
constexpr int kLeastHeight_px = 480;
constexpr auto kFrame = std::chrono::microseconds(16'600);
constexpr double kReloadS = 1;

using Clock = std::chrono::steady_clock;

// GLFW and its window, which go in the end whatever happens.
class Window {
 public:
  explicit Window(bool visible) {
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
  ~Window() {
    glfwDestroyWindow(window_);
    glfwTerminate();
  }
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  GLFWwindow* get() const noexcept { return window_; }
  float scale() const noexcept {
    float x = 1;
    float y = 1;
    glfwGetWindowContentScale(window_, &x, &y);
    return std::clamp(std::max(x, y), 1.0f, 4.0f);
  }

 private:
  static std::string& last_error() {
    static std::string text;
    return text;
  }
  [[noreturn]] static void refuse() {
    throw RunError("no window can be opened: " + (last_error().empty() ? "no display" : last_error()) +
                   "; log in graphically or with ssh -X, or leave --view out");
  }
  GLFWwindow* window_ = nullptr;
};

/// A key that is pressed and released between two frames would not be seen: ImGui looks at keys once a frame.
/// Where drawing is slow that would lose a STOP. Such a key counts as held for one frame.
class KeyTaps {
 public:
  /// Before ImGui's own callback, which calls this one.
  explicit KeyTaps(GLFWwindow* window) {
    glfwSetWindowUserPointer(window, this);
    glfwSetKeyCallback(window, [](GLFWwindow* from, int key, int, int action, int mods) {
      if (action != GLFW_PRESS || key < 0 || key >= kKeys) return;
      static_cast<KeyTaps*>(glfwGetWindowUserPointer(from))->note(static_cast<std::size_t>(key), mods);
    });
  }
  KeyTaps(const KeyTaps&) = delete;
  KeyTaps& operator=(const KeyTaps&) = delete;

  /// Between polling and drawing.
  void press() {
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
  /// After drawing.
  void release() {
    ImGuiIO& io = ImGui::GetIO();
    io.KeyCtrl = ctrl_;
    io.KeyShift = shift_;
    for (std::size_t key = 0; key < kKeys; ++key) {
      if (held_[key]) io.KeysDown[key] = false;
    }
  }

 private:
  static constexpr int kKeys = GLFW_KEY_LAST + 1;
  void note(std::size_t key, int mods) {
    tapped_[key] = true;
    mods_ = mods;
  }
  std::array<bool, kKeys> tapped_{};
  std::array<bool, kKeys> held_{};
  int mods_ = 0;
  bool ctrl_ = false;
  bool shift_ = false;
};

/// A button that is let go and pressed again between two frames, elsewhere, looks held to ImGui: the way
/// there would be a drag.
class PressWatch {
 public:
  /// Before ImGui's own callback, which calls this one.
  explicit PressWatch(GLFWwindow* window) {
    pressed() = false;
    glfwSetMouseButtonCallback(window, [](GLFWwindow*, int, int action, int) {
      if (action == GLFW_PRESS) pressed() = true;
    });
  }
  /// Since the last call.
  bool take() { return std::exchange(pressed(), false); }

 private:
  // The window's one user pointer is taken, and there is one window.
  static bool& pressed() {
    static bool value = false;
    return value;
  }
};

// ImGui's input from the window; made after the context of ImGui, gone before it.
class WindowInput {
 public:
  explicit WindowInput(GLFWwindow* window) { ImGui_ImplGlfw_InitForOpenGL(window, true); }
  ~WindowInput() { ImGui_ImplGlfw_Shutdown(); }
  WindowInput(const WindowInput&) = delete;
  WindowInput& operator=(const WindowInput&) = delete;
};

std::string free_name(const std::string& prefix, const char* ending) {
  for (int i = 1;; ++i) {
    std::string name = fmt::format("{}-{}.{}", prefix, i, ending);
    if (!std::filesystem::exists(name)) return name;
  }
}

void write_text(const std::string& name, const std::string& text) {
  std::ofstream file(name, std::ios::binary);
  file << text;
  file.close();
  if (!file) throw RunError(fmt::format("{}: cannot be written; is there room and the right to?", name));
}

Picture picture_of_window(int width_px, int height_px) {
  Picture picture{width_px, height_px, {}};
  const auto row = static_cast<std::size_t>(3 * width_px);
  std::vector<unsigned char> upside_down(row * static_cast<std::size_t>(height_px));
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glReadPixels(0, 0, width_px, height_px, GL_RGB, GL_UNSIGNED_BYTE, upside_down.data());
  for (int y = height_px - 1; y >= 0; --y) {
    const auto from = upside_down.begin() + static_cast<std::ptrdiff_t>(row) * y;
    picture.rgb.insert(picture.rgb.end(), from, from + static_cast<std::ptrdiff_t>(row));
  }
  return picture;
}

device::PointerState pointer_of(const Viewer& viewer, double time_s) {
  device::PointerState state;
  const Vec3& pos = viewer.hand().hand_pos_h_m();
  state.hand_pos_h_m = {pos.x(), pos.y(), pos.z()};
  state.buttons = viewer.hand().buttons(time_s);
  return state;
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
  const Window window(false);
}

rt::LogHistogram run_window(const ViewFacts& facts, view_model::Ground ground, view_model::ViewPort& port,
                            const ViewHooks& hooks) {
  const Window window(true);
  Viewer viewer(facts, std::move(ground), port, window.scale());
  if (hooks.playback != nullptr) viewer.play(*hooks.playback);
  KeyTaps taps(window.get());
  PressWatch presses(window.get());
  const WindowInput input(window.get());
  rt::LogHistogram frames;
  const Clock::time_point start = Clock::now();
  double reload_s = kReloadS;
  bool asked_to_quit = false;
  bool ended = false;
  while (true) {
    if (!ended && hooks.session_over()) {
      std::vector<std::string> words;
      if (hooks.last_words && !asked_to_quit) words = hooks.last_words();
      if (words.empty()) break;
      ended = true;
      viewer.take_samples();
      viewer.end(std::move(words));
    }
    const Clock::time_point began = Clock::now();
    const double time_s = std::chrono::duration<double>(began - start).count();
    glfwPollEvents();
    const bool waits_for_a_person = hooks.playback != nullptr || ended;
    if (waits_for_a_person && (glfwWindowShouldClose(window.get()) != 0 || viewer.quit_wanted())) break;
    if (ended && hooks.stop_wanted && hooks.stop_wanted()) break;
    if (glfwWindowShouldClose(window.get()) != 0 && !asked_to_quit) {
      view_model::ViewRequest quit;
      quit.kind = view_model::ViewRequest::Kind::kQuit;
      asked_to_quit = port.requests.push(quit);
    }
    if (hooks.changed_ground && time_s > reload_s) {
      reload_s = time_s + kReloadS;
      if (auto changed = hooks.changed_ground()) viewer.set_ground(std::move(*changed));
    }
    int width_px = 0;
    int height_px = 0;
    glfwGetFramebufferSize(window.get(), &width_px, &height_px);
    viewer.take_samples();
    if (width_px > 0 && height_px > 0) {
      ImGui_ImplGlfw_NewFrame();
      taps.press();
      if (presses.take()) viewer.note_press();
      viewer.draw(width_px, height_px, time_s, hooks.recording());
      taps.release();
      if (viewer.take_picture_wanted()) {
        const std::string name = free_name(hooks.picture_prefix, "png");
        try {
          write_png(name, picture_of_window(width_px, height_px));
          viewer.say("Picture: " + name, time_s);
        } catch (const std::exception& error) {  // a full disk ends no session
          viewer.say(error.what(), time_s);
        }
      }
    }
    if (viewer.take_data_wanted()) {
      const std::string name = free_name(hooks.picture_prefix, "csv");
      try {
        write_text(name, viewer.data());
        viewer.say("Data: " + name, time_s);
      } catch (const std::exception& error) {
        viewer.say(error.what(), time_s);
      }
    }
    if (hooks.pointer != nullptr) hooks.pointer->store(pointer_of(viewer, time_s));
    glFinish();
    frames.add(std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now() - began).count());
    glfwSwapBuffers(window.get());
    std::this_thread::sleep_until(began + kFrame);
  }
  return frames;
}

}  // namespace telenano::viewer
