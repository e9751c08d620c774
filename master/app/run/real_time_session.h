#pragma once

#include <atomic>
#include <cstdint>
#include <utility>
#include <vector>

#include "telenano/common/control/method_choice.h"
#include "telenano/common/control/scaling_follower.h"
#include "telenano/common/link/client_session.h"
#include "telenano/common/recording/recorder.h"
#include "telenano/common/recording/summary_builder.h"
#include "telenano/common/rt/latest_value.h"
#include "telenano/common/rt/periodic_timer.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/master/connection/server_link.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/device/played_motion.h"
#include "telenano/master/loop/station_loop.h"
#include "telenano/master/station/station.h"
#include "telenano/master/view_model/view_request_handler.h"

namespace telenano::app {

/// Why a session ended.
enum class Ending : std::uint8_t {
  kTaskDone,
  kStopped,
  kFault,
  kServerGone,
  kServerEnded,
  kRefused,
  kOtherScene,  ///< the session is at another scene of the server, which the station does not know yet
  kTipUp,       ///< the tip was withdrawn and not on its way back, so that the task could not begin
  kNotEngaged,  ///< replies came, but a played hand stood still for as long as its motion takes
};

/// Codes of events in a recording besides the station's modes, 0 to 5. Stored in files: never renumber.
inline constexpr std::uint32_t kEventSilent = 100;
inline constexpr std::uint32_t kEventSession = 101;  ///< value: the epoch of the slave's energy account
inline constexpr std::uint32_t kEventTip = 102;      ///< of a shared tip; value: 1 = holds it, 0 = observes
inline constexpr std::uint32_t kEventMark = 103;     ///< a person's; value: its number, from 1
inline constexpr std::uint32_t kEventTask = 104;     ///< another was chosen; value: its place in the list
inline constexpr std::uint32_t kEventMethod = 105;   ///< changed by the rule; value: control::Method
inline constexpr std::uint32_t kEventTwin =
    106;  ///< is apart from the server, or again the same; value: partings

inline constexpr std::uint32_t kEventSendRate =
    107;  ///< value: datagrams a second from here on; the text says why
// 108 was the next server of a list, in earlier recordings.
inline constexpr std::uint32_t kEventNote =
    109;  ///< a person's words, of the moment when writing began: "note: …"
inline constexpr std::uint32_t kEventPractice =
    110;  ///< another practice link; value: ms added to the round trip

inline constexpr std::uint32_t kEventScale =
    111;  ///< changed with the link; value: the force scale from here on

inline constexpr std::uint32_t kEventUndo = 112;  ///< of marks; value: loop::UndoAnswer

inline constexpr std::uint32_t kEventScene =
    113;  ///< another sample of the server is asked for, or comes; value: its place in the list

/// What the loop tells the progress line.
struct Progress {
  double time_s = 0;
  double tip_height_nm = 0;
  double force_nn = 0;
  double hand_force_n = 0;
  link::LinkQuality link;
  double playout_delay_ms = 0;  ///< 0: none
  std::uint64_t playout_late = 0;
  std::uint64_t commands_held = 0;            ///< by the deadband
  std::uint32_t reply_deadband_permille = 0;  ///< that the server was told last
  double send_hz = 0;                         ///< datagrams a second that the link is given,
  double send_full_hz = 0;                    ///< at most,
  double send_least_hz = 0;                   ///< at least so far
  link::RateReason send_reason = link::RateReason::kFixed;
  std::uint64_t send_lowered = 0;  ///< times, by a queue, losses or silence
  double energy_j = 0;
  std::uint32_t mode = 0;
  control::Method method = control::Method::kNone;
  double planned_delay_s = 0;  ///< of the loop, that the force scale follows; 0: it does not
  double force_scale = 0;
  std::uint32_t twin_left = 0;  ///< times that a stiffness was given up which was planned for the twin alone,
  double force_scale_without_twin = 0;  ///< for this one
  bool chooses_method = false;          ///< by the rule; nobody has said which
  double silent_s = 0;
  device::ForceOffCause force_off = device::ForceOffCause::kNone;  ///< why the device is not ready
  bool observes = false;                                           ///< of a shared tip
  station::TwinState twin = station::TwinState::kNone;
  station::TwinEnd twin_end = station::TwinEnd::kNone;
  std::uint64_t twin_behind = 0;  ///< steps of it that the server has not confirmed
  bool tip_up = false;            ///< the slave has withdrawn the session's tip
  bool shutting_down = false;     ///< the server has said so, and is not back yet
  std::int64_t ticks = 0;
  std::uint64_t overruns = 0;
  std::uint64_t missed_ticks = 0;
  std::uint64_t sessions = 0;  ///< Welcomes
  std::uint32_t epoch = 0;     ///< of the session; 0: on its way to another scene
  std::uint32_t station_faults = 0;
  std::uint32_t slave_faults = 0;
};

/// The hand of a session: the device, and what decides when the session is over.
struct SessionHand {
  device::HapticDevice& device;
  device::PlayedMotion* motion = nullptr;  ///< null: a person moves it
  double duration_s = 0;                   ///< for a person's hand: ends after so long; 0 = until stopped
};

/// The station's loop in real time: paces StationLoop with a timer, lets the device's time pass, records and
/// sums up, until the motion or the time is over, a stop is asked for, the station has stopped itself or the
/// server stays silent.
class RealTimeSession {
 public:
  /// `recorder` may be null. `observe_s`: how long it looks on if it never gets a shared tip, and how long a played
  /// hand stands still with a tip before it is given up. Everything referred to must outlive run().
  RealTimeSession(const SessionHand& hand, net::Datagram& socket, const net::Address& server,
                  link::ClientSession& session, station::Station& station, recording::Recorder* recorder,
                  double give_up_s, double observe_s, const std::atomic<bool>& stop,
                  const loop::LinkOptions& link = {});

