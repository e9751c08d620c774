#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <thread>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/config/print.h"
#include "telenano/master/app/failure_text.h"
#include "telenano/master/app/recordings/free_recording.h"
#include "telenano/master/app/run/scene_session.h"

namespace telenano::app {
namespace {

constexpr const char* kRecordingInWindow = "session.h5";  // of one that begins there

constexpr std::chrono::milliseconds kLineAgain(200);
constexpr std::chrono::milliseconds kLineAgainInLog(2000);

}  // namespace

/// A person at the window wants one from now on. Its file.
std::string SceneSession::record_from_now() {
  if (recorder_ != nullptr) return recorded_;
  RunOptions from_now = options_;
  from_now.record = free_recording(kRecordingInWindow);
  recorder_ = new_recorder(from_now);
  recorded_ = from_now.record;
  live_->record_from_now(*recorder_);
  return recorded_;
}

void SceneSession::run_loop_thread(const std::stop_token& end) {
  awake_.reset();
  live_->run();
  if (live_->ending() != Ending::kOtherScene) return;
  // The session goes on: until another thread tends it, which may take a picture or two, this one does.
  connection::ServerLink& way = parts_.way;
  const rt::SteadyClock clock;
  loop::SessionTender tender(session(), way.datagram(), parts_.server, parts_.scene.pipe(), clock,
                             config().rate_hz);
  while (!end.stop_requested()) {
    tender.turn();
    way.wait_readable(1'000'000);
  }
}

/// Every now and then while the loop runs: what has changed is told.
void SceneSession::look(const DeviceMonitor& monitor) {
  if (parts_.stop.load() && monitor.stuck_ns() > kGiveUpStuckNs) {
    if (recorder_) recorder_->close();
    end_without_loop(opened().calls);
  }
  const Progress progress = live_->progress();
  if (!options_.quiet) print_changes(told_, progress, terminal_);
  told_ = progress;
  const auto now = std::chrono::steady_clock::now();
  if (options_.quiet || now - shown_ < (terminal_ ? kLineAgain : kLineAgainInLog)) return;
  shown_ = now;
  print_progress(progress, session_s_, terminal_);
}

/// Until the loop is over, and the window closed that stayed after it. What the picture says of its frames.
std::string SceneSession::watch(rt::RealtimeThread& thread) {
  const DeviceMonitor monitor({[this] { return live_->finished() ? 0 : live_->ticks(); },
                               [this] { return live_->progress().force_off; }, opened().calls},
                              [this](const std::string& text) {
                                config::print(stderr, "{}telenano-master: warning: {}\n",
                                              terminal_ && !options_.quiet ? "\n" : "", text);
                              });
  shown_ = std::chrono::steady_clock::now();
  std::string frames;
  SessionView& view = parts_.view;
  if (view.wanted()) {
    frames = view.run(
        *live_, !thread.report().fifo,
        {[&] { look(monitor); }, [this] { return session_end(); }, [this] { return parts_.stop.load(); },
         [this] { return live_->finished() && live_->ending() == Ending::kOtherScene; },
         [this]() -> const recording::Recorder* { return recorder_.get(); },
         [this] { return record_from_now(); }});
    if (view.again_wanted()) parts_.next->ask(parts_.scene_before.empty() ? "" : slave_.scene_name);
  }
  while (!live_->finished()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    look(monitor);
  }
  thread.request_stop();
  thread.join();
  return frames;
}

std::string SceneSession::run_loop() {
  rt::RealtimeConfig realtime;
  realtime.priority = options_.realtime_priority;
  realtime.cpu = options_.realtime_cpu;
  realtime.hold_cpu_awake = options_.cpu_awake;
  std::optional<rt::RealtimeThread> thread;
  parts_.starter.call(
      [&] { thread.emplace(realtime, [this](const std::stop_token& end) { run_loop_thread(end); }); });
  if (!options_.quiet) {
    config::print(stderr, "loop: {:g} Hz, {}\n", config().rate_hz, thread->report().text);
    if (!thread->report().advice.empty()) config::print(stderr, "{}\n", thread->report().advice);
  }
  return watch(*thread);
}

/// Why the session has failed; empty: it has not.
std::string SceneSession::failure() {
  return failure_text(*live_, *parts_.station, session(), options_, parts_.way, config().rate_hz);
}

/// What follows the loop's end.
void SceneSession::conclude() {
  if (std::exchange(concluded_, true)) return;
  if (terminal_ && !options_.quiet) config::print(stderr, "\n");
  if (recorder_) recorder_->close();
  if (live_->undo_text() != nullptr) config::print(stdout, "{}\n", live_->undo_text());
  if (!parts_.scene_before.empty() || live_->ending() == Ending::kOtherScene)
    config::print(stderr, "sample '{}'\n", slave_.scene_name);
  print_summary(live_->summary(), live_->timer_stats(), recorder_.get(), recorded_);
  print_sending(live_->progress());
}

/// A window does not vanish under a person's eyes because the server did, or because the task is done. A run
/// that was told how long it takes, or whose window nobody opened at a terminal, is nobody's to close.
view_model::SessionEnd SceneSession::session_end() {
  if (live_->ending() == Ending::kOtherScene) return {};
  const std::string why = failure();
  const bool person = isatty(STDIN_FILENO) != 0 && live_->ending() != Ending::kStopped;
  if (options_.close_at_end || options_.duration_s || parts_.stop.load() || (why.empty() && !person))
    return {};
  conclude();
  if (!why.empty()) config::print(stderr, "telenano-master: {}; the window stays until you close it\n", why);
  std::vector<std::string> lines = end_lines(why, live_->summary());
  if (recorder_) lines.push_back(fmt::format("recording {}: {} rows", recorded_, recorder_->rows_written()));
  return {!why.empty(), lines};
}

std::optional<int> SceneSession::run() {
  parts_.farewell->leave_to_loop();
  const std::string frames = run_loop();
  // A recording is closed meanwhile, and a summary told.
  if (live_->ending() == Ending::kOtherScene)
    parts_.starter.call([&] {
      parts_.awake.emplace(session(), parts_.way, parts_.server, parts_.scene.pipe(), config().rate_hz);
    });
  conclude();
  if (!frames.empty() && !options_.quiet) config::print(stderr, "{}\n", frames);
  if (live_->ending() == Ending::kOtherScene) {
    parts_.scene_before = slave_.scene_name;
    parts_.record = free_recording(recorded_);
    return std::nullopt;
  }
  if (live_->ending() == Ending::kStopped) config::print(stderr, "stopped by the operator\n");
  if (const std::string why = failure(); !why.empty()) throw RunError(why);
  if (recorder_ && recorder_->failed()) return 1;
  return 0;
}

}  // namespace telenano::app
