#include "telenano/master/viewer/start_screen.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_opengl3.h>
#include <imgui_stdlib.h>

#include <algorithm>
#include <array>

#include "telenano/master/viewer/gl.h"
#include "telenano/master/viewer/keys.h"
#include "telenano/master/viewer/layout.h"

namespace telenano::viewer {
namespace {

constexpr std::array<const char*, 9> kMethods = {"auto", "twin", "tank",     "model", "tdpa",
                                                 "wave", "ks",   "ks-clamp", "none"};
constexpr float kMostWide = 900;

// Of the command line in the foot and of a server's words: a few lines, so that what begins a session stays in sight.
constexpr std::size_t kTold = 280;

// However long: what was typed is nowhere cut but on the screen.
bool edit(const char* id, const char* hint, std::string& text, bool enter = false) {
  const int flags = enter ? ImGuiInputTextFlags_EnterReturnsTrue : ImGuiInputTextFlags_None;
  ImGui::PushAllowKeyboardFocus(true);
  const bool entered = ImGui::InputTextWithHint(id, hint, &text, flags);
  ImGui::PopAllowKeyboardFocus();
  return entered;
}

void quiet(const char* text) {
  ImGui::PushStyleColor(ImGuiCol_Text, vec4(palette::kQuiet));
  ImGui::TextWrapped("%s", text);
  ImGui::PopStyleColor();
}

void coloured(const palette::Rgb& colour, const std::string& text) {
  ImGui::PushStyleColor(ImGuiCol_Text, vec4(colour));
  ImGui::TextWrapped("%s", text.c_str());
  ImGui::PopStyleColor();
}

}  // namespace

StartScreen::StartScreen(float scale) : screen_scale_(scale), gui_(scale) {
  ImGui::GetIO().ConfigFlags |= ImGuiConfigFlags_NavEnableKeyboard;
}

float StartScreen::label(const char* text) const {
  const float wide = 110 * gui_.scale();
  ImGui::AlignTextToFramePadding();
  ImGui::TextColored(vec4(palette::kQuiet), "%s", text);
  ImGui::SameLine(wide);
  return wide;
}

/// Under its field, where what it says begins.
void StartScreen::tell_fault(const std::string& fault) const {
  if (fault.empty()) return;
  ImGui::SetCursorPosX(110 * gui_.scale());
  ImGui::PushFont(gui_.small());
  coloured(palette::kWarning, fault);
  ImGui::PopFont();
}

StartScreen::Wish StartScreen::draw_keys(view_model::StartChoice& choice) {
  Wish wish = Wish::kNone;
  const auto field = [&](const char* name, const char* id, const char* hint, std::string& text,
                         const std::string& fault) {
    label(name);
    ImGui::SetNextItemWidth(-1);
    if (edit(id, hint, text, true)) wish = Wish::kLook;
    tell_fault(fault);
  };
  const bool pair = !choice.identity.empty() || !choice.server_key.empty();
  // The one that is not used stays in sight only where both were named: that is a fault to be cleared.
  if (!pair || !choice.key.empty())
    field("Key file", "##key", "none: in the clear, for this machine alone", choice.key, faults_.key);
  field("Identity", "##identity", "none: file of a key pair that telenano-master enroll made",
        choice.identity, faults_.identity);
  if (pair)
    field("Server's key", "##server_key", "sha256:…, as the server's keys identity prints it",
          choice.server_key, faults_.server_key);
  return wish;
}

/// Of a server that has one there is nothing to choose.
StartScreen::Wish StartScreen::draw_scenes(const StartFacts& facts, view_model::StartChoice& choice) {
  // Another server's names say nothing here.
  if (!facts.scenes_of.empty() && facts.scenes_of != choice.server) choice.server_scene.clear();
  const bool known = facts.scenes_of == choice.server && facts.scenes.size() > 1;
  if (!known && choice.server_scene.empty()) return Wish::kNone;
  Wish wish = Wish::kNone;
  label("Sample");
  ImGui::SetNextItemWidth(-1);
  const std::string shown = choice.server_scene.empty() && known ? facts.scenes.front() : choice.server_scene;
  if (ImGui::BeginCombo("##scene", shown.c_str())) {
    // A name that was given when the program began, and that no server has confirmed, can be left.
    if (!known && ImGui::Selectable("the server's first")) choice.server_scene.clear(), wish = Wish::kLook;
    for (const std::string& scene : facts.scenes) {
      if (!known || !ImGui::Selectable(scene.c_str(), scene == shown) || scene == shown) continue;
      choice.server_scene = scene == facts.scenes.front() ? "" : scene;
      wish = Wish::kLook;
    }
    ImGui::EndCombo();
  }
  tell_fault(faults_.server_scene);
  return wish;
}

void StartScreen::draw_hands(const StartFacts& facts, view_model::StartChoice& choice) {
  label("Hand");
  ImGui::BeginGroup();
  for (const OfferedHand& hand : facts.hands) {
    ImGui::PushID(&hand);
    if (hand.why_not.empty()) {
      if (ImGui::RadioButton(hand.about.c_str(), choice.device == hand.device)) choice.device = hand.device;
    } else {
      quiet((hand.about + ": " + hand.why_not).c_str());
    }
    ImGui::PopID();
  }
  ImGui::EndGroup();
}

StartScreen::Wish StartScreen::draw_choices(const StartFacts& facts, view_model::StartChoice& choice) {
  Wish wish = Wish::kNone;
  const float s = gui_.scale();
  label("Server");
  ImGui::SetNextItemWidth(-90 * s);
  if (edit("##server", "HOST:PORT", choice.server, true)) wish = Wish::kLook;
  ImGui::SameLine();
  if (ImGui::Button("Ask", {-1, 0})) wish = Wish::kLook;
  tell_fault(faults_.server);
  if (!facts.seen.empty()) {
    label("Seen lately");
    ImGui::BeginGroup();
    for (const SeenServer& seen : facts.seen) {
      ImGui::PushID(&seen);
      const std::string text = (seen.scene.empty() ? "" : seen.scene + "   at ") + seen.server +
                               (seen.key.empty() ? "" : "   key " + seen.key) +
                               (seen.identity.empty() ? "" : "   identity " + seen.identity);
      const bool chosen = seen.server == choice.server && seen.key == choice.key &&
                          seen.identity == choice.identity && seen.server_key == choice.server_key;
      // The words apart: what stands behind "##" in them would be taken for a name that is not shown.
      const ImVec2 at = ImGui::GetCursorPos();
      const bool wanted = ImGui::Selectable("##seen", chosen);
      ImGui::SetCursorPos(at);
      ImGui::TextUnformatted(view_model::shown_text(text, kTold).c_str());
      if (wanted) {
        choice.server = seen.server;
        choice.key = seen.key;
        choice.identity = seen.identity;
        choice.server_key = seen.server_key;
        wish = Wish::kLook;
      }
      ImGui::PopID();
    }
    ImGui::EndGroup();
  }
  if (draw_keys(choice) != Wish::kNone) wish = Wish::kLook;
  if (draw_scenes(facts, choice) != Wish::kNone) wish = Wish::kLook;
  draw_hands(facts, choice);
  label("Method");
  ImGui::SetNextItemWidth(150 * s);
  if (ImGui::BeginCombo("##method", choice.method.c_str())) {
    for (const char* method : kMethods) {
      if (ImGui::Selectable(method, choice.method == method) && choice.method != method) {
        choice.method = method;
        wish = Wish::kLook;
      }
    }
    ImGui::EndCombo();
  }
  ImGui::SameLine();
  quiet(choice.method == "auto" ? "chosen by the link to the server" : "as you choose");
  label("First touch");
  ImGui::Checkbox("lead me to it in five steps", &choice.guide);
  draw_recording(choice);
  return wish;
}

void StartScreen::draw_recording(view_model::StartChoice& choice) {
  label("Recording");
  ImGui::Checkbox("##record", &choice.record);
  ImGui::SameLine();
  if (choice.record) {
    ImGui::SetNextItemWidth(-1);
    edit("##file", "file (.h5)", choice.recording);
  } else {
    quiet("off");
  }
  tell_fault(faults_.recording);
}

void StartScreen::draw_plan(const StartFacts& facts, const view_model::StartChoice& choice) {
  ImGui::TextColored(vec4(palette::kQuiet), "What you will feel");
  ImGui::Indent();
  if (facts.looking) {
    coloured(palette::kWarning,
             "Asking the server …" +
                 (facts.looking_at.empty() ? "" : " " + view_model::shown_text(facts.looking_at, kTold)));
  } else if (!facts.trouble.empty()) {
    coloured(palette::kAlarm, view_model::shown_text(facts.trouble, kTold));
  } else if (facts.plan) {
    const auto hand = std::find_if(facts.hands.begin(), facts.hands.end(),
                                   [&](const OfferedHand& one) { return one.device == choice.device; });
    for (const std::string& line :
         view_model::plan_text(*facts.plan, hand == facts.hands.end() || hand->shows_force))
      ImGui::TextWrapped("%s", line.c_str());
  } else {
    quiet("Ask the server, and it is said here");
  }
  ImGui::Unindent();
}

void StartScreen::draw_end(const StartFacts& facts) {
  if (facts.last_text.empty()) return;
  coloured(facts.last_failed ? palette::kAlarm : palette::kGood,
           facts.last_failed ? "The session ended with a fault" : "The session has ended");
  ImGui::PushFont(gui_.small());
  for (const std::string& line : facts.last_text) {
    // A summary's rows: an indented name, spaces, a value.
    const auto gap = line.starts_with("  ") ? line.find("  ", 2) : std::string::npos;
    const auto value = gap == std::string::npos ? gap : line.find_first_not_of(' ', gap);
    if (value == std::string::npos) {
      ImGui::TextWrapped("%s", line.c_str());
      continue;
    }
    ImGui::TextUnformatted(line.data(), line.data() + gap);
    ImGui::SameLine(180 * gui_.scale());
    ImGui::TextUnformatted(line.c_str() + value);
  }
  ImGui::PopFont();
  ImGui::Separator();
}

StartScreen::Wish StartScreen::draw_foot(const StartFacts& facts, const view_model::StartChoice& choice,
                                         bool enter) {
  Wish wish = Wish::kNone;
  const float s = gui_.scale();
  // As the fields are now: a letter of this very frame counts.
  view_model::StartFaults faults = view_model::start_faults(choice);
  faults.add(facts.faults);
  const std::string field = faults.first_field();
  ImGui::PushFont(gui_.small());
  quiet("The same by command line:");
  ImGui::TextWrapped("%s", view_model::shown_text(facts.command_line, kTold).c_str());
  ImGui::PopFont();
  if (!field.empty()) coloured(palette::kWarning, "Correct this field first: " + field);
  ImGui::PushFont(gui_.large());
  ImGui::PushStyleColor(ImGuiCol_Button, vec4(field.empty() ? palette::kGood : palette::kRaised));
  ImGui::PushStyleColor(ImGuiCol_Text, vec4(field.empty() ? palette::kBackground : palette::kQuiet));
  ImGui::PushStyleColor(ImGuiCol_ButtonHovered, vec4(field.empty() ? palette::kGood : palette::kRaised));
  if (first_) ImGui::SetKeyboardFocusHere();
  const bool pressed =
      ImGui::Button(facts.last_text.empty() ? "Start  (Enter)" : "Again  (Enter)", {200 * s, 40 * s});
  if ((pressed || enter) && field.empty()) wish = Wish::kStart;
  ImGui::PopStyleColor(3);
  ImGui::PopFont();
  ImGui::SameLine();
  if (ImGui::Button("Copy the command", {0, 40 * s})) wish = Wish::kCopy;
  ImGui::SameLine();
  if (ImGui::Button("Close", {0, 40 * s})) wish = Wish::kClose;
  return wish;
}

StartScreen::Wish StartScreen::draw(int width_px, int height_px, const StartFacts& facts,
                                    view_model::StartChoice& choice) {
  // As large as asked for, as far as the window has room.
  const double room = std::max(1.0, std::min(width_px / (kLeastWidth_px * screen_scale_),
                                             height_px / (kLeastHeight_px * screen_scale_)));
  gui_.set_scale(screen_scale_ * static_cast<float>(std::min(choice.text_size, room)));
  ImGui_ImplOpenGL3_NewFrame();
  const ImVec2 whole{static_cast<float>(width_px), static_cast<float>(height_px)};
  ImGui::GetIO().DisplaySize = whole;
  ImGui::NewFrame();
  glViewport(0, 0, width_px, height_px);
  glDisable(GL_SCISSOR_TEST);
  glClearColor(palette::kBackground.r, palette::kBackground.g, palette::kBackground.b, 1);
  glClear(GL_COLOR_BUFFER_BIT);
  const float wide = std::min(kMostWide * gui_.scale(), whole.x);
  ImGui::SetNextWindowPos({0.5f * (whole.x - wide), 0});
  ImGui::SetNextWindowSize({wide, whole.y});
  ImGui::Begin("start", nullptr,
               ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoCollapse);
  // Enter begins whatever has the focus, but for a field that is written in, which asks the server.
  const bool enter = !ImGui::GetIO().WantTextInput &&
                     !ImGui::IsPopupOpen("", ImGuiPopupFlags_AnyPopupId | ImGuiPopupFlags_AnyPopupLevel) &&
                     key_pressed(GLFW_KEY_ENTER);
  if (enter) press_nothing();
  // Tab goes from field to field; from 1.89 on Dear ImGui would stop at every button between them.
  ImGui::PushAllowKeyboardFocus(false);
  ImGui::PushFont(gui_.large());
  ImGui::TextUnformatted("Telenano");
  ImGui::PopFont();
  ImGui::SameLine();
  quiet("feel a sample from here");
  ImGui::Separator();
  // What does not fit scrolls; what begins a session stays in sight.
  ImGui::BeginChild("choices", {0, -foot_px_}, false, ImGuiWindowFlags_NavFlattened);
  faults_ = view_model::start_faults(choice);
  faults_.add(facts.faults);
  draw_end(facts);
  Wish wish = draw_choices(facts, choice);
  ImGui::Separator();
  draw_plan(facts, choice);
  ImGui::EndChild();
  const float foot_from = ImGui::GetCursorPosY();
  ImGui::Separator();
  const Wish foot = draw_foot(facts, choice, enter);
  if (foot != Wish::kNone) wish = foot;
  foot_px_ = ImGui::GetCursorPosY() - foot_from + ImGui::GetStyle().ItemSpacing.y;
  ImGui::PopAllowKeyboardFocus();
  ImGui::End();
  first_ = false;
  ImGui::Render();
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
  return wish;
}

}  // namespace telenano::viewer
