#include "telenano/master/viewer/viewer.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_opengl3.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "telenano/common/base/constants.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/station/station.h"
#include "telenano/master/view_model/status_text.h"
#include "telenano/master/viewer/charts.h"
#include "telenano/master/viewer/guide_box.h"
#include "telenano/master/viewer/overlay.h"
#include "telenano/master/viewer/playback_bar.h"
#include "telenano/master/viewer/profile_chart.h"

namespace telenano::viewer {
namespace {

using view_model::ViewRequest;

constexpr double kTrailStep_nm = 0.25;
constexpr double kCloseUpElevation_deg = 12;
constexpr double kCloseUpLeast_nm = 8;
constexpr double kCloseUpMost_nm = 60;
constexpr double kFollow = 0.12;  // of the way to the wanted height of the close-up, in 1/60 s
constexpr double kFollowHz = 60;
constexpr double kHalfOfForce =
    0.25;  // of the force that a hand with motors would be shown at most: the pointer goes twice as far
constexpr double kDegPerPixel = 0.3;
constexpr double kTextLeast = 0.75;
constexpr double kTextMost = 2.5;
constexpr double kTextStep = 1.15;
constexpr double kLeastWidth = 640;
constexpr double kLeastHeight = 480;
constexpr double kZoomPerNotch = 1.15;
constexpr double kTipInside = 0.8;  // of the overview's half height and width that the tip does not leave

ChartBox box_of(const Area& area) {
  return {{static_cast<float>(area.x_px), static_cast<float>(area.y_px)},
          {static_cast<float>(area.x_px + area.width_px), static_cast<float>(area.y_px + area.height_px)}};
}

}  // namespace

Viewer::Viewer(const ViewFacts& facts, view_model::Ground ground, view_model::ViewPort& port, float scale)
    : facts_(facts),
      port_(port),
      screen_scale_(scale),
      gui_(scale),
      ground_(std::move(ground)),
      renderer_(ground_),
      map_(ground_),
      live_(kTrailStep_nm),
      panel_(facts_, port),
      hand_(facts.hand_half_m, facts.hand_back_s),
      guide_(facts.guide) {
  set_text_size(facts.text_size);
  reset_cameras();
}

void Viewer::set_ground(view_model::Ground ground) {
  ground_ = std::move(ground);
  map_.set_ground(ground_);
  // Another sample's places are not this one's.
  if (const auto& box = region_.box();
      box && (box->x_min_nm < ground_.min_w_nm().x() || box->x_max_nm > ground_.max_w_nm().x() ||
              box->y_min_nm < ground_.min_w_nm().y() || box->y_max_nm > ground_.max_w_nm().y())) {
    region_.whole();
    fit_overview_to_ground();
  }
  set_region();
}

// After each change of the ground or of the region.
void Viewer::set_region() {
  part_.reset();
  if (region_.box()) part_ = ground_.part(*region_.box());
  renderer_.set_ground(overview_ground());
}

void Viewer::narrow_region(double time_s) {
  const bool was_part = part_.has_value();
  const bool narrower = region_.narrow(ground_, tip_w_nm(), 4 * facts_.tip_radius_nm);
  if (!narrower && !was_part) say("The sample is too small for a region of it", time_s);
  set_region();
  fit_overview_to_ground();
}

void Viewer::fit_overview_to_ground() {
  const double extent = std::max(overview_ground().width_nm(), overview_ground().depth_nm());
  overview_camera_.target_nm = {0, 0, 0.06 * extent};
  overview_camera_.distance_nm = 2.55 * extent;
  overview_camera_.depth_range_nm = 3 * extent;
  overview_chosen_ = false;
}

void Viewer::reset_cameras() {
  if (region_.box()) {
    region_.whole();
    set_region();
  }
  overview_camera_ = {};
  overview_camera_.azimuth_deg = -62;
  overview_camera_.elevation_deg = 32;
  fit_overview_to_ground();
  close_up_camera_ = {};
  close_up_camera_.azimuth_deg = -90;
  close_up_camera_.elevation_deg = kCloseUpElevation_deg;
  close_up_camera_.orthographic = true;
  close_up_camera_.distance_nm = 1000;
  close_up_camera_.depth_range_nm = 1000;
  close_up_zoom_ = 1;
  seen_tip_ = false;
}

void Viewer::take_played(double time_s) {
  if (drawn_s_ > 0) playback_->advance(time_s - drawn_s_);
  drawn_s_ = time_s;
  const view_model::Playback::Passed passed = playback_->take();
  if (passed.anew) live_ = view_model::LiveSession(kTrailStep_nm);
  for (std::size_t i = passed.first; i < passed.end; ++i) live_.take(playback_->row(i), ground_);
}

void Viewer::take_samples() {
  recording::Sample sample;
  // As many as there can be: a loop that is faster than this must not keep the screen here for ever.
  for (std::size_t i = 0; i < port_.samples.capacity() && port_.samples.pop(sample); ++i)
    live_.take(sample, ground_);
}

SceneState Viewer::state(bool overview) const {
  const recording::Sample& now = live_.now();
  const auto vec = [](const recording::Xyz& v) { return Vec3(v[0], v[1], v[2]); };
  const view_model::Ground& ground = overview ? overview_ground() : ground_;
  SceneState state{ground, live_.trail(), live_.touched()};
  state.part = overview && part_.has_value();
  state.tip_pos_w_nm = vec(now.tip_pos_w_nm);
  state.target_pos_w_nm = vec(now.tip_target_w_nm);
  state.force_w_nn = vec(now.force_w_nn);
  state.force_full_nn = live_.force_full_nn();
  state.deflection_nm = now.deflection_nm;
  state.lever_exaggeration = SceneRenderer::lever_exaggeration(ground, live_.deflection_full_nm());
  state.contact = live_.contact();
  state.tip_radius_nm = facts_.tip_radius_nm;
  state.particle = live_.particle();
  state.wall_min_w_nm = facts_.workspace_min_w_nm;
  state.wall_max_w_nm = facts_.workspace_max_w_nm;
  if (panel_.mouse_leads() && hand_.gripped()) {
    const Vec3 target = state.target_pos_w_nm;
    state.wall_min_w_nm = state.wall_min_w_nm.cwiseMax(target + hand_.wall_below_nm());
    state.wall_max_w_nm = state.wall_max_w_nm.cwiseMin(target + hand_.wall_above_nm());
  } else if (hand_leads_in_box()) {
    const Vec3 target = state.target_pos_w_nm;
    const double nm_per_m = kNmPerM * now.velocity_scale;
    const Vec3 hand = vec(now.hand_pos_h_m);
    const Vec3 half = Vec3::Constant(facts_.hand_half_m);
    state.wall_min_w_nm = state.wall_min_w_nm.cwiseMax(target + nm_per_m * (-half - hand));
    state.wall_max_w_nm = state.wall_max_w_nm.cwiseMin(target + nm_per_m * (half - hand));
  }
  return state;
}

bool Viewer::hand_leads_in_box() const noexcept {
  const recording::Sample& now = live_.now();
  return facts_.hand_in_box && static_cast<station::Mode>(now.station_mode) == station::Mode::kEngaged;
}

// So far from where it took hold, in nm, if it is at the border of its box; else 0.
double Viewer::border_nm() const noexcept {
  if (panel_.mouse_leads() && hand_.at_border()) return hand_.reach_nm();
  if (!hand_leads_in_box()) return 0;
  const recording::Xyz& hand = live_.now().hand_pos_h_m;
  constexpr double kAlmost = 0.999;
  for (const double at_m : hand)
    if (std::abs(at_m) > kAlmost * facts_.hand_half_m)
      return facts_.hand_half_m * kNmPerM * live_.now().velocity_scale;
  return 0;
}

// The close-up goes with the tip and shows it and the ground under it, nearer when they are near.
void Viewer::follow_tip(double dt_s) {
  const recording::Sample& now = live_.now();
  const Vec3 tip(now.tip_pos_w_nm[0], now.tip_pos_w_nm[1], now.tip_pos_w_nm[2]);
  const double gap = std::abs(live_.gap_nm());
  double wanted = std::clamp(0.8 * gap + kCloseUpLeast_nm, kCloseUpLeast_nm, kCloseUpMost_nm);
  // A particle that is touched is as large as the tip: both are to be seen.
  const link::Particle particle = state(false).particle;
  if (particle.status == link::ParticleStatus::kPushed || particle.status == link::ParticleStatus::kHeld)
    wanted = std::clamp(2 * particle.radius_nm, wanted, kCloseUpMost_nm);
  // By the time that has passed: where frames are slow a drag would go by another scale.
  const double left = std::pow(1 - kFollow, std::clamp(kFollowHz * dt_s, 1.0, kFollowHz));
  close_up_half_nm_ = seen_tip_ ? wanted + left * (close_up_half_nm_ - wanted) : wanted;
  seen_tip_ = now.reply_sequence != 0;
  close_up_camera_.half_height_nm = close_up_half_nm_ / close_up_zoom_;
  Vec3 middle = tip;
  middle.z() -= 0.5 * std::clamp(live_.gap_nm(), -kCloseUpMost_nm, kCloseUpMost_nm);
  close_up_camera_.target_nm = SceneRenderer::close_up_frame(ground_).scene_nm(middle);
  close_up_camera_.target_nm.z() += 0.12 * close_up_camera_.half_height_nm;
}

// A picture that is higher than wide sees less to the sides: it stands back. So it does for a tip that leaves
// it (a stop withdraws it to the top of the workspace, and heights are drawn taller), unless a person has
// chosen what to look at.
//
// A point at d from the camera's target is seen at u = d·up / ((D − d·back) tan(φ/2)) of half the picture's
// height, D the camera's distance: within ±m for D ≥ d·back + |d·up| / (m tan(φ/2)); likewise to the sides,
// where the picture is aspect times as wide.
view_model::Camera Viewer::fitted_overview(const Area& area) const noexcept {
  view_model::Camera camera = overview_camera_;
  camera.distance_nm /= std::clamp(area.aspect(), 0.2, 1.25);
  const recording::Sample& now = live_.now();
  const Vec3 tip(now.tip_pos_w_nm[0], now.tip_pos_w_nm[1], now.tip_pos_w_nm[2]);
  if (overview_chosen_ || now.reply_sequence == 0 || !is_finite(tip)) return camera;
  constexpr double kMost = 5;  // times as far: what lies farther out is no place of a tip
  const double tangent = std::tan(0.5 * camera.field_of_view_deg * kPi / 180);
  // The apex and what stands on it, with room for the words beside it.
  const Vec3 apex = SceneRenderer::overview_frame(overview_ground()).scene_nm(tip);
  double distance_nm = camera.distance_nm;
  for (const Vec3& point : {apex, Vec3(apex + 2.5 * facts_.tip_radius_nm * Vec3::UnitZ())}) {
    const Vec3 d = point - camera.target_nm;
    const double high = std::abs(d.dot(camera.up())) / (kTipInside * tangent);
    const double wide = std::abs(d.dot(camera.right())) / (kTipInside * tangent * area.aspect());
    distance_nm = std::max(distance_nm, d.dot(camera.direction()) + std::max(high, wide));
  }
  camera.distance_nm = std::min(distance_nm, kMost * camera.distance_nm);
  return camera;
}

void Viewer::settle(int frames) {
  for (int i = 0; i < frames; ++i) follow_tip(1 / kFollowHz);
}

void Viewer::handle_keys(double time_s) {
  const ImGuiIO& io = ImGui::GetIO();
  const auto pressed = [](int key) { return ImGui::IsKeyPressed(key, false); };
  // Stop and the way out always work, whatever has the keyboard.
  if (pressed(GLFW_KEY_ESCAPE)) {
    panel_.ask(ViewRequest::Kind::kStop);
    note_box_.close();
  }
  if (pressed(GLFW_KEY_Q) && io.KeyCtrl) leaves_ = quit_ = true;
  if (!waiting_.empty()) {
    quit_ |= pressed(GLFW_KEY_ESCAPE);
    handle_text_keys(time_s);
    return;
  }
  if (io.WantTextInput || note_box_.is_open()) return;
  if (pressed(GLFW_KEY_P) || pressed(GLFW_KEY_F12)) panel_.want_picture();
  // By the letter: where it lies is the keyboard's affair.
  const auto& letters = io.InputQueueCharacters;
  if (pressed(GLFW_KEY_F1) || std::find(letters.begin(), letters.end(), ImWchar{'?'}) != letters.end())
    help_ = !help_;
  if (pressed(GLFW_KEY_F)) force_curve_shown_ = !force_curve_shown_;
  if (pressed(GLFW_KEY_D)) data_wanted_ = true;
  if (pressed(GLFW_KEY_S)) {
    surface_wanted_ = ground_.is_scan();
    if (!surface_wanted_) say("No surface to save: the sample is a plane, and has no marks", time_s);
  }
  if (pressed(GLFW_KEY_L) && live_.any()) measurement_.choose(tip_w_nm());
  if (!ending_.lines.empty() && (pressed(GLFW_KEY_ENTER) || pressed(GLFW_KEY_KP_ENTER))) again_ = true;
  handle_text_keys(time_s);
  if (pressed(GLFW_KEY_HOME)) reset_cameras();
  if (pressed(GLFW_KEY_Z) && live_.any()) narrow_region(time_s);
  if (pressed(GLFW_KEY_V))
    views_ = views_ == Views::kBoth       ? Views::kOverview
             : views_ == Views::kOverview ? Views::kCloseUp
                                          : Views::kBoth;
  if (playback_ != nullptr) {
    playback_keys(*playback_);
  } else {
    handle_session_keys(time_s);
  }
}

void Viewer::set_text_size(double times) noexcept {
  text_size_ = std::clamp(times, kTextLeast, kTextMost);
}

// The layout has room for words of the screen's own size in 640 × 480 of its points.
void Viewer::fit_text(int width_px, int height_px) {
  const double room = std::max(
      1.0, std::min(width_px / (kLeastWidth * screen_scale_), height_px / (kLeastHeight * screen_scale_)));
  gui_.set_scale(screen_scale_ * static_cast<float>(std::min(text_size_, room)));
}

void Viewer::handle_text_keys(double time_s) {
  const ImGuiIO& io = ImGui::GetIO();
  if (!io.KeyCtrl) return;
  const auto pressed = [](int key) { return ImGui::IsKeyPressed(key, false) ? 1 : 0; };
  const int more = pressed(GLFW_KEY_EQUAL) + pressed(GLFW_KEY_KP_ADD) - pressed(GLFW_KEY_MINUS) -
                   pressed(GLFW_KEY_KP_SUBTRACT);
  const bool first = pressed(GLFW_KEY_0) + pressed(GLFW_KEY_KP_0) > 0;
  if (more == 0 && !first) return;
  set_text_size(first ? 1 : text_size_ * std::pow(kTextStep, more));
  say(fmt::format("Text {:.0f} %", 100 * text_size_), time_s);
}

void Viewer::handle_session_keys(double time_s) {
  const auto pressed = [](int key) { return ImGui::IsKeyPressed(key, false); };
  if (pressed(GLFW_KEY_R)) {
    if (ImGui::GetIO().KeyCtrl) {
      panel_.want_recording();
    } else {
      panel_.ask(ViewRequest::Kind::kClearStop);
    }
  }
  if (pressed(GLFW_KEY_N)) {
    if (facts_.recording.empty()) {
      say("No recording to put a note into", time_s);
    } else if (ending_.lines.empty()) {
      note_box_.open(live_.now());
    }
  }
  if (pressed(GLFW_KEY_G)) {
    guide_ = !guide_;
    first_touch_ = {};
  }
  handle_scaling_keys();
  if (pressed(GLFW_KEY_M)) {
    panel_.ask(ViewRequest::Kind::kMarker);
    say(facts_.recording.empty() ? "No recording to put a mark into" : "Mark put into the recording", time_s);
  }
  if (pressed(GLFW_KEY_T) && !facts_.tasks.empty()) {
    // The next one that fits, round and round.
    const int count = static_cast<int>(facts_.tasks.size());
    int task = (port_.task.load().task + 1) % count;
    for (int i = 0; i < count && !panel_.task_fits(task, live_.now()); ++i) task = (task + 1) % count;
    panel_.ask_task(task, live_.now());
  }
  for (int i = 0; i < static_cast<int>(control::kAllMethods.size()); ++i) {
    if (pressed(GLFW_KEY_1 + i) && !ImGui::GetIO().KeyCtrl)
      panel_.ask_method(control::kAllMethods[static_cast<std::size_t>(i)], live_.now());
  }
  const bool clutch = panel_.clutch_on_screen() || ImGui::IsKeyDown(GLFW_KEY_C);
  hand_.clutch(clutch);
  port_.buttons.store(clutch ? static_cast<std::uint32_t>(device::kButtonClutch) : 0u);
}

// A tenth of a tenfold at a time; what is not safe is not asked for.
void Viewer::handle_scaling_keys() {
  if (!ImGui::GetIO().KeyShift || !live_.any()) return;
  const auto pressed = [](int key) { return ImGui::IsKeyPressed(key, false) ? 1 : 0; };
  const int velocity = pressed(GLFW_KEY_RIGHT) - pressed(GLFW_KEY_LEFT);
  const int force = pressed(GLFW_KEY_UP) - pressed(GLFW_KEY_DOWN);
  if (velocity != 0 || force != 0)
    panel_.ask_scaling(std::pow(10.0, 0.1 * velocity), std::pow(10.0, 0.1 * force), live_.now());
}

// As a drag in the section would: so much of it a second.
void Viewer::move_hand_by_keys(double nm_per_pixel) {
  constexpr double kPixelsPerS = 90;
  const ImGuiIO& io = ImGui::GetIO();
  if (io.KeyShift || io.WantTextInput || !ImGui::IsKeyDown(GLFW_KEY_SPACE)) return;
  const auto down = [](int key) { return ImGui::IsKeyDown(key) ? 1 : 0; };
  const double px = kPixelsPerS * std::min(static_cast<double>(io.DeltaTime), 0.1);
  const double right = px * (down(GLFW_KEY_RIGHT) - down(GLFW_KEY_LEFT));
  const double away = px * (down(GLFW_KEY_PAGE_UP) - down(GLFW_KEY_PAGE_DOWN));
  const double below = px * (down(GLFW_KEY_DOWN) - down(GLFW_KEY_UP));
  if (right != 0 || below != 0) hand_.drag(right, below, {Vec3::UnitX(), Vec3::UnitZ(), nm_per_pixel});
  if (away != 0) hand_.drag(0, -away, {Vec3::UnitX(), Vec3::UnitY(), nm_per_pixel});
}

Vec3 Viewer::tip_w_nm() const noexcept {
  const recording::Xyz& tip = live_.now().tip_pos_w_nm;
  return {tip[0], tip[1], tip[2]};
}

surface::Scan Viewer::drawn_surface() const {
  surface::Scan scan;
  scan.grid = ground_.heights();
  scan.title = facts_.scene_name;
  scan.in_frame_w = true;
  return scan;
}

std::string Viewer::data() const {
  const auto profile = measurement_.profile(ground_, tip_w_nm());
  return profile ? view_model::profile_csv(*profile) : live_.force_curve().csv();
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

void Viewer::draw_guide(const Layout& layout) {
  if (!guide_ || playback_ != nullptr || !ending_.lines.empty()) return;
  using Hand = view_model::FirstTouch::Hand;
  first_touch_.update(live_);
  const Hand hand = panel_.mouse_leads()   ? Hand::kMouse
                    : facts_.tasks.empty() ? Hand::kDevice
                                           : Hand::kSimulated;
  draw_guide_box(gui_, first_touch_.title(), first_touch_.words(live_, hand, facts_.shows_force),
                 static_cast<double>(first_touch_.step()) / view_model::FirstTouch::kSteps,
                 views_ == Views::kOverview ? layout.overview : layout.close_up);
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
             (dragging_hand || (ImGui::IsKeyDown(GLFW_KEY_SPACE) && !io.WantTextInput)));
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

void Viewer::draw_charts(const Layout& layout, int height_px) {
  ImGui::SetNextWindowPos({0, static_cast<float>(layout.overview.height_px)});
  ImGui::SetNextWindowSize(
      {static_cast<float>(layout.panel.x_px), static_cast<float>(height_px - layout.overview.height_px)});
  ImGui::Begin("charts", nullptr,
               ImGuiWindowFlags_NoBackground | ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoBringToFrontOnFocus |
                   ImGuiWindowFlags_NoInputs);
  if (force_curve_shown_) {
    draw_force_curve(gui_, {box_of(layout.charts[0]).from, box_of(layout.charts[1]).to}, live_.force_curve());
  } else {
    const Curve gap{live_.gap(), "", palette::kFree};
    const Curve force{live_.tip_force(), "", palette::kRepulsion};
    ChartScale gap_scale{"nm", 2, true, 0};
    ChartScale force_scale{"nN", 2, true, 0};
    draw_two_scales(gui_, box_of(layout.charts[0]), "Gap, tip force", gap, gap_scale, force, force_scale);
    const std::array<Curve, 3> hand = {{{live_.raw_force(), "raw", palette::kQuiet},
                                        {live_.limited_force(), "sent", palette::kAttraction},
                                        {live_.applied_force(), "felt", palette::kRepulsion}}};
    ChartScale hand_scale{"N", 0.2, true, facts_.hand_force_limit_n};
    draw_strip_chart(gui_, box_of(layout.charts[1]), "Hand force, z", hand, hand_scale);
  }
  if (const auto profile = measurement_.profile(ground_, tip_w_nm())) {
    draw_profile(gui_, {box_of(layout.charts[2]).from, box_of(layout.charts[3]).to}, *profile);
    ImGui::End();
    return;
  }
  const Curve energy{live_.energy(), "", palette::kGood};
  const Curve damper{live_.damper(), "", palette::kTarget};
  ChartScale energy_scale{"mJ", 0.5, true, 1e3 * facts_.energy_bound_j};
  ChartScale damper_scale{"N·s/m", 1, true, 0};
  draw_two_scales(gui_, box_of(layout.charts[2]), "Energy, damper", energy, energy_scale, damper,
                  damper_scale);
  draw_round_trips(gui_, box_of(layout.charts[3]), live_.round_trips());
  ImGui::End();
}

void Viewer::draw_help() {
  if (!help_) return;
  ImGui::SetNextWindowPos({ImGui::GetIO().DisplaySize.x * 0.5f, ImGui::GetIO().DisplaySize.y * 0.5f},
                          ImGuiCond_Always, {0.5f, 0.5f});
  // In a small window all of it is small; what does not fit all the same scrolls.
  const ImVec2 whole = ImGui::GetIO().DisplaySize;
  const bool small = whole.y < 640 * gui_.scale() || whole.x < 900 * gui_.scale();
  ImGui::SetNextWindowSizeConstraints({0, 0}, whole);
  ImGui::PushStyleColor(ImGuiCol_WindowBg, vec4(palette::kRaised, 0.97f));
  ImGui::PushFont(small ? gui_.small() : gui_.text());
  ImGui::PushStyleVar(ImGuiStyleVar_CellPadding, {4 * gui_.scale(), (small ? 0.5f : 2.0f) * gui_.scale()});
  ImGui::Begin("help", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoSavedSettings);
  ImGui::PushFont(small ? gui_.text() : gui_.large());
  ImGui::TextUnformatted("Keys and mouse");
  ImGui::PopFont();
  ImGui::Separator();
  if (ImGui::BeginTable("keys", 2, ImGuiTableFlags_SizingFixedFit)) {
    const auto row = [](const char* key, const char* what) {
      ImGui::TableNextRow();
      ImGui::TableNextColumn();
      ImGui::TextColored(vec4(palette::kWarning), "%s", key);
      ImGui::TableNextColumn();
      ImGui::TextUnformatted(what);
    };
    if (panel_.mouse_leads()) {
      row("left drag, section",
          "take hold and move the tip along x and z, a nanometre to the picture's nanometre");
      row("left drag, overview", "take hold and move the tip over the sample; with Shift: up and down");
      row("", "the harder the sample pushes or pulls, the farther the mouse must go against it");
      row("wheel", "tip up or down by 0.5 nm a notch; with Shift 0.1 nm");
      row("Space held", "keep hold (deadman); letting go stops the tip where it is");
      row("with arrows", "the tip along x and z; page up, page down: along y");
      row("Ctrl + wheel", "nearer, farther");
      row("right drag, overview", "turn the picture");
    } else {
      row("left or right drag", "turn the overview");
      row("wheel", "nearer, farther");
    }
    row("middle drag, overview", "move the picture");
    row("V", "both pictures, overview, section");
    row("Z", "the region round the tip, larger; at last the whole again; a click in the map moves it");
    row("Home", "the first view again");
    row("P or F12", "picture of this window (PNG)");
    row("Ctrl + plus, minus, 0", "words larger, smaller, as at first");
    row("F", "force over distance of the last touch, or the charts over time");
    row("D", "that curve, or the profile that is measured, as a table (CSV)");
    row("S", "the surface as it is drawn, with its marks (GSF, for Gwyddion)");
    row("L", "measure from the tip; again: to the tip; again: no more");
    row("Ctrl + click, overview", "the same where you point");
    if (playback_ != nullptr) {
      row("Space", "play, pause");
      row("Left, Right", "a second back, on; with Shift a hundredth");
      row("Page up, Page down", "to the mark or event before, after");
      row("Up, Down", "faster, slower");
      row("Ctrl + Q", "close");
    } else {
      row("Esc", "STOP: zero force, the tip retracts");
      row("R", "clear the stop, when you have looked");
      row("C held", "clutch: move the hand, the tip stands");
      row("1 … 8", "control method");
      row("Shift + arrows", "right, left: distances more, less; up, down: forces");
      if (!facts_.tasks.empty()) row("T", "the next task of the hand: it lets go, goes back, begins");
      row("Ctrl + R", "a recording from now on");
      row("M", "a mark in the recording");
      row("N", "a note in the recording, at this moment");
      row("G", "guide to a first touch");
      row("Ctrl + Q", "end the session");
    }
    row("F1 or ?", "this help");
    ImGui::EndTable();
  }
  ImGui::Separator();
  ImGui::TextColored(vec4(palette::kRepulsion), "orange: pushed away, in contact");
  ImGui::SameLine();
  ImGui::TextColored(vec4(palette::kAttraction), "  blue: pulled towards the sample");
  ImGui::SameLine();
  ImGui::TextColored(vec4(palette::kTarget), "  diamond: where the hand wants the tip");
  ImGui::End();
  ImGui::PopStyleVar();
  ImGui::PopFont();
  ImGui::PopStyleColor();
}

void Viewer::say(const std::string& text, double time_s) {
  said_ = text;
  said_until_s_ = time_s + 2;
}

void Viewer::end(view_model::SessionEnd end) {
  ending_ = std::move(end);
  note_box_.close();
  panel_.end();
}

void Viewer::wait(const std::string& words, const Vec3& tip_w_nm) {
  waiting_ = words;
  recording::Sample start;
  start.tip_pos_w_nm = start.tip_target_w_nm = recording::xyz(tip_w_nm);
  live_.take(start, ground_);
}

void Viewer::begin(const ViewFacts& facts) {
  waiting_.clear();
  facts_ = facts;
  panel_.begin();
  hand_ = view_model::PointerHand(facts.hand_half_m, facts.hand_back_s);
  live_ = view_model::LiveSession(kTrailStep_nm);
  guide_ = facts.guide;
  seen_tip_ = quit_ = false;
}

void Viewer::draw_waiting(const Area& panel) {
  ImGui::SetNextWindowPos({static_cast<float>(panel.x_px), static_cast<float>(panel.y_px)});
  ImGui::SetNextWindowSize({static_cast<float>(panel.width_px), static_cast<float>(panel.height_px)});
  ImGui::Begin("waiting", nullptr,
               ImGuiWindowFlags_NoBackground | ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoBringToFrontOnFocus);
  ImGui::PushFont(gui_.large());
  if (ImGui::Button("Cancel  (Esc)", {ImGui::GetContentRegionAvail().x, 40 * gui_.scale()})) quit_ = true;
  ImGui::TextWrapped("Getting ready");
  ImGui::PopFont();
  ImGui::TextWrapped("%s", waiting_.c_str());
  ImGui::End();
}

void Viewer::draw_end() {
  if (ending_.lines.empty()) return;
  const ImVec2 whole = ImGui::GetIO().DisplaySize;
  const float wide = std::min(560 * gui_.scale(), whole.x - 40 * gui_.scale());
  ImGui::SetNextWindowPos({0.5f * whole.x, 0.5f * whole.y}, ImGuiCond_Always, {0.5f, 0.5f});
  ImGui::SetNextWindowSize({wide, 0});
  ImGui::PushStyleColor(ImGuiCol_WindowBg, vec4(palette::kRaised, 0.97f));
  ImGui::Begin("end", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoSavedSettings);
  ImGui::PushFont(gui_.large());
  ImGui::TextColored(vec4(ending_.failed ? palette::kAlarm : palette::kText), "The session has ended");
  ImGui::PopFont();
  ImGui::Separator();
  for (const std::string& line : ending_.lines) ImGui::TextWrapped("%s", line.c_str());
  ImGui::Separator();
  const ImVec2 button{170 * gui_.scale(), 36 * gui_.scale()};
  ImGui::PushStyleColor(ImGuiCol_Button, vec4(palette::kEdge));
  if (ImGui::Button("Again  (Enter)", button)) again_ = true;
  ImGui::SameLine();
  if (ImGui::Button("Close  (Ctrl+Q)", button)) quit_ = true;
  ImGui::PopStyleColor();
  ImGui::End();
  ImGui::PopStyleColor();
}

void Viewer::draw_note(double time_s) {
  const auto note = note_box_.draw(gui_);
  if (!note) return;
  say(port_.notes.push(*note) ? "Note put into the recording" : "The note could not be taken: try again",
      time_s);
}

void Viewer::draw_text(double time_s, const Area& area) {
  if (time_s > said_until_s_) return;
  const ImVec2 size = gui_.text()->CalcTextSizeA(gui_.text()->FontSize, 1e9f, 0, said_.c_str());
  const ImVec2 p{static_cast<float>(area.x_px) + 12 * gui_.scale(),
                 static_cast<float>(area.y_px) + 44 * gui_.scale()};
  ImDrawList* const list = ImGui::GetForegroundDrawList();
  list->AddRectFilled({p.x - 6, p.y - 4}, {p.x + size.x + 6, p.y + size.y + 4}, ink(palette::kRaised), 4);
  list->AddText(gui_.text(), gui_.text()->FontSize, p, ink(palette::kText), said_.c_str());
}

void Viewer::draw(int width_px, int height_px, double time_s, const RecordingStatus& recording) {
  fit_text(width_px, height_px);
  const Layout layout = layout_of(width_px, height_px, gui_.scale(), views_);
  gui_.words().clear();
  ImGui_ImplOpenGL3_NewFrame();
  ImGui::GetIO().DisplaySize = {static_cast<float>(width_px), static_cast<float>(height_px)};
  ImGui::NewFrame();
  handle_keys(time_s);
  if (playback_ != nullptr) take_played(time_s);
  follow_tip(time_s - std::exchange(followed_s_, time_s));
  if (live_.any() && region_.follow(ground_, tip_w_nm())) set_region();
  if (waiting_.empty()) handle_mouse(layout, time_s);

  glViewport(0, 0, width_px, height_px);
  glDisable(GL_SCISSOR_TEST);
  glClearColor(palette::kPanel.r, palette::kPanel.g, palette::kPanel.b, 1);
  glClear(GL_COLOR_BUFFER_BIT);
  const SceneFrame frame = SceneRenderer::overview_frame(overview_ground());
  const SceneFrame close_frame = SceneRenderer::close_up_frame(ground_);
  draw_banner(gui_, facts_, live_, layout.overview, !ending_.lines.empty(), port_.twin.load(),
              panel_.practice_text());
  draw_guide(layout);
  if (views_ != Views::kCloseUp) {
    const SceneState now = state(true);
    if (part_) {
      map_.draw(gui_, ground_, *region_.box(), tip_w_nm(), layout.overview);
    } else {
      map_.hide();
    }
    const view_model::Camera camera = shown_overview_camera_ = fitted_overview(layout.overview);
    renderer_.draw_overview(now, camera, frame, layout.overview, height_px);
    if (const auto profile = measurement_.profile(ground_, tip_w_nm()))
      draw_measurement(gui_, *profile, camera, frame, layout.overview);
    draw_overview_text(gui_, facts_, now, live_, camera, frame, layout.overview);
  }
  if (views_ != Views::kOverview) {
    const SceneState now = state(false);
    renderer_.draw_close_up(now, close_up_camera_, close_frame, layout.close_up, height_px);
    draw_close_up_text(gui_, now, live_, close_up_camera_, close_frame, layout.close_up);
  }
  if (waiting_.empty()) {
    draw_charts(layout, height_px);
    panel_.tell_border(border_nm());
    panel_.draw(gui_, live_, recording, layout.panel);
  } else {
    draw_waiting(layout.panel);
  }
  if (panel_.take_help_wanted()) help_ = !help_;
  if (panel_.take_close_wanted()) quit_ = true;
  draw_help();
  draw_end();
  draw_note(time_s);
  // After a note that was ended in this very frame.
  if (std::exchange(leaves_, false)) panel_.ask(ViewRequest::Kind::kQuit);
  draw_text(time_s, layout.overview);
  ImGui::Render();
  glViewport(0, 0, width_px, height_px);
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
}

}  // namespace telenano::viewer
