#include "telenano/master/viewer/note_box.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <algorithm>

#include "telenano/master/viewer/keys.h"

namespace telenano::viewer {

void NoteBox::open(const recording::Sample& now) {
  note_ = {};
  note_.tick = now.tick;
  note_.time_s = now.time_s;
  open_ = focus_ = waits_ = true;
  entered_ = false;
  early_.clear();
}

// ImGui gives a line the keyboard a frame after it is asked to, and drops what is typed in that frame: where
// drawing is slow, whole words. The letters of the frame in which the box opens are those of the key that opened
// it.
void NoteBox::keep_what_is_early() {
  auto& letters = ImGui::GetIO().InputQueueCharacters;
  if (waits_) {
    if (!focus_) early_.insert(early_.end(), letters.begin(), letters.end());
    entered_ |= !focus_ && key_pressed(GLFW_KEY_ENTER);
    letters.resize(0);
    return;
  }
  for (int i = 0; i < static_cast<int>(early_.size()); ++i)
    letters.insert(letters.begin() + i, early_[static_cast<std::size_t>(i)]);
  early_.clear();
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
  const bool ends = entered_ && !waits_;  // once the letters before it are in the line
  keep_what_is_early();
  if (focus_) ImGui::SetKeyboardFocusHere();
  focus_ = false;
  ImGui::SetNextItemWidth(-1);
  // Letters come without Ctrl: one that is held by now, of the next key in a slow picture, is no reason to drop them.
  ImGuiIO& io = ImGui::GetIO();
  const bool ctrl = io.KeyCtrl;
  const auto mods = io.KeyMods;
  if (!io.InputQueueCharacters.empty()) {
    io.KeyCtrl = false;
    io.KeyMods &= ~kCtrlModifier;
  }
  const bool done = ImGui::InputTextWithHint("##note", "what you saw", note_.text.data(), note_.text.size(),
                                             ImGuiInputTextFlags_EnterReturnsTrue) ||
                    ends;
  io.KeyCtrl = ctrl;
  io.KeyMods = mods;
  waits_ &= !ImGui::IsItemActive();
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
