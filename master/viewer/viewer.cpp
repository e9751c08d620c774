#include "telenano/master/viewer/viewer.h"

#include <backends/imgui_impl_opengl3.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "telenano/master/station/station.h"
#include "telenano/master/view_model/status_text.h"
#include "telenano/master/viewer/charts.h"
#include "telenano/master/viewer/overlay.h"
#include "telenano/master/viewer/playback_bar.h"
#include "telenano/master/viewer/profile_chart.h"

namespace telenano::viewer {
namespace {

using view_model::ViewRequest;

constexpr double kTextLeast = 0.75;
constexpr double kTextMost = 2.5;

ChartBox box_of(const Area& area) {
  return {{static_cast<float>(area.x_px), static_cast<float>(area.y_px)},
          {static_cast<float>(area.x_px + area.width_px), static_cast<float>(area.y_px + area.height_px)}};
}

}  // namespace

Viewer::Viewer(const ViewFacts& facts, view_model::Ground ground, view_model::ViewPort& port, float scale)
    : facts_(facts),
      tip_(view_model::drawn_tip(facts.tip_radius_given_nm, facts.scene.tip_radius_nm)),
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

void Viewer::set_server_scene(const view_model::ServerScene& scene, double time_s) {
  if (!scene.words.empty() && scene.words != facts_.scene.words) say(scene.words, time_s);
  facts_.scene = scene;
  tip_ = view_model::drawn_tip(facts_.tip_radius_given_nm, scene.tip_radius_nm);
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
  state.tip = tip_;
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

void Viewer::set_text_size(double times) noexcept {
  text_size_ = std::clamp(times, kTextLeast, kTextMost);
}

// The layout has room for words of the screen's own size in 640 × 480 of its points.
void Viewer::fit_text(int width_px, int height_px) {
  const double room = std::max(1.0, std::min(width_px / (kLeastWidth_px * screen_scale_),
                                             height_px / (kLeastHeight_px * screen_scale_)));
  gui_.set_scale(screen_scale_ * static_cast<float>(std::min(text_size_, room)));
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

void Viewer::draw(int width_px, int height_px, double time_s, const RecordingStatus& recording) {
  fit_text(width_px, height_px);
  const Layout layout = layout_of(width_px, height_px, gui_.scale(), views_);
  gui_.words().clear();
  ImGui_ImplOpenGL3_NewFrame();
  ImGui::GetIO().DisplaySize = {static_cast<float>(width_px), static_cast<float>(height_px)};
  ImGui::NewFrame();
  watch_recording(recording, time_s);
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
  place_text(time_s, layout.overview);
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
  if (panel_.take_undo_wanted()) undo_marks(time_s);
  tell_undo(time_s);
  tell_scene(time_s);
  if (panel_.take_close_wanted()) quit_ = true;
  draw_help();
  draw_end();
  draw_note(time_s);
  // After a note that was ended in this very frame.
  if (std::exchange(leaves_, false)) panel_.quit();
  draw_text();
  ImGui::Render();
  glViewport(0, 0, width_px, height_px);
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
}

}  // namespace telenano::viewer
