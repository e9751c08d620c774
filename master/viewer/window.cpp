#include "telenano/master/viewer/window.h"

#include <epoxy/gl.h>
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/master/viewer/png.h"
#include "telenano/master/viewer/viewer.h"
#include "telenano/master/viewer/whole_file.h"
#include "telenano/master/viewer/window_keys.h"

namespace telenano::viewer {
namespace {

constexpr auto kFrame = std::chrono::microseconds(16'600);
constexpr double kReloadS = 0.25;
constexpr double kFirstLookS = 0.03;  // while there are no heights yet
constexpr auto kWaitingFrame = std::chrono::milliseconds(100);
constexpr auto kWaitingLook = std::chrono::milliseconds(10);

using Clock = std::chrono::steady_clock;

/// Where the pointer was when a button went down, which ImGui does not say: it looks once a frame. A button
/// that is let go and pressed again between two frames, elsewhere, looks held to it: the way there would be
/// a drag. And where a frame is late, what the pointer went after the press belongs to the drag.
class PressWatch {
 public:
  /// Before ImGui's own callbacks, which call these.
  explicit PressWatch(GLFWwindow* window) {
    seen() = {};
    glfwSetCursorPosCallback(window, [](GLFWwindow*, double x, double y) {
      seen().pointer = {static_cast<float>(x), static_cast<float>(y)};
    });
    glfwSetMouseButtonCallback(window, [](GLFWwindow*, int, int action, int) {
      if (action == GLFW_PRESS) seen().press = seen().pointer;
    });
  }
  /// The newest since the last call.
  std::optional<ImVec2> take() { return std::exchange(seen().press, std::nullopt); }

 private:
  struct Seen {
    ImVec2 pointer{-1, -1};
    std::optional<ImVec2> press;
  };
  // The window's one user pointer is taken, and there is one window.
  static Seen& seen() {
    static Seen value;
    return value;
  }
};

/// A folder that may not be looked into has no name to spare: writing says so.
std::string free_name(const std::string& prefix, const char* ending) {
  for (int i = 1;; ++i) {
    std::string name = fmt::format("{}-{}.{}", prefix, i, ending);
    std::error_code error;
    if (!std::filesystem::exists(name, error)) return name;
  }
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

std::string title_of(const ViewFacts& facts, const Viewer& viewer, bool ended) {
  if (ended) return "the session has ended";
  if (!facts.played.empty()) return facts.played;
  return facts.scene_name + " at " + facts.server + (viewer.writes_note() ? ", writing a note" : "");
}

device::PointerState pointer_of(const Viewer& viewer, double time_s) {
  device::PointerState state;
  const Vec3& pos = viewer.hand().hand_pos_h_m();
  state.hand_pos_h_m = {pos.x(), pos.y(), pos.z()};
  state.buttons = viewer.hand().buttons(time_s);
  return state;
}

/// Without a graphics card a picture of a scan is compiled for a good part of a second when it is first drawn: now,
/// while the sample is on its way, and not when it is here. Nobody sees it.
void prepare_for_scan(GlfwWindow& window, const GlfwInput& input, Viewer& viewer) {
  int width_px = 0;
  int height_px = 0;
  if (!window.poll() || !window.size_px(width_px, height_px)) return;
  const view_model::Ground plane = viewer.ground();
  surface::HeightGrid waves;
  waves.columns = waves.rows = 64;
  waves.dx_nm = plane.width_nm() / 63;
  waves.dy_nm = plane.depth_nm() / 63;
  waves.x_first_nm = plane.min_w_nm().x();
  waves.y_first_nm = plane.min_w_nm().y();
  for (int i = 0; i < 64 * 64; ++i) waves.z_nm.push_back(plane.min_w_nm().z() + 0.1 * ((i + i / 64) % 2));
  viewer.set_ground(view_model::Ground(std::move(waves)));
  input.begin_frame();
  viewer.draw(width_px, height_px, 0, {});
  glFinish();
  viewer.set_ground(plane);
}

}  // namespace

void wait_in_window(SessionWindow& in, const ViewFacts& facts, view_model::Ground ground,
                    view_model::ViewPort& port, const Vec3& tip_w_nm, const std::string& words,
                    const WaitingHooks& hooks) {
  GlfwWindow& window = in.window;
  window.show();
  const bool first = !in.viewer;
  if (first) {
    in.viewer.emplace(facts, std::move(ground), port, window.scale());
  } else {
    in.viewer->begin(facts);
    in.viewer->set_ground(std::move(ground));
  }
  Viewer& viewer = *in.viewer;
  viewer.wait(words, tip_w_nm);
  const GlfwInput input(window.get());
  KeyTaps taps(window.get());
  if (first && hooks.changed_ground && !viewer.ground().is_scan()) prepare_for_scan(window, input, viewer);
  const Clock::time_point start = Clock::now();
  Clock::time_point next = start;
  bool cancelled = false;
  // What has come last is drawn too.
  for (bool over = false; !over;) {
    over = hooks.over();
    const bool open = window.poll();
    if (!cancelled && (!open || viewer.quit_wanted())) {
      cancelled = true;
      hooks.cancel();
    }
    auto changed = hooks.changed_ground ? hooks.changed_ground() : std::nullopt;
    if (changed) viewer.set_ground(std::move(*changed));
    if (hooks.server_scene)
      viewer.set_server_scene(hooks.server_scene(),
                              std::chrono::duration<double>(Clock::now() - start).count());
    // The processors are for what is waited for.
    if (changed || (!over && Clock::now() >= next)) {
      next = Clock::now() + kWaitingFrame;
      int width_px = 0;
      int height_px = 0;
      if (window.size_px(width_px, height_px)) {
        input.begin_frame();
        taps.show();
        viewer.draw(width_px, height_px, std::chrono::duration<double>(Clock::now() - start).count(), {});
      }
      window.show_frame();
      if (hooks.sample_drawn && viewer.ground().is_scan()) hooks.sample_drawn();
      window.tell(std::string("getting ready") + (viewer.ground().is_scan() ? ", the sample is drawn" : ""));
    }
    std::this_thread::sleep_for(kWaitingLook);
  }
}

WindowEnd run_window(SessionWindow& in, const ViewFacts& facts, view_model::Ground ground,
                     view_model::ViewPort& port, const ViewHooks& hooks) {
  GlfwWindow& window = in.window;
  window.show();
  if (in.viewer) {
    in.viewer->begin(facts);
    in.viewer->set_ground(std::move(ground));
  } else {
    in.viewer.emplace(facts, std::move(ground), port, window.scale());
  }
  Viewer& viewer = *in.viewer;
  if (hooks.playback != nullptr) viewer.play(*hooks.playback);
  PressWatch presses(window.get());
  const GlfwInput input(window.get());
  KeyTaps taps(window.get());
  rt::LogHistogram frames;
  const Clock::time_point start = Clock::now();
  double reload_s = 0;
  bool asked_to_quit = false;
  bool ended = false;
  while (true) {
    if (!ended && hooks.session_over()) {
      view_model::SessionEnd end;
      if (hooks.session_end && !asked_to_quit) end = hooks.session_end();
      if (end.lines.empty()) break;
      ended = true;
      viewer.take_samples();
      viewer.end(std::move(end));
    }
    const Clock::time_point began = Clock::now();
    const double time_s = std::chrono::duration<double>(began - start).count();
    glfwPollEvents();
    const bool waits_for_a_person = hooks.playback != nullptr || ended;
    if (waits_for_a_person && (glfwWindowShouldClose(window.get()) != 0 || viewer.quit_wanted())) break;
    if (viewer.again_wanted()) break;
    if (ended && hooks.stop_wanted && hooks.stop_wanted()) break;
    if (glfwWindowShouldClose(window.get()) != 0 && !asked_to_quit) {
      port.quit.store(true);
      asked_to_quit = true;
    }
    if (time_s > reload_s) {
      reload_s = time_s + (viewer.ground().is_scan() ? kReloadS : kFirstLookS);
      auto changed = hooks.changed_ground ? hooks.changed_ground() : std::nullopt;
      if (changed) viewer.set_ground(std::move(*changed));
      if (hooks.server_scene) viewer.set_server_scene(hooks.server_scene(), time_s);
    }
    int width_px = 0;
    int height_px = 0;
    glfwGetFramebufferSize(window.get(), &width_px, &height_px);
    viewer.take_samples();
    if (width_px > 0 && height_px > 0) {
      input.begin_frame();
      taps.show();
      if (const auto place = presses.take()) viewer.note_press(*place);
      viewer.draw(width_px, height_px, time_s, hooks.recording());
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
    if (viewer.take_record_wanted() && hooks.record) {
      try {
        const std::string file = hooks.record();
        viewer.set_recording(file);
        viewer.say("Recording: " + file, time_s);
      } catch (const std::exception& error) {
        viewer.say(error.what(), time_s);
      }
    }
    if (viewer.take_data_wanted()) {
      const std::string name = free_name(hooks.picture_prefix, "csv");
      try {
        write_whole_file(name, viewer.data(), "the data");
        viewer.say("Data: " + name, time_s);
      } catch (const std::exception& error) {
        viewer.say(error.what(), time_s);
      }
    }
    if (viewer.take_surface_wanted()) {
      const std::string name = free_name(hooks.picture_prefix, "gsf");
      try {
        surface::write_gsf(name, viewer.drawn_surface());
        viewer.say("Surface: " + name, time_s);
      } catch (const std::exception& error) {
        viewer.say(error.what(), time_s);
      }
    }
    if (hooks.pointer != nullptr) hooks.pointer->store(pointer_of(viewer, time_s));
    glFinish();
    frames.add(std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now() - began).count());
    glfwSwapBuffers(window.get());
    if (hooks.sample_drawn && viewer.ground().is_scan()) hooks.sample_drawn();
    window.tell(title_of(facts, viewer, ended));
    std::this_thread::sleep_until(began + kFrame);
  }
  return {frames, viewer.again_wanted()};
}

}  // namespace telenano::viewer
