#include "telenano/master/viewer/playback_bar.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "telenano/master/viewer/keys.h"

namespace telenano::viewer {
namespace {

constexpr std::array<double, 9> kSpeeds = {0.01, 0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10};
constexpr double kStepS = 1;
constexpr double kSmallStepS = 0.01;

// The next speed of the list up or down.
double other_speed(double speed, int way) {
  double best = speed;
  for (const double s : kSpeeds) {
    if (way > 0 && s > speed && (best == speed || s < best)) best = s;
    if (way < 0 && s < speed && (best == speed || s > best)) best = s;
  }
  return best;
}

}  // namespace

void playback_keys(view_model::Playback& playback) {
  const ImGuiIO& io = ImGui::GetIO();
  if (key_pressed(GLFW_KEY_SPACE)) playback.play(!playback.playing());
  const double step_s = io.KeyShift ? kSmallStepS : kStepS;
  if (key_pressed(GLFW_KEY_RIGHT, true)) playback.seek(playback.time_s() + step_s);
  if (key_pressed(GLFW_KEY_LEFT, true)) playback.seek(playback.time_s() - step_s);
  if (key_pressed(GLFW_KEY_PAGE_DOWN)) playback.seek_mark(1);
  if (key_pressed(GLFW_KEY_PAGE_UP)) playback.seek_mark(-1);
  if (key_pressed(GLFW_KEY_UP)) playback.set_speed(other_speed(playback.speed(), 1));
  if (key_pressed(GLFW_KEY_DOWN)) playback.set_speed(other_speed(playback.speed(), -1));
}

void draw_playback(const Gui& gui, view_model::Playback& playback) {
  const float s = gui.scale();
  const float wide = ImGui::GetContentRegionAvail().x;
  const float gap = ImGui::GetStyle().ItemSpacing.x;
  const float small = 44 * s;
  ImGui::PushFont(gui.large());
  if (ImGui::Button("<##mark", {small, 40 * s})) playback.seek_mark(-1);
  ImGui::SameLine();
  const bool at_end = playback.time_s() >= playback.end_s();
  const char* const what = playback.playing() ? "Pause" : at_end ? "Again" : "Play";
  ImGui::PushID("play");
  if (ImGui::Button(what, {wide - 2 * (small + gap), 40 * s})) playback.play(!playback.playing());
  ImGui::PopID();
  ImGui::SameLine();
  if (ImGui::Button(">##mark", {small, 40 * s})) playback.seek_mark(1);
  ImGui::PopFont();

  auto time_s = static_cast<float>(playback.time_s());
  const auto begin_s = static_cast<float>(playback.begin_s());
  const auto end_s = static_cast<float>(playback.end_s());
  ImGui::SetNextItemWidth(wide);
  const ImVec2 from = ImGui::GetCursorScreenPos();
  const std::string shown = fmt::format("{:.2f} of {:.1f} s", playback.time_s(), playback.end_s());
  if (ImGui::SliderFloat("##time", &time_s, begin_s, std::max(end_s, begin_s + 1e-3f), shown.c_str(),
                         ImGuiSliderFlags_NoInput))
    playback.seek(static_cast<double>(time_s));
  // Marks stand under the slider.
  const float y = ImGui::GetItemRectMax().y;
  for (const auto& mark : playback.marks()) {
    const double part =
        (mark.time_s - playback.begin_s()) / std::max(playback.end_s() - playback.begin_s(), 1e-9);
    const float x = from.x + static_cast<float>(part) * wide;
    ImGui::GetWindowDrawList()->AddTriangleFilled({x, y}, {x - 4 * s, y + 6 * s}, {x + 4 * s, y + 6 * s},
                                                  ink(palette::kWarning));
  }
  ImGui::Dummy({wide, 4 * s});
  ImGui::TextColored(vec4(palette::kQuiet), "Speed");
  ImGui::SameLine();
  ImGui::SetNextItemWidth(96 * s);
  if (ImGui::BeginCombo("##speed", fmt::format("{:g}×", playback.speed()).c_str())) {
    for (const double speed : kSpeeds) {
      if (ImGui::Selectable(fmt::format("{:g}×", speed).c_str(), speed == playback.speed()))
        playback.set_speed(speed);
    }
    ImGui::EndCombo();
  }
  ImGui::SameLine();
  const auto* const mark = playback.newest_mark();
  ImGui::TextColored(vec4(palette::kWarning), "%s", mark != nullptr ? mark->text.c_str() : " ");
}

}  // namespace telenano::viewer