  /// Of a shared tip: link::kFlagTakeOver or link::kFlagHandOver. Before run().
  /// Takes the last stroke of marks back at that time of the session, as a person at the screen would.
  void undo_at(double time_s) noexcept { undo_at_s_ = time_s; }
  /// What became of the last wish to do so; null: there was none, or it is not known yet.
  const char* undo_text() const noexcept { return undo_text_; }
  void set_tip_wish(std::uint32_t flags) noexcept { loop_.set_tip_wish(flags); }

  /// The method follows the link (control::MethodChoice) until a person says which, before run().
  void choose_method() noexcept {
    chooses_method_ = true;
    choice_ = control::MethodChoice(station_.config().method);
  }
  /// What of weak forces is shown in each task that the window offers (Station::change_companding).
  void set_companding(std::vector<control::CompandingConfig> of_tasks) noexcept {
    companding_ = std::move(of_tasks);
  }
  /// The force scale follows the link as long as nobody else changes it, before run().
  void follow_scaling(control::ScalingFollower follower) noexcept { scaling_ = std::move(follower); }
  /// The way to the server can be made worse on a person's word, before run().
  void set_practice(connection::ServerLink& way) noexcept { practised_ = &way; }
  /// The server's scenes, by their hashes, before run(): a person at the screen may go to another one. Then run() ends
  /// with Ending::kOtherScene once the session is there; no Bye is said, and the station has not begun there.
  void set_scenes(std::vector<std::uint64_t> hashes) noexcept { scenes_ = std::move(hashes); }
  /// Who fetches the server's scene, before run().
  void set_scene_pipe(loop::ScenePipe& pipe) noexcept { loop_.set_scene_pipe(&pipe); }

  /// A recording from the next tick on, where there is none yet; while run() runs, from another thread. It must
  /// outlive run().
  void record_from_now(recording::Recorder& recorder) noexcept {
    later_recorder_.store(&recorder, std::memory_order_release);
  }

  /// A screen that shows the session and asks things of it, before run(). A station that has stopped itself
  /// then waits for the person there instead of ending the session. `stays`: so does a hand at the end of its
  /// motion; it does anyway once a task has been chosen there.
  void show_on(view_model::ViewRequestHandler& requests, bool stays = false) noexcept {
    requests_ = &requests;
    stays_ = stays;
  }

  /// The loop, in the thread that calls it. Neither allocates, locks nor writes.
  void run() noexcept;

  // For other threads, while it runs.
  bool finished() const noexcept { return finished_.load(std::memory_order_acquire); }
  Progress progress() const noexcept { return progress_.load(); }
  std::uint64_t ticks() const noexcept { return progress_.count(); }

