#include "telenano/master/viewer/limited_slider.h"

#include <algorithm>

#include "telenano/master/view_model/scaling_region.h"

namespace telenano::viewer {

void limited_slider(const Gui& gui, const char* id, const char* text, float wide, SliderState& state) {
  const float s = gui.scale();
  const bool fits = ImGui::CalcTextSize(text).x <= wide;
  if (!fits) ImGui::PushFont(gui.small());
  ImGui::TextUnformatted(text);
  if (!fits) ImGui::PopFont();
  const ImVec2 from = ImGui::GetCursorScreenPos();
  const float high = 16 * s;
  ImGui::InvisibleButton(id, {wide, high});
  const bool held = ImGui::IsItemActive();
  if (held) {
    const double part = (ImGui::GetIO().MousePos.x - from.x) / wide;
    const double value = view_model::value_of(part, state.least, state.greatest);
    state.changed = value != state.value;
    state.value = value;
  }
  state.let_go = ImGui::IsItemDeactivated();
  ImDrawList* const list = ImGui::GetWindowDrawList();
  const float y = from.y + 0.5f * high;
  const auto x_of = [&](double value) {
    return from.x + wide * static_cast<float>(view_model::slider_of(value, state.least, state.greatest));
  };
  list->AddRectFilled({from.x, y - 3 * s}, {from.x + wide, y + 3 * s}, ink(palette::kRaised), 3 * s);
  const float x = x_of(state.value);
  if (state.limit > 0 && state.limit < state.greatest) {
    const float x_limit = x_of(state.limit);
    list->AddRectFilled({x_limit, y - 3 * s}, {from.x + wide, y + 3 * s}, ink(palette::kAlarm, 0.45f), 3 * s);
    list->AddLine({x_limit, y - 7 * s}, {x_limit, y + 7 * s}, ink(palette::kAlarm), 2 * s);
  }
  list->AddRectFilled({from.x, y - 3 * s}, {x, y + 3 * s}, ink(palette::kGood, 0.55f), 3 * s);
  list->AddCircleFilled({x, y}, (held || ImGui::IsItemHovered() ? 8 : 7) * s, ink(palette::kText));
}

}  // namespace telenano::viewer
