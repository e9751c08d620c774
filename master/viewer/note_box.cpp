#include "telenano/master/viewer/note_box.h"

#include <algorithm>

namespace telenano::viewer {

void NoteBox::open(const recording::Sample& now) {
  note_ = {};
  note_.tick = now.tick;
  note_.time_s = now.time_s;
  open_ = focus_ = true;
}

std::optional<view_model::Note> NoteBox::draw(const Gui& gui) {
  if (!open_) return std::nullopt;
  const ImVec2 whole = ImGui::GetIO().DisplaySize;
  const float s = gui.scale();
  ImGui::SetNextWindowPos({0.5f * whole.x, 0.5f * whole.y}, ImGuiCond_Always, {0.5f, 0.5f});
  ImGui::SetNextWindowSize({std::min(520 * s, whole.x - 20 * s), 0});
  ImGui::PushStyleColor(ImGuiCol_WindowBg, vec4(palette::kRaised, 0.97f));
  ImGui::PushStyleColor(ImGuiCol_FrameBg, vec4(palette::kBackground));
  ImGui::Begin("note", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoSavedSettings);
  ImGui::Text("Note at %.1f s", note_.time_s);
  if (focus_) ImGui::SetKeyboardFocusHere();
  focus_ = false;
  ImGui::SetNextItemWidth(-1);
  const bool done = ImGui::InputTextWithHint("##note", "what you saw", note_.text.data(), note_.text.size(),
                                             ImGuiInputTextFlags_EnterReturnsTrue);
  ImGui::PushStyleColor(ImGuiCol_Text, vec4(palette::kQuiet));
  ImGui::TextWrapped("Enter: into the recording. Empty: no note. Esc is STOP here too.");
  ImGui::PopStyleColor();
  ImGui::End();
  ImGui::PopStyleColor(2);
  if (!done) return std::nullopt;
  open_ = false;
  if (note_.text[0] == 0) return std::nullopt;
  return note_;
}

}  // namespace telenano::viewer
