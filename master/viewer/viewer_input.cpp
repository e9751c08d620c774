// What keys and mouse do.
#include "telenano/master/viewer/viewer.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "telenano/common/base/constants.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/view_model/status_text.h"
#include "telenano/master/viewer/keys.h"
#include "telenano/master/viewer/overlay.h"
#include "telenano/master/viewer/playback_bar.h"

namespace telenano::viewer {
namespace {

using view_model::ViewRequest;

constexpr double kHalfOfForce =
    0.25;  // of the force that a hand with motors would be shown at most: the pointer goes twice as far
constexpr double kDegPerPixel = 0.3;
constexpr double kTextStep = 1.15;
constexpr double kZoomPerNotch = 1.15;

}  // namespace

void Viewer::handle_keys(double time_s) {
  const ImGuiIO& io = ImGui::GetIO();
  // Stop and the way out always work, whatever has the keyboard.
  if (key_pressed(GLFW_KEY_ESCAPE)) {
    panel_.stop();
    note_box_.close();
  }
  if (key_pressed(GLFW_KEY_Q) && io.KeyCtrl) leaves_ = quit_ = true;
  if (!waiting_.empty()) {
    quit_ |= key_pressed(GLFW_KEY_ESCAPE);
    handle_text_keys(time_s);
    return;
  }
  if (io.WantTextInput || note_box_.is_open()) return;
  if (key_pressed(GLFW_KEY_P) || key_pressed(GLFW_KEY_F12)) panel_.want_picture();
  // By the letter: where it lies is the keyboard's affair.
  const auto& letters = io.InputQueueCharacters;
  if (key_pressed(GLFW_KEY_F1) || std::find(letters.begin(), letters.end(), ImWchar{'?'}) != letters.end())
    help_ = !help_;
  if (key_pressed(GLFW_KEY_F)) force_curve_shown_ = !force_curve_shown_;
  if (key_pressed(GLFW_KEY_D)) data_wanted_ = true;
  if (key_pressed(GLFW_KEY_S)) {
    surface_wanted_ = ground_.is_scan();
    if (!surface_wanted_) say("No surface to save: the sample is a plane, and has no marks", time_s);
  }
  if (key_pressed(GLFW_KEY_L) && live_.any()) measurement_.choose(tip_w_nm());
  if (!ending_.lines.empty() && (key_pressed(GLFW_KEY_ENTER) || key_pressed(GLFW_KEY_KP_ENTER)))
    again_ = true;
  handle_text_keys(time_s);
  if (key_pressed(GLFW_KEY_HOME)) reset_cameras();
  if (key_pressed(GLFW_KEY_Z) && live_.any()) narrow_region(time_s);
  if (key_pressed(GLFW_KEY_V))
    views_ = views_ == Views::kBoth       ? Views::kOverview
             : views_ == Views::kOverview ? Views::kCloseUp
                                          : Views::kBoth;
  if (playback_ != nullptr) {
    playback_keys(*playback_);
  } else {
    handle_session_keys(time_s);
  }
}

void Viewer::handle_text_keys(double time_s) {
  const ImGuiIO& io = ImGui::GetIO();
  if (!io.KeyCtrl) return;
  const auto pressed = [](int key) { return key_pressed(key) ? 1 : 0; };
  const int more = pressed(GLFW_KEY_EQUAL) + pressed(GLFW_KEY_KP_ADD) - pressed(GLFW_KEY_MINUS) -
                   pressed(GLFW_KEY_KP_SUBTRACT);
  const bool first = pressed(GLFW_KEY_0) + pressed(GLFW_KEY_KP_0) > 0;
  if (more == 0 && !first) return;
  set_text_size(first ? 1 : text_size_ * std::pow(kTextStep, more));
  say(fmt::format("Text {:.0f} %", 100 * text_size_), time_s);
}

void Viewer::handle_session_keys(double time_s) {
  if (key_pressed(GLFW_KEY_R)) {
    if (ImGui::GetIO().KeyCtrl) {
      panel_.want_recording();
    } else {
      panel_.ask(ViewRequest::Kind::kClearStop);
    }
  }
  const bool ended = !ending_.lines.empty();
  if (key_pressed(GLFW_KEY_N)) {
    if (facts_.recording.empty()) {
      say("No recording: begin one to put a note into it", time_s);
    } else if (ended) {
      say("The session has ended: its recording is closed", time_s);
    } else if (recording_failed_) {
      say("The recording has failed: no note can be put into it", time_s);
    } else {
      note_box_.open(live_.now());
    }
  }
  if (key_pressed(GLFW_KEY_G)) {
    guide_ = !guide_;
    first_touch_ = {};
  }
  if (key_pressed(GLFW_KEY_U)) undo_marks(time_s);
  handle_scaling_keys();
  if (key_pressed(GLFW_KEY_M)) {
    panel_.ask(ViewRequest::Kind::kMarker);
    say(facts_.recording.empty() ? "No recording: begin one to put a mark into it"
        : ended                  ? "The session has ended: its recording is closed"
        : recording_failed_      ? "The recording has failed: no mark can be put into it"
                                 : "Mark put into the recording",
        time_s);
  }
  if (key_pressed(GLFW_KEY_T) && !facts_.tasks.empty()) {
    // The next one that fits, round and round.
    const int count = static_cast<int>(facts_.tasks.size());
    int task = (port_.task.load().task + 1) % count;
    for (int i = 0; i < count && !panel_.task_fits(task, live_.now()); ++i) task = (task + 1) % count;
    panel_.ask_task(task, live_.now());
  }
  for (int i = 0; i < static_cast<int>(control::kAllMethods.size()); ++i) {
    if (key_pressed(GLFW_KEY_1 + i) && !ImGui::GetIO().KeyCtrl)
      panel_.ask_method(control::kAllMethods[static_cast<std::size_t>(i)], live_.now());
  }
  const bool clutch = panel_.clutch_on_screen() || key_down(GLFW_KEY_C);
  hand_.clutch(clutch);
  port_.buttons.store(clutch ? static_cast<std::uint32_t>(device::kButtonClutch) : 0u);
}

void Viewer::undo_marks(double time_s) {
  if (const std::string why = panel_.ask_undo(live_.now()); !why.empty()) say(why, time_s);
}

// What became of it is said when the server has answered.
void Viewer::tell_undo(double time_s) {
  const view_model::UndoShown shown = port_.undo.load();
  if (shown.count == undo_told_) return;
  undo_told_ = shown.count;
  if (const char* const words = view_model::undo_text(shown.text); *words != 0) say(words, time_s);
}

void Viewer::tell_scene(double time_s) {
  const view_model::SceneShown shown = port_.scene.load();
  if (shown.count == scene_told_) return;
  scene_told_ = shown.count;
  if (const char* const words = view_model::scene_text(shown.text); *words != 0) say(words, time_s);
}

// A tenth of a tenfold at a time; what is not safe is not asked for.
void Viewer::handle_scaling_keys() {
  if (!ImGui::GetIO().KeyShift || !live_.any()) return;
  const auto pressed = [](int key) { return key_pressed(key) ? 1 : 0; };
  const int velocity = pressed(GLFW_KEY_RIGHT) - pressed(GLFW_KEY_LEFT);
  const int force = pressed(GLFW_KEY_UP) - pressed(GLFW_KEY_DOWN);
  if (velocity != 0 || force != 0)
    panel_.ask_scaling(std::pow(10.0, 0.1 * velocity), std::pow(10.0, 0.1 * force), live_.now());
}

// As a drag in the section would: so much of it a second.
void Viewer::move_hand_by_keys(double nm_per_pixel) {
  constexpr double kPixelsPerS = 90;
  const ImGuiIO& io = ImGui::GetIO();
  if (io.KeyShift || io.WantTextInput || !key_down(GLFW_KEY_SPACE)) return;
  const auto down = [](int key) { return key_down(key) ? 1 : 0; };
  const double px = kPixelsPerS * std::min(static_cast<double>(io.DeltaTime), 0.1);
  const double right = px * (down(GLFW_KEY_RIGHT) - down(GLFW_KEY_LEFT));
  const double away = px * (down(GLFW_KEY_PAGE_UP) - down(GLFW_KEY_PAGE_DOWN));
  const double below = px * (down(GLFW_KEY_DOWN) - down(GLFW_KEY_UP));
  if (right != 0 || below != 0) hand_.drag(right, below, {Vec3::UnitX(), Vec3::UnitZ(), nm_per_pixel});
  if (away != 0) hand_.drag(0, -away, {Vec3::UnitX(), Vec3::UnitY(), nm_per_pixel});
}

// Ctrl and a click in the overview: a place to measure from or to, no drag.
bool Viewer::measure_at_pointer(const Layout& layout) {
  const ImGuiIO& io = ImGui::GetIO();
  if (!io.KeyCtrl || !io.MouseClicked[0]) return false;
  const Area& area = layout.overview;
  const SceneFrame frame = SceneRenderer::overview_frame(overview_ground());
  const auto place =
      view_model::seen_at(overview_ground(), fitted_overview(area), frame.origin_w_nm, frame.exaggeration,
                          io.MousePos.x - static_cast<float>(area.x_px),
                          io.MousePos.y - static_cast<float>(area.y_px), area.width_px, area.height_px);
  if (place) measurement_.choose(*place);
  return true;
}

void Viewer::handle_mouse(const Layout& layout, double time_s) {
  const ImGuiIO& io = ImGui::GetIO();
  const Layout& l = layout;
  // A press anchors. Touch screens, tablets and remote desktops put the pointer down far from where it was:
  // taken for a drag, the way there would lead the tip into the sample.
  const bool anchors = pressed_at_ || io.MouseClicked[0] || io.MouseClicked[1] || io.MouseClicked[2];
  const ImVec2 from = pressed_at_ && ImGui::IsMousePosValid() ? *pressed_at_ : io.MousePos;
  pressed_at_.reset();
  const double dx = anchors ? io.MousePos.x - from.x : io.MouseDelta.x;
  const double dy = anchors ? io.MousePos.y - from.y : io.MouseDelta.y;
  const bool over_overview = views_ != Views::kCloseUp && l.overview.contains(from.x, from.y);
  const bool over_close_up = views_ != Views::kOverview && l.close_up.contains(from.x, from.y);
  const bool free = !io.WantCaptureMouse;
  if (drag_ == Drag::kNone && free && over_overview && io.MouseClicked[0] && !io.KeyCtrl &&
      map_.place_at(ground_, io.MousePos))
    drag_ = Drag::kRegion;
  const bool measures = drag_ == Drag::kNone && free && over_overview && measure_at_pointer(l);
  if (drag_ == Drag::kNone && free && !measures && (over_overview || over_close_up)) {
    const bool hand = panel_.mouse_leads();
    if (io.MouseClicked[0])
      drag_ = over_close_up ? (hand ? Drag::kHandInCloseUp : Drag::kNone)
                            : (hand ? Drag::kHandInOverview : Drag::kTurn);
    if (io.MouseClicked[1] && over_overview) drag_ = Drag::kTurn;
    if (io.MouseClicked[2] && over_overview) drag_ = Drag::kShift;
  }
  if (!io.MouseDown[0] && !io.MouseDown[1] && !io.MouseDown[2]) drag_ = Drag::kNone;

  const recording::Sample& now = live_.now();
  hand_.set_velocity_scale(now.velocity_scale);
  // Where motors show the force the pointer does not; a force that is old resists nobody.
  const bool resists = !facts_.shows_force && facts_.hand_force_limit_n > 0 && now.force_scale > 0 &&
                       view_model::silent_s(now) == 0;
  hand_.resist(resists ? Vec3(now.force_w_nn[0], now.force_w_nn[1], now.force_w_nn[2]) : Vec3(Vec3::Zero()),
               kHalfOfForce * facts_.hand_force_limit_n * kNanonewtonPerNewton / now.force_scale);
  const bool dragging_hand = drag_ == Drag::kHandInOverview || drag_ == Drag::kHandInCloseUp;
  hand_.hold(panel_.mouse_leads() &&
             (dragging_hand || (key_down(GLFW_KEY_SPACE) && !io.WantTextInput && !note_box_.is_open())));
  hand_.update(time_s);

  const view_model::Camera camera = fitted_overview(l.overview);
  const double overview_nm_px = camera.nm_per_pixel(l.overview.height_px);
  const double close_up_nm_px = close_up_camera_.nm_per_pixel(l.close_up.height_px);
  if (panel_.mouse_leads()) move_hand_by_keys(close_up_nm_px);
  switch (drag_) {
    case Drag::kHandInOverview: {
      view_model::PointerHand::Axes axes;
      axes.right = camera.right();
      Vec3 away = -camera.direction();
      away.z() = 0;
      // A length on the ground away from the camera looks shorter by the sine of the elevation.
      const double steep = std::max(camera.direction().z(), 0.2);
      axes.up = io.KeyShift ? Vec3::UnitZ() : Vec3(away.normalized() / steep);
      axes.nm_per_pixel = io.KeyShift ? close_up_nm_px : overview_nm_px;
      hand_.drag(io.KeyShift ? 0 : dx, dy, axes);
      break;
    }
    case Drag::kHandInCloseUp:
      hand_.drag(dx, dy, {Vec3::UnitX(), Vec3::UnitZ(), close_up_nm_px});
      break;
    case Drag::kTurn:
      overview_camera_.orbit(-kDegPerPixel * dx, kDegPerPixel * dy);
      break;
    case Drag::kShift:
      overview_camera_.target_nm += overview_nm_px * (-dx * camera.right() + dy * camera.up());
      overview_chosen_ = true;
      break;
    case Drag::kRegion:
      if (const auto place = map_.place_at(ground_, io.MousePos);
          place && (io.MouseClicked[0] || io.MouseDelta.x != 0 || io.MouseDelta.y != 0)) {
        region_.move_to(ground_, *place);
        set_region();
      }
      break;
    case Drag::kNone:
      break;
  }
  if (io.MouseWheel != 0 && free) {
    const bool zoom = !panel_.mouse_leads() || io.KeyCtrl;
    if (!zoom && (over_overview || over_close_up)) {
      hand_.turn_wheel(io.MouseWheel, io.KeyShift ? 0.1 : 0.5, time_s);
    } else if (over_close_up && zoom) {
      close_up_zoom_ = std::clamp(close_up_zoom_ * std::pow(kZoomPerNotch, io.MouseWheel), 0.1, 10.0);
    } else if (over_overview && zoom) {
      overview_camera_.zoom(std::pow(kZoomPerNotch, io.MouseWheel));
      overview_chosen_ = true;
    }
  }
}

}  // namespace telenano::viewer
