#include "telenano/master/viewer/control_panel.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "telenano/master/station/station.h"
#include "telenano/master/view_model/session_banner.h"
#include "telenano/master/view_model/status_text.h"
#include "telenano/master/viewer/limited_slider.h"
#include "telenano/master/viewer/playback_bar.h"

namespace telenano::viewer {
namespace {

using control::Method;
using view_model::Mood;
using view_model::ViewRequest;

constexpr float kNumbersWide = 260;  // at which the numbers have words of full size
constexpr float kPracticeSliderMost_ms = 500;
constexpr float kPracticeSliderMostPercent = 20;

palette::Rgb colour_of(Mood mood) {
  return mood == Mood::kAlarm     ? palette::kAlarm
         : mood == Mood::kWarning ? palette::kWarning
         : mood == Mood::kGood    ? palette::kGood
                                  : palette::kQuiet;
}

const char* about(Method method) {
  switch (method) {
    case Method::kNone:
      return "no control: swings when too stiff";
    case Method::kKs:
      return "Kim & Sitti, as published";
    case Method::kKsClamp:
      return "that, with a bound on energy";
    case Method::kTdpa:
      return "two ports, energies over the link";
    case Method::kWave:
      return "wave variables";
    case Method::kTank:
      return "two layers, energy tank";
    case Method::kModel:
      return "local model of the contact";
    case Method::kTwin:
      return "the server's slave at the station (run --scene)";
  }
  return "";
}

float wide_of(const std::string& text) {
  return ImGui::CalcTextSize(text.c_str()).x;
}

// What has no room beside its name goes on at its comma, and a piece that is still too wide at a blank: no
// number is cut at the panel's edge.
void row(const char* name, std::string value, const palette::Rgb& colour = palette::kText) {
  ImGui::TableNextRow();
  ImGui::TableNextColumn();
  ImGui::TextColored(vec4(palette::kQuiet), "%s", name);
  ImGui::TableNextColumn();
  const float room = ImGui::GetContentRegionAvail().x;
  if (const auto comma = value.find(", "); wide_of(value) > room && comma != std::string::npos)
    value.replace(comma, 2, ",\n");
  ImGui::PushStyleColor(ImGuiCol_Text, vec4(colour));
  ImGui::TextWrapped("%s", value.c_str());
  ImGui::PopStyleColor();
}

bool stopped(const recording::Sample& now) {
  return static_cast<station::Mode>(now.station_mode) == station::Mode::kStopped;
}

control::Scaling scaling_of(const recording::Sample& now) {
  return {now.velocity_scale, now.force_scale};
}

}  // namespace

void ControlPanel::ask(ViewRequest::Kind kind) {
  if (playback_ != nullptr || ended_) return;
  ViewRequest request;
  request.kind = kind;
  port_.requests.push(request);
}

void ControlPanel::stop() noexcept {
  if (playback_ == nullptr && !ended_) port_.stops.fetch_add(1, std::memory_order_relaxed);
}

void ControlPanel::quit() noexcept {
  if (playback_ == nullptr && !ended_) port_.quit.store(true, std::memory_order_relaxed);
}

std::string ControlPanel::ask_undo(const recording::Sample& now) {
  if (playback_ != nullptr || ended_) return "";
  if (!facts_.can_undo)
    return "No marks to undo: this sample keeps none, or its server cannot take them back";
  if ((now.limit_flags & recording::kLimitObserves) != 0) return "Only who moves the tip can undo its marks";
  if ((now.fault_bits & link::kFaultRetracted) != 0)
    return "Marks not undone: the tip is withdrawn, continue first";
  const auto contact = static_cast<link::ContactState>(now.contact_state);
  if (contact == link::ContactState::kContact || contact == link::ContactState::kNonContact)
    return "Marks not undone: lift the tip off the sample first";
  ask(ViewRequest::Kind::kUndo);
  return "";
}

void ControlPanel::ask_method(Method method, const recording::Sample& now) {
  if (playback_ != nullptr || ended_) return;
  if (!method_offered(method) || method == static_cast<Method>(now.method)) return;
  ViewRequest request;
  const control::Scaling safe = facts_.region.clamped(method, scaling_of(now));
  if (safe.force < now.force_scale) {
    request.kind = ViewRequest::Kind::kScaling;
    request.scaling = safe;
    port_.requests.push(request);
  }
  request.kind = ViewRequest::Kind::kMethod;
  request.method = method;
  port_.requests.push(request);
}

void ControlPanel::ask_scaling(double velocity_times, double force_times, const recording::Sample& now) {
  if (playback_ != nullptr || ended_) return;
  const view_model::ScalingRegion& region = facts_.region;
  ViewRequest request;
  request.kind = ViewRequest::Kind::kScaling;
  request.scaling = region.clamped(
      static_cast<Method>(now.method),
      {std::clamp(velocity_times * now.velocity_scale, region.velocity_min, region.velocity_max),
       std::clamp(force_times * now.force_scale, region.force_min, region.force_top())});
  port_.requests.push(request);
}

bool ControlPanel::task_fits(int task, const recording::Sample& now) const noexcept {
  if (!(now.velocity_scale > 0)) return false;
  const Vec3 reach_m = facts_.tasks[static_cast<std::size_t>(task)].reach_nm * (1e-9 / now.velocity_scale);
  return (reach_m.array() <= facts_.hand_box_half_m.array()).all();
}

void ControlPanel::ask_task(int task, const recording::Sample& now) {
  if (playback_ != nullptr || ended_) return;
  if (task < 0 || task >= static_cast<int>(facts_.tasks.size()) || !task_fits(task, now)) return;
  ViewRequest request;
  request.kind = ViewRequest::Kind::kTask;
  request.task = task;
  port_.requests.push(request);
}

bool ControlPanel::mouse_leads() const noexcept {
  if (facts_.mouse_is_hand) return true;
  const auto task = static_cast<std::size_t>(port_.task.load().task);
  return task < facts_.tasks.size() && facts_.tasks[task].free;
}

void ControlPanel::draw_stop(const Gui& gui, const recording::Sample& now, float high) {
  const float wide = ImGui::GetContentRegionAvail().x;
  ImGui::PushFont(gui.large());
  if (ended_) {
    ImGui::PushStyleColor(ImGuiCol_Button, vec4(palette::kRaised));
    ImGui::PushStyleColor(ImGuiCol_Text, vec4(palette::kText));
    if (ImGui::Button("Close  (Ctrl+Q)", {wide, high})) close_wanted_ = true;
  } else if (stopped(now)) {
    ImGui::PushStyleColor(ImGuiCol_Button, vec4(palette::kRaised));
    ImGui::PushStyleColor(ImGuiCol_Text, vec4(palette::kWarning));
    if (ImGui::Button("Clear the stop  (R)", {wide, high})) ask(ViewRequest::Kind::kClearStop);
  } else {
    ImGui::PushStyleColor(ImGuiCol_Button, vec4(palette::kAlarm));
    ImGui::PushStyleColor(ImGuiCol_Text, ImVec4(1, 1, 1, 1));
    ImGui::PushStyleColor(ImGuiCol_ButtonHovered, {1.0f, 0.4f, 0.4f, 1});
    ImGui::PushStyleColor(ImGuiCol_ButtonActive, {0.7f, 0.15f, 0.15f, 1});
    if (ImGui::Button("STOP  (Esc)", {wide, high})) stop();
    ImGui::PopStyleColor(2);
  }
  ImGui::PopStyleColor(2);
  ImGui::PopFont();
}

void ControlPanel::draw_messages(const Gui& gui, const recording::Sample& now, float lines) {
  view_model::SessionInputs inputs{now};
  inputs.give_up_s = facts_.give_up_s;
  inputs.played = playback_ != nullptr;
  inputs.twin = port_.twin.load();
  inputs.device_cause = port_.force_off.load();
  inputs.mouse_leads = playback_ == nullptr && mouse_leads();
  auto messages = view_model::session_banner(inputs).lines;
  for (auto& message : view_model::slave_text(now.fault_bits)) messages.push_back(std::move(message));
  // After the line of a silence, which is the gravest.
  if (reach_nm_ > 0)
    messages.insert(messages.begin() + (view_model::silent_s(now) > 0 ? 1 : 0),
                    {view_model::reach_text(reach_nm_, mouse_leads()), Mood::kWarning});
  if (ended_) messages = {{"The session has ended: this is its last moment", Mood::kAlarm}};
  if (messages.empty() && !facts_.shows_force)
    messages.push_back({"This hand has no motors: see the force at the tip", Mood::kCalm});
  if (messages.empty() && playback_ == nullptr)
    messages.push_back({"All is well: the force is shown as planned", Mood::kGood});
  // Always the same height, so that nothing under it jumps. What is too long for it has small words, and what does not fit
  // all the same can be scrolled to.
  const float high = lines * ImGui::GetTextLineHeightWithSpacing();
  const float wide = ImGui::GetContentRegionAvail().x;
  float needed = -ImGui::GetStyle().ItemSpacing.y;
  for (const auto& message : messages)
    needed +=
        ImGui::CalcTextSize(message.text.c_str(), nullptr, false, wide).y + ImGui::GetStyle().ItemSpacing.y;
  // Half of the space under it is for what hangs below the last line.
  const float spacing = ImGui::GetStyle().ItemSpacing.y;
  const float next_y = ImGui::GetCursorPosY() + high + spacing;
  ImGui::BeginChild("messages", {0, high + 0.5f * spacing});
  ImGui::PushFont(needed > high ? gui.small() : gui.text());
  for (const auto& message : messages) {
    ImGui::PushStyleColor(ImGuiCol_Text, vec4(colour_of(message.mood)));
    ImGui::TextWrapped("%s", message.text.c_str());
    ImGui::PopStyleColor();
  }
  ImGui::PopFont();
  ImGui::EndChild();
  ImGui::SetCursorPosY(next_y);
}

void ControlPanel::draw_task(const recording::Sample& now) {
  if (facts_.tasks.empty()) return;
  const device::TaskState state = port_.task.load();
  const auto current = static_cast<std::size_t>(state.task);
  ImGui::TextColored(vec4(palette::kQuiet), "Task   ");
  ImGui::SameLine();
  ImGui::SetNextItemWidth(-1);
  std::string shown = current < facts_.tasks.size() ? facts_.tasks[current].name : "";
  if (state.changing) {
    shown += ": going to its start";
  } else if (std::isfinite(state.duration_s)) {
    shown += state.time_s < state.duration_s
                 ? fmt::format("  {:.1f} of {:.0f} s", state.time_s, state.duration_s)
                 : ": done";
  }
  // What is chosen while stopped or held would be refused.
  const auto mode = static_cast<station::Mode>(now.station_mode);
  const bool can = mode == station::Mode::kEngaged || mode == station::Mode::kReady;
  if (!ImGui::BeginCombo("##task", shown.c_str())) return;
  for (int i = 0; i < static_cast<int>(facts_.tasks.size()); ++i) {
    const TaskOffer& task = facts_.tasks[static_cast<std::size_t>(i)];
    const bool fits = task_fits(i, now);
    const std::string label = fmt::format("{}: {}", task.name,
                                          !can    ? "clear the stop first"
                                          : !fits ? "too large for the hand at this scale"
                                                  : task.about);
    if (ImGui::Selectable(label.c_str(), i == state.task,
                          can && fits ? ImGuiSelectableFlags_None : ImGuiSelectableFlags_Disabled))
      ask_task(i, now);
  }
  ImGui::EndCombo();
}

void ControlPanel::draw_method(const recording::Sample& now) {
  const auto current = static_cast<Method>(now.method);
  ImGui::TextColored(vec4(palette::kQuiet), "Method");
  ImGui::SameLine();
  ImGui::SetNextItemWidth(-1);
  const std::string name =
      view_model::method_text(current, playback_ == nullptr && port_.method_by_link.load());
  if (ImGui::BeginCombo("##method", name.c_str())) {
    int number = 1;
    for (const Method method : control::kAllMethods) {
      const std::string label =
          fmt::format("{}  {}: {}", number++, control::method_name(method), about(method));
      const bool offered = method_offered(method);
      if (ImGui::Selectable(label.c_str(), method == current,
                            offered ? ImGuiSelectableFlags_None : ImGuiSelectableFlags_Disabled))
        ask_method(method, now);
    }
    ImGui::EndCombo();
  }
}

void ControlPanel::draw_played(const Gui& gui, const recording::Sample& now) {
  const std::string scaling =
      fmt::format("{} = {:.3g}   {} = {:.3g}", gui.has_greek() ? "α_v" : "alpha_v", now.velocity_scale,
                  gui.has_greek() ? "α_F" : "alpha_F", now.force_scale);
  ImGui::TextColored(vec4(palette::kQuiet), "Method");
  ImGui::SameLine();
  ImGui::TextUnformatted(std::string(control::method_name(static_cast<Method>(now.method))).c_str());
  ImGui::TextUnformatted(scaling.c_str());
}

void ControlPanel::draw_region(const Gui& gui, Method method, const control::Scaling& shown, ImVec2 size) {
  const view_model::ScalingRegion& region = facts_.region;
  const float s = gui.scale();
  const float wide = size.x;
  const float high = size.y;
  const ImVec2 from = ImGui::GetCursorScreenPos();
  const ImVec2 to{from.x + wide, from.y + high};
  ImGui::Dummy({wide, high});
  ImDrawList* const list = ImGui::GetWindowDrawList();
  list->AddRectFilled(from, to, ink(palette::kBackground), 4 * s);
  const double force_max = region.force_top();
  const auto x_of = [&](double v) {
    return from.x +
           static_cast<float>(view_model::slider_of(v, region.velocity_min, region.velocity_max)) * wide;
  };
  const auto y_of = [&](double f) {
    return to.y - static_cast<float>(view_model::slider_of(f, region.force_min, force_max)) * high;
  };
  // The border is a hyperbola, a straight line between logarithms; the safe side is under it.
  list->PushClipRect(from, to, true);
  const double bound = std::max(region.bound(method), 0.0);
  constexpr int kParts = 48;
  ImVec2 before{};
  for (int i = 0; i <= kParts; ++i) {
    const double v =
        view_model::value_of(static_cast<double>(i) / kParts, region.velocity_min, region.velocity_max);
    const ImVec2 here{x_of(v), y_of(bound / v)};
    if (i > 0) {
      list->AddQuadFilled({before.x, before.y}, here, {here.x, to.y}, {before.x, to.y},
                          ink(palette::kGood, 0.16f));
      list->AddLine(before, here, ink(palette::kGood), 1.5f * s);
    }
    before = here;
  }
  const float y_device = y_of(region.device_force_scale);
  for (float x = from.x; x < to.x; x += 8 * s)
    list->AddLine({x, y_device}, {x + 4 * s, y_device}, ink(palette::kWarning, 0.9f), s);
  const ImVec2 p{x_of(shown.velocity), y_of(shown.force)};
  const bool safe = shown.impedance() <= bound;
  list->AddCircleFilled(p, 5 * s, ink(safe ? palette::kText : palette::kAlarm));
  list->PopClipRect();
  const auto write = [&](ImVec2 at, const char* text, const palette::Rgb& colour) {
    const ImVec2 ink_size = gui.small()->CalcTextSizeA(gui.small()->FontSize, 1e9f, 0, text);
    if (at.x < from.x || !gui.words().take_if_free(at, {at.x + ink_size.x, at.y + ink_size.y})) return;
    list->AddText(gui.small(), gui.small()->FontSize, at, ink(colour), text);
  };
  write({from.x + 6 * s, to.y - 17 * s}, "passive", palette::kGood);
  const char* const across = gui.has_greek() ? "α_v →" : "alpha_v >";
  const float across_wide = gui.small()->CalcTextSizeA(gui.small()->FontSize, 1e9f, 0, across).x;
  write({to.x - across_wide - 6 * s, to.y - 17 * s}, across, palette::kQuiet);
  write({from.x + 6 * s, from.y + 3 * s}, gui.has_greek() ? "α_F ↑" : "alpha_F ^", palette::kQuiet);
  const float label_y = y_device - 14 * s > from.y ? y_device - 14 * s : y_device + 2 * s;
  const char* const saturates = "device saturates above";
  const float label_wide = gui.small()->CalcTextSizeA(gui.small()->FontSize, 1e9f, 0, saturates).x;
  if (high > 80 * s && y_device > from.y && y_device < to.y)
    write({to.x - label_wide - 6 * s, label_y}, saturates, palette::kWarning);
}

void ControlPanel::draw_scaling(const Gui& gui, const recording::Sample& now, float region_high) {
  const view_model::ScalingRegion& region = facts_.region;
  const auto method = static_cast<Method>(now.method);
  control::Scaling shown = dragged_.value_or(scaling_of(now));
  const float wide = ImGui::GetContentRegionAvail().x;
  SliderState velocity;
  velocity.value = shown.velocity;
  velocity.least = region.velocity_min;
  velocity.greatest = region.velocity_max;
  SliderState force;
  force.value = shown.force;
  force.least = region.force_min;
  force.greatest = region.force_top();
  force.limit = std::max(region.bound(method), 0.0) / shown.velocity;
  const double nm_per_mm = shown.velocity * 1e6;
  const double newton_per_nn = shown.force * 1e-9;
  const std::string velocity_text = fmt::format(
      "{} = {:.3g},  1 mm is {:.3g} nm", gui.has_greek() ? "α_v" : "alpha_v", shown.velocity, nm_per_mm);
  const std::string force_text = fmt::format("{} = {:.3g},  1 nN is {:.3g} N",
                                             gui.has_greek() ? "α_F" : "alpha_F", shown.force, newton_per_nn);
  limited_slider(gui, "velocity", velocity_text.c_str(), wide, velocity);
  limited_slider(gui, "force", force_text.c_str(), wide, force);
  if (velocity.changed) dragged_ = region.clamped(method, {velocity.value, shown.force});
  if (force.changed) dragged_ = region.clamped(method, {shown.velocity, force.value});
  if ((velocity.let_go || force.let_go) && dragged_) {
    ViewRequest request;
    request.kind = ViewRequest::Kind::kScaling;
    request.scaling = *dragged_;
    port_.requests.push(request);
    dragged_.reset();
  }
  draw_region(gui, method, shown, {wide, region_high});
}

void ControlPanel::draw_tip_rows(const view_model::LiveSession& live) const {
  const recording::Sample& now = live.now();
  const auto& tip = now.tip_pos_w_nm;
  row("tip x y z", fmt::format("{:.1f} {:.1f} {:.2f} nm", tip[0], tip[1], tip[2]));
  row("gap",
      fmt::format("{}, {}", view_model::length_text(live.gap_nm()),
                  view_model::contact_text(now.contact_state)),
      live.contact() ? palette::kRepulsion : palette::kText);
  const Vec3 force(now.force_w_nn[0], now.force_w_nn[1], now.force_w_nn[2]);
  const palette::Rgb& force_colour = force.z() >= 0 ? palette::kRepulsion : palette::kAttraction;
  row("tip force", view_model::force_size_text(force), force_colour);
  row("x y z, nN", view_model::force_parts_text(force, false), force_colour);
  row("lever", fmt::format("bent {}", view_model::length_text(now.deflection_nm)));
  if (playback_ != nullptr) return;  // recordings do not hold it
  const view_model::ShownContact contact = port_.contact.load();
  // The twin of one who looks on touches nothing, whatever the tip does.
  row("contact", view_model::observes(now) ? "not known here" : view_model::contact_area_text(contact));
  row("adhesion", view_model::adhesion_text(contact));
}

void ControlPanel::draw_numbers(const Gui& gui, const view_model::LiveSession& live) const {
  // Small words in a narrow panel.
  const bool narrow = ImGui::GetContentRegionAvail().x < kNumbersWide * gui.scale();
  ImGui::PushFont(narrow ? gui.small() : gui.text());
  draw_number_rows(live);
  ImGui::PopFont();
}

void ControlPanel::draw_number_rows(const view_model::LiveSession& live) const {
  const recording::Sample& now = live.now();
  if (!ImGui::BeginTable("numbers", 2, ImGuiTableFlags_SizingFixedFit)) return;
  ImGui::TableSetupColumn("name", ImGuiTableColumnFlags_WidthFixed, wide_of("hand force "));
  ImGui::TableSetupColumn("value", ImGuiTableColumnFlags_WidthStretch);
  if (now.reply_sequence == 0) {  // nothing is known of the tip yet, which is not zero
    for (const char* const name : {"tip x y z", "gap", "tip force", "x y z, nN", "lever"}) row(name, "–");
    if (playback_ == nullptr)
      for (const char* const name : {"contact", "adhesion"}) row(name, "–");
  } else {
    draw_tip_rows(live);
  }
  row("hand force",
      facts_.shows_force
          ? fmt::format("{:+.2f} of {:.1f} N", now.hand_force_applied_h_n[2], facts_.hand_force_limit_n)
          : fmt::format("not shown ({:+.2f} N)", now.hand_force_commanded_h_n[2]));
  row("energy", fmt::format("{:+.2f} mJ put in", 1e3 * now.energy_j));
  row("link", fmt::format("RTT {}, lost {}", view_model::time_text(now.rtt_us), now.lost));
  row("jitter", fmt::format("{}, force {} old", view_model::time_text(now.jitter_us),
                            view_model::time_text(1e3 * now.force_age_ms)));
  row("loop late", fmt::format("{}, {} overruns", view_model::time_text(now.lateness_us), now.overruns));
  ImGui::EndTable();
}

std::string ControlPanel::practice_text() const {
  return practice_ && practice_->any() ? "practice link: " + link::practice_text(*practice_) : "";
}

// The link changes once, when the slider is released: a delay that followed every pixel would reorder what
// is sent.
void ControlPanel::draw_practice() {
  if (!practice_) return;
  const link::PracticeLink shown = practice_dragged_.value_or(*practice_);
  auto rtt_ms = static_cast<float>(shown.rtt_ms);
  auto percent = static_cast<float>(100 * shown.loss);
  bool held = false;
  bool released = false;
  const auto slider = [&](const char* label, float* value, float most, const char* form) {
    ImGui::SetNextItemWidth(0.5f * ImGui::GetContentRegionAvail().x);
    ImGui::SliderFloat(label, value, 0, most, form, ImGuiSliderFlags_AlwaysClamp);
    held |= ImGui::IsItemActive();
    released |= ImGui::IsItemDeactivatedAfterEdit();
  };
  slider("round trip", &rtt_ms, kPracticeSliderMost_ms, "+%.0f ms");
  slider("lost", &percent, kPracticeSliderMostPercent, "%.0f %%");
  link::PracticeLink wish = shown;  // the jitter is the flag's
  wish.rtt_ms = rtt_ms;
  wish.loss = 0.01 * percent;
  practice_dragged_.reset();
  if (held) practice_dragged_ = wish;
  if (!released || ended_) return;
  ViewRequest request;
  request.kind = ViewRequest::Kind::kPractice;
  request.practice = wish;
  if (port_.requests.push(request)) practice_ = wish;
}

/// Other samples of the server, to which the session can go.
void ControlPanel::draw_scenes() {
  ImGui::SetNextItemWidth(-1);
  if (!ImGui::BeginCombo("##sample", ("Sample: " + facts_.scene_name).c_str())) return;
  ImGui::TextColored(vec4(palette::kQuiet), "lets go of the tip, and goes on at");
  for (std::size_t i = 0; i < facts_.scenes.size(); ++i) {
    if (facts_.scenes[i] == facts_.scene_name || !ImGui::Selectable(facts_.scenes[i].c_str())) continue;
    ViewRequest request;
    request.kind = ViewRequest::Kind::kScene;
    request.scene = static_cast<int>(i);
    port_.requests.push(request);
  }
  ImGui::EndCombo();
}

void ControlPanel::draw_foot(const Gui& gui, const view_model::LiveSession& live,
                             const RecordingStatus& recording) {
  const float s = gui.scale();
  if (!facts_.played.empty()) {
    ImGui::TextWrapped("%s", facts_.played.c_str());
  } else if (!facts_.recording.empty()) {
    const ImVec2 p = ImGui::GetCursorScreenPos();
    const bool bright = std::fmod(live.now().time_s, 1.0) < 0.7;
    ImGui::GetWindowDrawList()->AddCircleFilled({p.x + 6 * s, p.y + 9 * s}, 5 * s,
                                                ink(palette::kAlarm, bright ? 1.0f : 0.35f));
    ImGui::Dummy({14 * s, 0});
    ImGui::SameLine();
    ImGui::TextColored(vec4(recording.failed ? palette::kAlarm : palette::kText), "%s",
                       recording.failed ? "recording has failed"
                                        : fmt::format("recording: {} rows", recording.rows).c_str());
    if (recording.failed && !recording.failure.empty()) ImGui::TextWrapped("%s", recording.failure.c_str());
  } else if (facts_.can_record && !ended_) {
    if (ImGui::Button("Record  (Ctrl+R)", {-1, 0})) want_recording();
  } else {
    ImGui::TextColored(vec4(palette::kQuiet), "not recording (--record FILE)");
  }
  if (!facts_.scenes.empty() && !ended_ && playback_ == nullptr) draw_scenes();
  if (facts_.can_undo && !ended_ && playback_ == nullptr) {
    if (ImGui::Button("Undo the last marks  (U)", {-1, 0})) undo_wanted_ = true;
  }
  const float half = 0.5f * (ImGui::GetContentRegionAvail().x - ImGui::GetStyle().ItemSpacing.x);
  if (ImGui::Button("Picture (P)", {half, 0})) picture_wanted_ = true;
  ImGui::SameLine();
  if (ImGui::Button("Help (F1)", {half, 0})) help_wanted_ = true;
}

void ControlPanel::draw(const Gui& gui, const view_model::LiveSession& live, const RecordingStatus& recording,
                        const Area& area) {
  ImGui::SetNextWindowPos({static_cast<float>(area.x_px), static_cast<float>(area.y_px)});
  ImGui::SetNextWindowSize({static_cast<float>(area.width_px), static_cast<float>(area.height_px)});
  ImGui::Begin("panel", nullptr,
               ImGuiWindowFlags_NoBackground | ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoScrollWithMouse | ImGuiWindowFlags_NoSavedSettings |
                   ImGuiWindowFlags_NoBringToFrontOnFocus);
  // STOP and the messages stay in sight; what is under them scrolls where the window is low.
  const recording::Sample& now = live.now();
  const float s = gui.scale();
  const float high = static_cast<float>(area.height_px) - (practice_ ? 60 * s : 0) -
                     (facts_.scenes.empty() ? 0 : 28 * s) - (facts_.can_undo ? 28 * s : 0);
  const bool low = high < 720 * s;
  if (playback_ != nullptr) {
    draw_playback(gui, *playback_);
    draw_messages(gui, now, low ? 2.3f : 3.3f);
    ImGui::BeginChild("rest");
    ImGui::Separator();
    draw_played(gui, now);
  } else {
    draw_stop(gui, now, (low ? 40 : 54) * s);
    draw_messages(gui, now, low ? 2.3f : 3.3f);
    ImGui::BeginChild("rest");
    ImGui::Checkbox("Clutch: the tip stands (C)", &clutch_);
    ImGui::Separator();
    draw_task(now);
    draw_method(now);
    draw_scaling(gui, now, low ? 58 * s : std::clamp(104 * s + 0.8f * (high - 720 * s), 104 * s, 190 * s));
  }
  ImGui::Separator();
  draw_numbers(gui, live);
  draw_practice();
  ImGui::Separator();
  draw_foot(gui, live, recording);
  ImGui::EndChild();
  ImGui::End();
}

}  // namespace telenano::viewer
