#include "telenano/master/viewer/start_window.h"

#include <fmt/format.h>
#include <imgui.h>

#include <chrono>
#include <thread>

#include "telenano/master/viewer/window_glfw.h"
#include "telenano/master/viewer/window_keys.h"

namespace telenano::viewer {
namespace {

// Nothing moves here but a cursor.
constexpr auto kStartFrame = std::chrono::milliseconds(33);
constexpr std::size_t kTitled = 60;  // characters of the server in the title

}  // namespace

bool run_start_window(StartFacts& facts, view_model::StartChoice& choice, const StartHooks& hooks) {
  GlfwWindow window(true);
  StartScreen screen(window.scale());
  const GlfwInput input(window.get());
  KeyTaps taps(window.get());
  while (window.poll() && !hooks.stop_wanted()) {
    const auto began = std::chrono::steady_clock::now();
    hooks.each(choice);
    int width_px = 0;
    int height_px = 0;
    if (window.size_px(width_px, height_px)) {
      input.begin_frame();
      taps.show();
      const StartScreen::Wish wish = screen.draw(width_px, height_px, facts, choice);
      switch (wish) {
        case StartScreen::Wish::kNone:
          break;
        case StartScreen::Wish::kLook:
          hooks.look(choice);
          break;
        case StartScreen::Wish::kCopy:
          ImGui::SetClipboardText(facts.command_line.c_str());
          break;
        case StartScreen::Wish::kStart:
          return true;
        case StartScreen::Wish::kClose:
          return false;
      }
    }
    window.show_frame();
    view_model::StartFaults faults = view_model::start_faults(choice);
    faults.add(facts.faults);
    window.tell(fmt::format("start, {}{} at {}{}", choice.device, choice.record ? ", recording" : "",
                            view_model::shown_text(choice.server, kTitled),
                            !faults.first().empty() ? ", " + faults.first_field() + ": " + faults.first()
                            : facts.plan            ? ", answered"
                                                    : ""));
    std::this_thread::sleep_until(began + kStartFrame);
  }
  return false;
}

}  // namespace telenano::viewer