  // After it has finished.
  Ending ending() const noexcept { return ending_; }
  /// The tip was this session's, but withdrawn the whole time.
  bool tip_stayed_up() const noexcept { return tip_seen_up_ && !tip_seen_down_; }
  recording::Summary summary() const noexcept { return summary_.finish(); }
  const rt::PeriodicTimerStats& timer_stats() const noexcept { return timer_stats_; }

 private:
  void see_tip(const recording::Sample& before) noexcept;
  void keep_plan(const recording::Sample& before, double dt_s) noexcept;
  void follow_link(const recording::Sample& before, double dt_s) noexcept;
  void undo_marks(const recording::Sample& before) noexcept;
  void follow_undo(const recording::Sample& sample) noexcept;
  void ask_screen(const recording::Sample& before) noexcept;
  void go_to_scene(int scene, const recording::Sample& before) noexcept;
  void show_scene(view_model::SceneText text) noexcept;
  void event_of_scene(const recording::Sample& sample, const char* text) noexcept;
  void follow_scene(const recording::Sample& sample) noexcept;
  void record_rate(const recording::Sample& sample) noexcept;
  void record_events(const recording::Sample& sample) noexcept;
  void publish(const recording::Sample& sample, const rt::PeriodicTimerStats& timer) noexcept;
  double hand_time_s(const recording::Sample& sample) const noexcept;
  bool motion_over(const recording::Sample& sample) const noexcept;
  void note_tip(const recording::Sample& sample) noexcept;
  void note_standing(const recording::Sample& sample) noexcept;
  void note_scale(const recording::Sample& sample) noexcept;
  bool over(const recording::Sample& sample) noexcept;

  SessionHand hand_;
  link::ClientSession& session_;
  station::Station& station_;
  recording::Recorder* recorder_;
  std::atomic<recording::Recorder*> later_recorder_{nullptr};
  view_model::ViewRequestHandler* requests_ = nullptr;
  double give_up_s_;
  double observe_s_;
  const std::atomic<bool>& stop_;
  rt::SteadyClock clock_;
  loop::StationLoop loop_;
  connection::ServerLink* practised_ = nullptr;  // null: no link to practise on
  double surface_z_w_nm_;
  Vec3 task_origin_w_nm_;
  recording::SummaryBuilder summary_;
  rt::PeriodicTimerStats timer_stats_;
  rt::LatestValue<Progress> progress_;
  std::atomic<bool> finished_{false};
  Ending ending_ = Ending::kTaskDone;

  std::int64_t stop_ticks_ = 0;
  bool chooses_method_ = false;
  control::ScalingFollower scaling_;
  bool keeps_plan_ = true;  // until a person changes the scale
  control::MethodChoice choice_;
  std::vector<control::CompandingConfig> companding_;  // by the task's place in the list
  bool quit_ = false;
  bool stays_ = false;
  std::uint32_t marks_ = 0;
  std::int64_t fault_ticks_ = 0;
  std::int64_t done_ticks_ = 0;
  bool tip_seen_up_ = false;    // by the holder: withdrawn,
  bool tip_seen_down_ = false;  // and not
  double tip_left_up_s_ = 0;    // withdrawn, and not on its way back, for so long
  double stands_s_ = 0;         // a played hand, in sum, that only the link keeps from its motion
  bool silent_ = false;
  station::Mode last_mode_ = station::Mode::kIdle;
  std::uint64_t last_sessions_;
  std::uint32_t last_epoch_;
  bool last_observes_ = false;
  bool leaves_twin_ = false;
  std::uint32_t twin_left_ = 0;
  double last_rate_hz_ = 0;
  double last_rate_s_ = 0;
  std::vector<std::uint64_t> scenes_;
  int scene_ = -1;            // that a person wants to go to; negative: none
  bool scene_asked_ = false;  // of the server: the hand has let go
  double scene_wanted_s_ = 0;
  std::uint32_t scene_shown_ = 0;
  double undo_at_s_ = 0;  // 0: never
  loop::UndoAnswer undo_told_ = loop::UndoAnswer::kNone;
  std::uint32_t undo_shown_ = 0;
  const char* undo_text_ = nullptr;
  station::TwinState last_twin_ = station::TwinState::kNone;
};

}  // namespace telenano::app
