#include "telenano/master/app/run/real_time_session.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

namespace telenano::app {
namespace {

constexpr std::int64_t kStopTicks = 20;  // for the stop to reach the server
constexpr double kAfterTaskS = 0.2;      // the hand comes to rest
constexpr double kSilentS = 0.1;         // from when on a person is told
constexpr double kUnfeltN = 0.005;       // a force that nobody notices
constexpr double kSceneS = 30;           // making a slave may take the server a while

// Before the first reply there is no age: since the start, then.
double silent_s(const recording::Sample& sample) noexcept {
  return std::min(sample.reply_age_ms * 1e-3, sample.time_s);
}

recording::Event note_event(const view_model::Note& note) noexcept {
  constexpr std::string_view kBefore = "note: ";
  std::array<char, kBefore.size() + view_model::Note::kText> text{};
  std::copy(kBefore.begin(), kBefore.end(), text.begin());
  std::copy(note.text.begin(), note.text.end() - 1, text.begin() + kBefore.size());
  return recording::make_event(note.tick, note.time_s, kEventNote, text.data());
}

}  // namespace

RealTimeSession::RealTimeSession(const SessionHand& hand, net::Datagram& socket, const net::Address& server,
                                 link::ClientSession& session, station::Station& station,
                                 recording::Recorder* recorder, double give_up_s, double observe_s,
                                 const std::atomic<bool>& stop, const loop::LinkOptions& link)
    : hand_(hand),
      session_(session),
      station_(station),
      recorder_(recorder),
      give_up_s_(give_up_s),
      observe_s_(observe_s),
      stop_(stop),
      loop_(hand.device, socket, server, session, station, &clock_, link),
      surface_z_w_nm_(session.welcome().surface_z_w_nm),
      task_origin_w_nm_(session.welcome().start_pos_w_nm.x(), session.welcome().start_pos_w_nm.y(),
                        surface_z_w_nm_),
      summary_({station.config().rate_hz, surface_z_w_nm_}),
      last_sessions_(session.sessions()),
      last_epoch_(session.welcome().epoch) {}

void RealTimeSession::run() noexcept {
  rt::PeriodicTimerConfig timer_config;
  timer_config.period_ns = std::llround(1e9 / station_.config().rate_hz);
  rt::PeriodicTimer timer(timer_config);
  recording::Sample sample;
  do {
    const rt::Tick tick = timer.wait();
    const std::int64_t elapsed_ns = timer_config.period_ns * (1 + tick.missed);
    if (recorder_ == nullptr) recorder_ = later_recorder_.load(std::memory_order_acquire);
    if (recorder_ != nullptr) loop_.set_records();
    see_tip(sample);
    hand_.device.advance(elapsed_ns);
    if (requests_ != nullptr) ask_screen(sample);
    if (scaling_.follows()) keep_plan(sample, static_cast<double>(elapsed_ns) * 1e-9);
    if (chooses_method_) follow_link(sample, static_cast<double>(elapsed_ns) * 1e-9);
    if (quit_ || stop_.load(std::memory_order_relaxed)) {
      loop_.set_buttons(device::kButtonStop);
      ++stop_ticks_;
    }
    device::PlayedMotion* const motion = hand_.motion;
    if (motion != nullptr && !motion->motion_started() && station_.mode() == station::Mode::kEngaged)
      motion->start_motion();
    loop_.tick(tick.woke_ns, static_cast<double>(elapsed_ns) * 1e-9, sample);
    sample.lateness_us = static_cast<double>(tick.lateness_ns) * 1e-3;
    sample.overruns = static_cast<std::int64_t>(timer.stats().overruns);
    sample.step_us = static_cast<double>(clock_.now_ns() - tick.woke_ns) * 1e-3;
    if (scene_ >= 0) follow_scene(sample);
    follow_undo(sample);
    note_tip(sample);
    note_standing(sample);
    note_scale(sample);
    summary_.add(sample);
    if (recorder_ != nullptr) {
      for (const recording::DatagramRow& row : loop_.datagrams()) recorder_->push(row);
      for (const recording::StatePieceRow& row : loop_.state_pieces()) recorder_->push(row);
      recorder_->push(sample);
      record_events(sample);
    }
    publish(sample, timer.stats());
    if (requests_ != nullptr) {
      requests_->show(sample, loop_.force_off());
      const station::StationTrace& trace = loop_.trace();
      requests_->show(trace.twin);
      const bool twin = trace.twin != station::TwinState::kNone &&
                        trace.twin != station::TwinState::kGivenUp &&
                        trace.twin != station::TwinState::kWaits && !trace.observes;
      requests_->show(view_model::ShownContact{trace.contact_radius_nm, trace.adhesion_nn, twin});
      requests_->show_chooser(chooses_method_);
      if (motion != nullptr) requests_->show(motion->task());
    }
  } while (!over(sample));
  hand_.device.write_force(Vec3::Zero());
  if (ending_ != Ending::kOtherScene)
    loop_.say_bye(ending_ == Ending::kTaskDone ? link::ByeReason::kDone : link::ByeReason::kStopped);
  timer_stats_ = timer.stats();
  finished_.store(true, std::memory_order_release);
}

void RealTimeSession::see_tip(const recording::Sample& before) noexcept {
  if (hand_.motion == nullptr || !(before.velocity_scale > 0)) return;
  const auto& target = before.tip_target_w_nm;
  hand_.motion->see_tip({Vec3(target[0], target[1], target[2]) - task_origin_w_nm_,
                         1e-9 / before.velocity_scale, station_.mode() == station::Mode::kEngaged,
                         station_.mode() == station::Mode::kHeld});
}

/// Another method where the link has become another one; at a moment at which nobody feels it.
void RealTimeSession::follow_link(const recording::Sample& before, double dt_s) noexcept {
  if (station_.config().method != choice_.now()) {  // a person has said which
    chooses_method_ = false;
    return;
  }
  control::MethodCircumstances now;
  if (before.rtt_us > 0) now.rtt_s = std::max(1e-6 * before.rtt_smoothed_us, 1e-3 * before.playout_delay_ms);
  now.jitter_s = 1e-6 * before.jitter_us;
  now.at_rest = before.contact_state != static_cast<std::uint32_t>(link::ContactState::kContact) &&
                loop_.trace().commanded_force_h_n.norm() < kUnfeltN;
  now.measures = before.measurement_age_ms != 0;
  // Until the first reply there is nothing that it could be apart from.
  const station::TwinRun* const twin = station_.twin();
  const bool not_yet = before.reply_sequence <= 0 && twin != nullptr && !twin->given_up();
  now.twin = twin != nullptr && (twin->on() || not_yet);
  const control::Method wanted = choice_.update(now, dt_s);
  if (wanted == station_.config().method) return;
  station_.change_method(wanted);
  if (recorder_ != nullptr)
    recorder_->push(recording::make_event(before.tick, before.time_s, kEventMethod,
                                          "method changed with the link",
                                          static_cast<std::uint32_t>(wanted)));
}

/// What was planned for one round trip is too stiff at a longer one, for a method that does not pay for it.
void RealTimeSession::keep_plan(const recording::Sample& before, double dt_s) noexcept {
  control::Scaling wanted = station_.config().scaling;
  keeps_plan_ = keeps_plan_ && wanted.force == scaling_.force();  // a person has said which
  if (!keeps_plan_ || control::binding_delay_samples(station_.config().method, 2) < 2) return;
  control::ScalingFollower::Circumstances now;
  if (before.rtt_us > 0) now.rtt_s = std::max(1e-6 * before.rtt_smoothed_us, 1e-3 * before.playout_delay_ms);
  now.jitter_s = 1e-6 * before.jitter_us;
  now.at_rest = before.contact_state != static_cast<std::uint32_t>(link::ContactState::kContact) &&
                loop_.trace().commanded_force_h_n.norm() < kUnfeltN;
  const double planned_s = scaling_.planned_s();
  const bool changed = scaling_.update(now, dt_s);
  const bool lower = scaling_.planned_s() > planned_s;
  if (scaling_.planned_s() != planned_s && recorder_ != nullptr)
    recorder_->push(recording::make_event(before.tick, before.time_s, kEventScale,
                                          lower ? "force scale lowered: the round trip is longer"
                                                : "force scale raised: the round trip is shorter",
                                          static_cast<std::uint32_t>(std::min(scaling_.target(), 4e9))));
  if (!changed) return;
  wanted.force = scaling_.force();
  keeps_plan_ = station_.change_scaling(wanted);
}

void RealTimeSession::ask_screen(const recording::Sample& before) noexcept {
  const view_model::ViewRequestHandler::Asked asked = requests_->answer(station_);
  if (asked.scene >= 0) go_to_scene(asked.scene, before);
  loop_.set_buttons(asked.buttons | (scene_ >= 0 ? std::uint32_t{device::kButtonClutch} : 0u));
  quit_ |= asked.quit;
  // Not while it is stopped, held or not connected: the hand would go its way without the tip.
  const bool free = station_.mode() == station::Mode::kEngaged || station_.mode() == station::Mode::kReady;
  if (asked.task >= 0 && free && hand_.motion != nullptr && hand_.motion->begin_task(asked.task)) {
    stays_ = true;
    done_ticks_ = 0;
    const auto task = static_cast<std::size_t>(asked.task);
    if (task < companding_.size()) station_.change_companding(companding_[task]);
    if (recorder_ != nullptr)
      recorder_->push(recording::make_event(before.tick, before.time_s, kEventTask, "task chosen",
                                            static_cast<std::uint32_t>(asked.task)));
  }
  if (asked.practice && practised_ != nullptr) {
    practised_->practise(*asked.practice);
    if (recorder_ != nullptr)
      recorder_->push(recording::make_event(before.tick, before.time_s, kEventPractice, "practice link",
                                            static_cast<std::uint32_t>(asked.practice->rtt_ms)));
  }
  if (asked.undo) undo_marks(before);
  // One a tick is more than a person writes.
  if (view_model::Note note; requests_->take_note(note) && recorder_ != nullptr)
    recorder_->push(note_event(note));
  for (int i = 0; i < asked.marks; ++i) {
    ++marks_;
    if (recorder_ != nullptr)
      recorder_->push(recording::make_event(before.tick, before.time_s, kEventMark, "mark", marks_));
  }
}

/// First the hand lets go, as by the clutch: nothing follows, and the force fades.
void RealTimeSession::go_to_scene(int scene, const recording::Sample& before) noexcept {
  if (scene_ >= 0 || static_cast<std::size_t>(scene) >= scenes_.size()) return;
  scene_ = scene;
  scene_asked_ = false;
  scene_wanted_s_ = before.time_s;
  show_scene(view_model::SceneText::kLetsGo);
  event_of_scene(before, "another sample wanted: lets go");
}

void RealTimeSession::show_scene(view_model::SceneText text) noexcept {
  if (requests_ != nullptr) requests_->show(view_model::SceneShown{text, ++scene_shown_});
}

void RealTimeSession::event_of_scene(const recording::Sample& sample, const char* text) noexcept {
  if (recorder_ != nullptr)
    recorder_->push(recording::make_event(sample.tick, sample.time_s, kEventScene, text,
                                          static_cast<std::uint32_t>(scene_)));
}

/// With no force left the server is asked. At the other scene the loop ends (over()); after a refusal, or without an
/// answer, the session goes on where it is.
void RealTimeSession::follow_scene(const recording::Sample& sample) noexcept {
  const std::uint64_t hash = scenes_[static_cast<std::size_t>(scene_)];
  if (session_.welcome().scene_hash == hash)
    return event_of_scene(sample, "the session goes on at another sample");
  const char* why = nullptr;
  if (scene_asked_ && session_.scene_switching() == link::SceneSwitching::kRefused) {
    const link::RefuseReason reason = session_.refuse().reason;
    show_scene(reason == link::RefuseReason::kRate           ? view_model::SceneText::kRate
               : reason == link::RefuseReason::kShuttingDown ? view_model::SceneText::kShuttingDown
                                                             : view_model::SceneText::kRefused);
    why = "another sample refused";
  } else if (sample.time_s - scene_wanted_s_ > kSceneS) {
    show_scene(view_model::SceneText::kNoAnswer);
    why = "another sample: no answer";
    session_.forget_switch();
  }
  if (why != nullptr) {
    event_of_scene(sample, why);
    loop_.leave_for_scene(0);
    scene_ = -1;
    return;
  }
  const bool rests =
      station_.mode() != station::Mode::kEngaged && loop_.trace().commanded_force_h_n.isZero(0);
  if (scene_asked_ || !rests || !session_.switch_scene(hash, sample.now_ns)) return;
  scene_asked_ = true;
  loop_.leave_for_scene(hash);
  show_scene(view_model::SceneText::kAsked);
}

/// At the screen, or at a time that was given.
void RealTimeSession::undo_marks(const recording::Sample& before) noexcept {
  if (!loop_.undo_marks(before.now_ns)) return;
  if (recorder_ != nullptr)
    recorder_->push(recording::make_event(before.tick, before.time_s, kEventUndo, "undo of marks asked"));
}

void RealTimeSession::follow_undo(const recording::Sample& sample) noexcept {
  if (undo_at_s_ > 0 && sample.time_s >= undo_at_s_) {
    undo_at_s_ = 0;
    undo_marks(sample);
  }
  const loop::UndoAnswer now = loop_.undo_answer();
  if (now == undo_told_) return;
  undo_told_ = now;
  using view_model::UndoText;
  UndoText text = UndoText::kAsked;
  const char* event = nullptr;
  switch (now) {
    case loop::UndoAnswer::kNone:
    case loop::UndoAnswer::kAsked:
      break;
    case loop::UndoAnswer::kDone:
      text = UndoText::kDone;
      event = "last stroke of marks taken back";
      break;
    case loop::UndoAnswer::kRefused:
      text = UndoText::kRefused;
      event = "marks not taken back: refused";
      break;
    case loop::UndoAnswer::kAnothers:
      text = UndoText::kAnothers;
      event = "marks not taken back: another session has made the last ones";
      break;
    case loop::UndoAnswer::kNoAnswer:
      text = UndoText::kNoAnswer;
      event = "marks not taken back: no answer";
      break;
  }
  if (event != nullptr) undo_text_ = event;
  if (requests_ != nullptr) requests_->show(view_model::UndoShown{text, ++undo_shown_});
  if (event != nullptr && recorder_ != nullptr)
    recorder_->push(recording::make_event(sample.tick, sample.time_s, kEventUndo, event,
                                          static_cast<std::uint32_t>(now)));
}

/// A tenth of change is worth a row, twice a second at most: what is between is in the commands that were
/// sent.
void RealTimeSession::record_rate(const recording::Sample& sample) noexcept {
  constexpr double kAgainS = 0.5;
  const double rate_hz = loop_.rate().rate_hz();
  const bool first = last_rate_hz_ == 0;
  const bool other = std::abs(rate_hz - last_rate_hz_) > 0.1 * last_rate_hz_ ||
                     (rate_hz == loop_.rate().full_hz() && rate_hz != last_rate_hz_);
  if (!first && (!other || sample.time_s - last_rate_s_ < kAgainS)) return;
  last_rate_hz_ = rate_hz;
  last_rate_s_ = sample.time_s;
  const char* text = "";
  switch (loop_.rate().reason()) {
    case link::RateReason::kFull:
      text = "sends every tick";
      break;
    case link::RateReason::kStart:
      text = "sends less: the link is not known yet";
      break;
    case link::RateReason::kQueue:
      text = "sends less: a queue on the way";
      break;
    case link::RateReason::kLoss:
      text = "sends less: losses";
      break;
    case link::RateReason::kSilence:
      text = "sends less: nothing comes back";
      break;
    case link::RateReason::kRising:
      text = "sends more: the link has room";
      break;
    case link::RateReason::kFixed:
      text = "sends as told";
      break;
  }
  recorder_->push(recording::make_event(sample.tick, sample.time_s, kEventSendRate, text,
                                        static_cast<std::uint32_t>(rate_hz)));
}

void RealTimeSession::record_events(const recording::Sample& sample) noexcept {
  record_rate(sample);
  if (station_.mode() != last_mode_) {
    last_mode_ = station_.mode();
    recorder_->push(recording::make_event(sample.tick, sample.time_s, static_cast<std::uint32_t>(last_mode_),
                                          station::mode_name(last_mode_), sample.station_faults));
  }
  if (session_.sessions() != last_sessions_) {
    const std::uint32_t epoch = session_.welcome().epoch;
    const char* text = epoch == last_epoch_ ? "session resumed" : "session resumed in a new epoch";
    recorder_->push(recording::make_event(sample.tick, sample.time_s, kEventSession, text, epoch));
    last_sessions_ = session_.sessions();
    last_epoch_ = epoch;
  }
  if (const bool observes = loop_.trace().observes; observes != last_observes_) {
    recorder_->push(recording::make_event(sample.tick, sample.time_s, kEventTip,
                                          observes ? "observes the shared tip" : "holds the shared tip",
                                          observes ? 0 : 1));
    last_observes_ = observes;
  }
  // What is confirmed and what is on its way is one state here: they take turns with each reply.
  station::TwinState twin = loop_.trace().twin;
  if (twin == station::TwinState::kBehind) twin = station::TwinState::kConfirmed;
  if (twin != last_twin_ && station_.twin() != nullptr) {
    const char* const text = twin == station::TwinState::kConfirmed ? "twin: the server's state"
                             : twin == station::TwinState::kApart   ? "twin: apart from the server"
                             : twin == station::TwinState::kGivenUp ? "twin: given up"
                             : twin == station::TwinState::kWaits   ? "twin: waits for the shared tip"
                                                                    : "twin: none in this session";
    recorder_->push(recording::make_event(sample.tick, sample.time_s, kEventTwin, text,
                                          static_cast<std::uint32_t>(station_.twin()->partings())));
    last_twin_ = twin;
  }
  const bool silent = silent_s(sample) > kSilentS;
  if (silent && !silent_)
    recorder_->push(recording::make_event(sample.tick, sample.time_s, kEventSilent, "server silent"));
  silent_ = silent;
}

void RealTimeSession::publish(const recording::Sample& sample, const rt::PeriodicTimerStats& timer) noexcept {
  Progress p;
  p.time_s = hand_time_s(sample);
  p.tip_height_nm = sample.tip_pos_w_nm[2] - surface_z_w_nm_;
  p.force_nn = sample.force_w_nn[2];
  p.hand_force_n = loop_.trace().commanded_force_h_n.norm();
  p.link = loop_.quality();
  p.playout_delay_ms = sample.playout_delay_ms;
  p.playout_late = loop_.playout().counts().late;
  p.commands_held = loop_.gate().held();
  const control::Scaling& scaling = station_.config().scaling;
  p.force_scale = scaling_.follows() ? scaling_.target() : scaling.force;
  p.twin_left = twin_left_;
  p.force_scale_without_twin = station_.config().impedance_without_twin / scaling.velocity;
  if (scaling_.follows() && keeps_plan_) p.planned_delay_s = scaling_.planned_s();
  p.reply_deadband_permille = loop_.told_reply_deadband().relative_permille;
  p.send_hz = loop_.rate().rate_hz();
  p.send_full_hz = loop_.rate().full_hz();
  p.send_least_hz = loop_.rate().lowest_hz();
  p.send_reason = loop_.rate().reason();
  p.send_lowered = loop_.rate().lowered();
  p.ticks = sample.tick + 1;
  p.overruns = timer.overruns;
  p.missed_ticks = timer.missed;
  p.sessions = session_.sessions();
  p.epoch = scene_ < 0 ? session_.welcome().epoch : 0;
  p.station_faults = sample.station_faults;
  p.slave_faults = sample.fault_bits;
  p.energy_j = sample.energy_j;
  p.mode = sample.station_mode;
  p.method = station_.config().method;
  p.chooses_method = chooses_method_;
  p.twin = loop_.trace().twin;
  p.twin_end = loop_.trace().twin_end;
  p.twin_behind = loop_.trace().twin_behind;
  p.silent_s = silent_s(sample);
  p.force_off = loop_.force_off();
  p.observes = loop_.trace().observes;
  p.tip_up = station_.tip_up() && station_.holds_tip();
  p.shutting_down = session_.state() == link::ClientState::kLost && !session_.has_session() &&
                    session_.bye_reason() == link::ByeReason::kShuttingDown;
  progress_.store(p);
}

double RealTimeSession::hand_time_s(const recording::Sample& sample) const noexcept {
  return hand_.motion != nullptr ? hand_.motion->motion_time_s() : sample.time_s;
}

bool RealTimeSession::motion_over(const recording::Sample& sample) const noexcept {
  if (hand_.motion != nullptr) return hand_.motion->motion_done();
  return hand_.duration_s > 0 && sample.time_s >= hand_.duration_s;
}

void RealTimeSession::note_tip(const recording::Sample& sample) noexcept {
  const bool stopped = station_.mode() == station::Mode::kStopped;
  const bool known = sample.reply_sequence > 0 && station_.holds_tip();
  if (!known || stopped || !station_.tip_up() || (sample.fault_bits & link::kFaultApproaching) != 0) {
    tip_left_up_s_ = 0;
  } else {
    tip_left_up_s_ += sample.dt_s;
  }
  if (!known) return;
  (station_.tip_up() ? tip_seen_up_ : tip_seen_down_) = true;
}

/// A tip that is up, or whose state is on its way, will be there; a server that is silent is given up sooner.
void RealTimeSession::note_standing(const recording::Sample& sample) noexcept {
  if (hand_.motion == nullptr) return;
  const bool stands = station_.mode() == station::Mode::kHeld ||
                      (station_.mode() == station::Mode::kReady && !hand_.motion->motion_started());
  const bool soon = station_.tip_up() || loop_.trace().twin == station::TwinState::kWaits;
  if (sample.reply_sequence > 0 && stands && session_.has_session() && station_.holds_tip() && !soon)
    stands_s_ += sample.dt_s;
}

/// The station itself goes back to another scale where what it was planned for, the twin, is not felt any more.
void RealTimeSession::note_scale(const recording::Sample& sample) noexcept {
  const bool leaves = (sample.station_faults & station::kFaultTwinLeft) != 0;
  if (!std::exchange(leaves_twin_, leaves) && leaves) {
    ++twin_left_;
    if (recorder_ != nullptr) {
      const double force = station_.config().impedance_without_twin / station_.config().scaling.velocity;
      recorder_->push(recording::make_event(sample.tick, sample.time_s, kEventScale,
                                            "force scale lowered: it was planned for the twin",
                                            static_cast<std::uint32_t>(std::min(force, 4e9))));
    }
  }
}

bool RealTimeSession::over(const recording::Sample& sample) noexcept {
  if (stop_ticks_ > kStopTicks) {
    ending_ = Ending::kStopped;
    return true;
  }
  if (requests_ == nullptr && stop_ticks_ == 0 && station_.mode() == station::Mode::kStopped &&
      ++fault_ticks_ > kStopTicks) {
    ending_ = Ending::kFault;
    return true;
  }
  if (scene_ >= 0 && session_.welcome().scene_hash == scenes_[static_cast<std::size_t>(scene_)]) {
    ending_ = Ending::kOtherScene;
    return true;
  }
  // Final: nothing more will come, and nobody needs to wait for it.
  const bool refused = session_.state() == link::ClientState::kRefused;
  if (session_.state() == link::ClientState::kClosed || refused) {
    ending_ = session_.state() == link::ClientState::kClosed ? Ending::kServerEnded : Ending::kRefused;
    return true;
  }
  if (silent_s(sample) > give_up_s_) {
    ending_ = Ending::kServerGone;
    return true;
  }
  // A hand that is played waits for the tip no longer than for a silent server. A person may know better.
  const bool begun = hand_.motion == nullptr || hand_.motion->motion_started();
  if (!begun && requests_ == nullptr && tip_left_up_s_ > give_up_s_) {
    ending_ = Ending::kTipUp;
    return true;
  }
  // Nor longer than its motion takes, for what keeps it from engaging. At a window a person sees to that, if nobody has
  // said how long.
  const bool bounded = !stays_ && (requests_ == nullptr || hand_.duration_s > 0);
  if (bounded && observe_s_ > 0 && stands_s_ > observe_s_) {
    ending_ = Ending::kNotEngaged;
    return true;
  }
  // Who does not move the tip watches for as long as the task would take.
  const bool still = hand_.motion == nullptr || !hand_.motion->motion_started();
  if (observe_s_ > 0 && still && loop_.trace().observes && sample.time_s > observe_s_) return true;
  if (stays_) return false;
  return motion_over(sample) && static_cast<double>(++done_ticks_) > kAfterTaskS * station_.config().rate_hz;
}

}  // namespace telenano::app
