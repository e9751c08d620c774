#include "telenano/master/app/start/start_command.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/master/app/devices/device_kinds.h"
#include "telenano/master/app/devices/found_devices.h"
#include "telenano/master/app/recordings/free_recording.h"
#include "telenano/master/app/start/file_faults.h"
#include "telenano/master/app/start/own_program.h"
#include "telenano/master/app/start/recent_servers.h"
#include "telenano/master/app/start/start_flags.h"
#include "telenano/master/app/stop_signals.h"
#include "telenano/master/connection/server_link.h"
#include "telenano/master/viewer/start_window.h"
#include "telenano/master/viewer/window_glfw.h"

namespace telenano::app {
namespace {

constexpr std::size_t kLastLines = 9;

std::vector<viewer::OfferedHand> offered_hands() {
  std::vector<viewer::OfferedHand> hands{
      {device_name(DeviceKind::kMouse), "mouse, in the pictures of the window", "", false}};
  for (const device::FoundDevice& one : find_devices()) {
    // A backend without any device has no name.
    hands.push_back({one.backend, one.name.empty() ? one.backend : one.name, one.usable ? "" : one.why,
                     device_row(parse_device_spec(one.backend).kind).shows_force});
  }
  return hands;
}

/// What the fields themselves and the files that they name show.
view_model::StartFaults field_faults(const view_model::StartChoice& choice) {
  view_model::StartFaults faults = view_model::start_faults(choice);
  if (faults.key.empty() && !choice.key.empty()) faults.key = read_fault(choice.key);
  if (faults.identity.empty() && !choice.identity.empty()) faults.identity = read_fault(choice.identity);
  if (faults.recording.empty() && choice.record) faults.recording = recording_fault(choice.recording);
  return faults;
}

/// Looks at the files again when a name has changed, and now and then: one may be made meanwhile.
class FieldLook {
 public:
  const view_model::StartFaults& faults(const view_model::StartChoice& choice) {
    constexpr auto kAgain = std::chrono::seconds(1);
    const auto now = std::chrono::steady_clock::now();
    std::vector<std::string> fields = view_model::run_arguments(choice);
    if (fields != seen_ || now >= next_) {
      seen_ = std::move(fields);
      next_ = now + kAgain;
      faults_ = field_faults(choice);
    }
    return faults_;
  }

 private:
  std::vector<std::string> seen_;
  std::chrono::steady_clock::time_point next_;
  view_model::StartFaults faults_;
};

/// What a program that still runs has noted last; empty: nothing.
std::string newest_note(const std::string& err) {
  constexpr std::string_view kNote = "note: ";
  const auto lines = last_lines(err, 1);
  return lines.empty() || !lines.back().starts_with(kNote) ? "" : lines.back().substr(kNote.size());
}

/// Asks a server in a process of its own: this window never waits for it.
class Question {
 public:
  void ask(const view_model::StartChoice& choice, viewer::StartFacts& facts) {
    program_.reset();
    facts.plan.reset();
    facts.trouble.clear();
    facts.looking_at.clear();
    answered_faults_ = {};
    asked_ = choice;
    // What is wrong with a field is said there. The recording is no matter of the server's.
    view_model::StartFaults faults = field_faults(choice);
    faults.recording.clear();
    facts.looking = faults.first().empty();
    if (!facts.looking) return;
    try {
      program_.emplace(view_model::plan_arguments(choice), false);
    } catch (const RunError& error) {
      facts.looking = false;
      facts.trouble = error.what();
    }
  }
  /// True when a server has answered just now.
  bool poll(viewer::StartFacts& facts) {
    if (!program_) return false;
    const bool ended = program_->ended();
    facts.looking_at = ended ? "" : newest_note(program_->err());
    if (!ended) return false;
    facts.looking = false;
    const bool answered = program_->exit_code() == 0;
    if (answered) {
      facts.plan = view_model::parse_plan(program_->out());
    } else {
      const auto lines = last_lines(program_->err(), 1);
      if (lines.empty() || !view_model::take_flag_fault(lines.back(), asked_, answered_faults_))
        facts.trouble = lines.empty() ? "the server could not be asked" : lines.back();
    }
    program_.reset();
    return answered;
  }
  const view_model::StartChoice& asked() const noexcept { return asked_; }
  /// What that answer said of the fields; of a choice that has changed since it says nothing.
  view_model::StartFaults& faults() noexcept { return answered_faults_; }

