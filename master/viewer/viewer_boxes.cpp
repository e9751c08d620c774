// What lies over the pictures: help, words, the guide, a note, waiting, the end.
#include "telenano/master/viewer/viewer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "telenano/master/view_model/start_faults.h"
#include "telenano/master/view_model/status_text.h"
#include "telenano/master/viewer/guide_box.h"
#include "telenano/master/viewer/overlay.h"
#include "telenano/master/viewer/profile_chart.h"

namespace telenano::viewer {
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
          "take hold and move the tip along x and z, as far as the mouse moves in the picture");
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
    row("Z", "enlarge the region round the tip, in the end the whole again; a click in the map moves it");
    row("Home", "back to the first view");
    row("P or F12", "picture of this window (PNG)");
    row("Ctrl + plus, minus, 0", "text larger, smaller, as at first");
    row("F", "force over distance of the last touch, or the charts over time");
    row("D", "that curve, or the profile that is measured, as a table (CSV)");
    row("S", "the surface as it is drawn, with its marks (GSF, for Gwyddion)");
    row("L", "measure from the tip; again: to the tip; a third time: stop");
    row("Ctrl + click, overview", "measure at the place you point to");
    if (playback_ != nullptr) {
      row("Space", "play, pause");
      row("Left, Right", "a second back, forward; with Shift a hundredth");
      row("Page up, Page down", "to the previous, next mark or event");
      row("Up, Down", "faster, slower");
      row("Ctrl + Q", "close");
    } else {
      row("Esc", "STOP: zero force, the tip retracts");
      row("R", "clear the stop, when you have looked");
      row("C held", "clutch: move the hand, the tip stands");
      row("1 … 8", "control method");
      row("Shift + arrows", "right, left: larger, smaller distances; up, down: forces");
      if (!facts_.tasks.empty()) row("T", "the next task of the hand: it lets go, goes back, begins");
      row("Ctrl + R", "record from now on");
      if (facts_.can_undo)
        row("U", "undo the last marks: the sample as it was before the tip touched it last");
      row("M", "put a mark into the recording");
      row("N", "put a note into the recording, at this moment");
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
  constexpr std::size_t kMost = 400;  // letters: a line about a path of 4095 bytes is no picture
  constexpr double kLettersPerS = 20;
  said_ = view_model::shown_text(text, kMost);
  said_until_s_ = time_s + 2 + std::max(static_cast<double>(said_.size()) - 40, 0.0) / kLettersPerS;
}

void Viewer::watch_recording(const RecordingStatus& recording, double time_s) {
  if (recording.failed && !recording_failed_)
    say("The recording has failed, and the session goes on: " + recording.failure, time_s);
  recording_failed_ = recording.failed;
}

void Viewer::end(view_model::SessionEnd end) {
  ending_ = std::move(end);
  note_box_.close();
  panel_.end();
}

void Viewer::wait(const std::string& words, const Vec3& tip_w_nm) {
  waiting_ = words;
  // Of another sample nothing stays but what a person has set of the window itself.
  live_ = view_model::LiveSession(kTrailStep_nm);
  measurement_ = {};
  overview_chosen_ = false;
  reset_cameras();
  undo_told_ = scene_told_ = 0;
  note_box_.close();
  recording::Sample start;
  start.tip_pos_w_nm = start.tip_target_w_nm = recording::xyz(tip_w_nm);
  live_.take(start, ground_);
}

void Viewer::begin(const ViewFacts& facts) {
  waiting_.clear();
  facts_ = facts;
  tip_ = view_model::drawn_tip(facts.tip_radius_given_nm, facts.scene.tip_radius_nm);
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
  const bool taken = port_.notes.push(*note);
  say(recording_failed_ ? "The recording has failed: the note is not kept"
      : taken           ? "Note put into the recording"
                        : "The note could not be taken: try again",
      time_s);
}

/// Before the other words are placed, so that they leave it room: under the badges, however many rows they take.
void Viewer::place_text(double time_s, const Area& area) {
  said_at_.reset();
  if (time_s > said_until_s_ || said_.empty()) return;
  const float s = gui_.scale();
  const float edge = 5 * s;
  said_wide_ = std::max(static_cast<float>(area.width_px) - 24 * s, 40 * s);
  const ImVec2 size = gui_.text()->CalcTextSizeA(gui_.text()->FontSize, 1e9f, said_wide_, said_.c_str());
  ImVec2 p{static_cast<float>(area.x_px) + 12 * s, static_cast<float>(area.y_px) + 44 * s};
  const float lowest = static_cast<float>(area.y_px + area.height_px) - size.y - edge;
  const auto high = [&] { return ImVec2{p.x + size.x + edge, p.y + size.y + edge}; };
  while (p.y < lowest && !gui_.words().is_free({p.x - edge, p.y - edge}, high())) p.y += 4 * s;
  gui_.words().take({p.x - edge, p.y - edge}, high());
  said_at_ = p;
}

void Viewer::draw_text() const {
  if (!said_at_) return;
  const ImVec2 p = *said_at_;
  const float edge = 5 * gui_.scale();
  const ImFont* const font = gui_.text();
  const ImVec2 size = font->CalcTextSizeA(font->FontSize, 1e9f, said_wide_, said_.c_str());
  ImDrawList* const list = ImGui::GetForegroundDrawList();
  list->AddRectFilled({p.x - edge, p.y - edge}, {p.x + size.x + edge, p.y + size.y + edge},
                      ink(palette::kRaised), edge);
  list->AddText(font, font->FontSize, p, ink(palette::kText), said_.c_str(), nullptr, said_wide_);
}

}  // namespace telenano::viewer