 private:
  std::optional<OwnProgram> program_;
  view_model::StartFaults answered_faults_;
  view_model::StartChoice asked_;
};

/// One session, to its end, in its own process and window.
void run_session_program(const view_model::StartChoice& choice, const std::atomic<bool>& stop,
                         viewer::StartFacts& facts) {
  try {
    OwnProgram session(view_model::run_arguments(choice), true);
    bool told = false;
    while (!session.ended()) {
      if (stop && !std::exchange(told, true)) session.ask_to_end();
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    facts.last_text = last_lines(session.err(), kLastLines);
    facts.last_failed = session.exit_code() != 0;
    if (facts.last_text.empty())
      facts.last_text.push_back(fmt::format("it ended with code {}", session.exit_code()));
  } catch (const RunError& error) {  // no process could be made: what was chosen stays
    facts.last_text = {error.what()};
    facts.last_failed = true;
  }
}

int start(const StartFlags& flags) {
  connection::ServerAccess access;
  access.key = flags.key;
  access.identity = flags.identity;
  access.server_key = flags.server_key;
  connection::require_credentials(access);
  if (!viewer::has_display()) {
    throw UserError(
        "start: there is no display; log in graphically or with ssh -X, or use telenano-master run --server "
        "HOST:PORT");
  }
  const std::atomic<bool>& stop = catch_stop_signals();
  RecentServers recent(RecentServers::users_folder());
  view_model::StartChoice choice;
  choice.guide = recent.list().empty();  // nobody has been here before
  if (!recent.list().empty()) {
    const RecentServer& last = recent.list().front();
    choice.server = last.server;
    choice.key = last.key;
    choice.identity = last.identity;
    choice.server_key = last.server_key;
  }
  if (!flags.server.empty()) {
    choice.server = flags.server;
    choice.key = flags.key;
    choice.identity = flags.identity;
    choice.server_key = flags.server_key;
  }
  choice.server_scene = flags.server_scene;
  if (!flags.device.empty()) {
    parse_device_spec(flags.device);
    choice.device = flags.device;
  }
  choice.text_size = flags.text_size;
  viewer::StartFacts facts;
  facts.hands = offered_hands();
  Question question;
  FieldLook look;
  const auto list_seen = [&] {
    facts.seen.clear();
    for (const RecentServer& one : recent.list())
      facts.seen.push_back({one.server, one.key, one.scene, one.identity, one.server_key});
  };
  list_seen();
  viewer::StartHooks hooks;
  hooks.look = [&](const view_model::StartChoice& now) { question.ask(now, facts); };
  hooks.each = [&](const view_model::StartChoice& now) {
    if (question.poll(facts)) {
      const view_model::StartChoice& asked = question.asked();
      facts.scenes = facts.plan ? facts.plan->scenes : std::vector<std::string>();
      facts.scenes_of = asked.server;
      recent.note(
          {asked.server, asked.key, facts.plan ? facts.plan->scene : "", asked.identity, asked.server_key});
      list_seen();
    }
    // What was said of another session is not said of this one.
    if (view_model::plan_arguments(now) != view_model::plan_arguments(question.asked()))
      facts.plan.reset(), facts.trouble.clear(), question.faults() = {};
    facts.faults = look.faults(now);
    facts.faults.add(question.faults());
    facts.command_line = view_model::shell_line("telenano-master", view_model::run_arguments(now));
  };
  hooks.stop_wanted = [&] { return stop.load(); };
  // One who has named a server, or used one before, need not ask.
  if (!flags.server.empty() || !recent.list().empty()) question.ask(choice, facts);
  while (!stop) {
    // A folder stays as it was typed: its field says what to do.
    if (std::error_code none; !std::filesystem::is_directory(choice.recording, none))
      choice.recording = free_recording(choice.recording);
    if (!viewer::run_start_window(facts, choice, hooks)) break;
    run_session_program(choice, stop, facts);
    // What the server said before says nothing of one that may be gone.
    if (facts.last_failed && !stop) question.ask(choice, facts);
  }
  return 0;
}

}  // namespace

CLI::App* add_start_command(CLI::App& app, int& exit_code) {
  auto flags = std::make_shared<StartFlags>();
  CLI::App* const command = add_start_flags(app, *flags);
  command->callback([flags, &exit_code] { exit_code = start(*flags); });
  return command;
}

}  // namespace telenano::app
