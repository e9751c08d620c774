#include "telenano/master/loop/station_loop.h"

#include <algorithm>
#include <span>
#include <type_traits>

#include "proto/reply_columns.h"
#include "telenano/common/base/renew.h"

namespace telenano::loop {
namespace {

/// A field of the reply, or what it names, as the row has it.
template <class Field, class Column>
void keep(const Field& field, Column& column) noexcept {
  if constexpr (std::is_same_v<Field, Vec3>) {
    column = recording::xyz(field);
  } else {
    column = static_cast<Column>(field);
  }
}

}  // namespace

StationLoop::StationLoop(device::HapticDevice& device, net::Datagram& socket, const net::Address& server,
                         link::ClientSession& session, station::Station& station, const rt::Clock* clock,
                         const LinkOptions& options)
    : device_(device),
      socket_(socket),
      server_(server),
      session_(session),
      station_(station),
      clock_(clock),
      playout_(options.playout),
      gate_(options.gate),
      rate_(options.rate),
      reply_deadband_(options.reply_deadband),
      limits_rate_(options.rate.full_hz < kEveryTick),
      step_pace_ns_(options.step_pace_ns) {}

void StationLoop::send(std::size_t size) noexcept {
  if (size == 0) return;
  if (socket_.send(std::span(buffer_).first(size), server_) != net::SendStatus::kSent) ++send_failures_;
}

/// What the station is to hear of in this tick; null: nothing new.
const link::Reply* StationLoop::next_reply(std::int64_t now_ns, bool replied) noexcept {
  if (!playout_.active()) return replied && session_.has_reply() ? &session_.reply() : nullptr;
  if (session_.stats().samples() > 0)
    playout_.set_link(session_.stats().rtt_ns(), session_.stats().rtt_var_ns());
  return playout_.due(now_ns);
}

/// The slave's state, where the twin is apart: asked for piece by piece, kRequestsPerTick in a tick.
void StationLoop::fetch_snapshot(std::int64_t now_ns) noexcept {
  constexpr int kRequestsPerTick = 4;
  const bool other = output_.has_step && output_.snapshot_of != snapshot_of_;
  if (other) snapshot_of_ = output_.snapshot_of;
  if (input_.snapshot != nullptr || other) session_.drop_snapshot();  // the station has it
  if (!output_.wants_snapshot) return;
  if (!session_.snapshot().active()) {
    if (session_.snapshot().refused()) return;
    session_.ask_snapshot();
  }
  session_.set_snapshot_pace(rate_.bulk_per_s());
  for (int i = 0; i < kRequestsPerTick; ++i) {
    const std::size_t size = session_.make_snapshot_request(now_ns, buffer_);
    if (size == 0) return;
    rate_.bulk_sent(now_ns);
    send(size);
  }
}

/// Is the twin felt, all of whose steps go with some datagram?
bool StationLoop::carries_steps() const noexcept {
  return output_.has_step && output_.trace.method == control::Method::kTwin;
}

/// With a twin the hand needs no quick answer, and what a datagram costs is shared by the steps that it
/// carries: it goes at a slower pace. What is missing, another flag or method does not wait for it.
bool StationLoop::wants_to_send(std::int64_t now_ns) noexcept {
  const link::Command& command = output_.command;
  const bool paced = carries_steps();
  const bool due = now_ns - paced_ns_ >= step_pace_ns_ || command.flags != paced_flags_ ||
                   command.control.method != paced_method_ || session_.steps_are_urgent(now_ns);
  if (sends_ != Sends::kAsDue) return sends_ == Sends::kNow;
  if (paced && !due) return false;
  // What a person does to the clutch, and another method, wait for no rate.
  const bool changed = command.flags != paced_flags_ || command.control.method != paced_method_;
  if (limits_rate_ && !rate_.may_send(changed)) return false;
  gate_.widen(rate_.deadband_factor());
  if (paced) {
    gate_.sent(command, output_.hand_force_h_n, now_ns);
  } else if (!gate_.wants(command, output_.hand_force_h_n, now_ns)) {
    return false;
  }
  paced_ns_ = now_ns;
  paced_flags_ = command.flags;
  paced_method_ = command.control.method;
  return true;
}

/// The floor is said at the tip: what is felt of a force there follows the scale.
link::ReplyDeadband StationLoop::reply_deadband() const noexcept {
  const double share = !reply_deadband_.adapts ? 1 : records_ ? 0 : rate_.reply_deadband_share();
  const double permille =
      std::min(share * reply_deadband_.permille, 1.0 * link::ReplyDeadband::kPermilleMost);
  if (!(permille >= 1)) return {};
  const double felt_n_nn = station_.config().scaling.hand_force_n(Vec3::UnitX()).x();
  const double floor_pn = felt_n_nn > 0 ? 1e3 * share * reply_deadband_.floor_n / felt_n_nn : 0;
  constexpr double kFloorMost_pn = 1e9;
  return {static_cast<std::uint32_t>(std::clamp(floor_pn, 0.0, kFloorMost_pn)),
          static_cast<std::uint32_t>(permille)};
}

void StationLoop::tick(std::int64_t now_ns, double dt_s, recording::Sample& sample) noexcept {
  if (ticks_ == 0) start_ns_ = now_ns;

  bool replied = false;
  net::Received received;
  datagram_count_ = state_piece_count_ = 0;
  for (std::size_t i = 0; i < kDatagramsPerTick && socket_.receive(buffer_, received); ++i) {
    if (!(received.from == server_)) continue;  // somebody else's
    const std::size_t size = received.size < buffer_.size() ? received.size : buffer_.size();
    const std::int64_t came_ns = (clock_ != nullptr ? clock_->now_ns() : now_ns) - received.age_ns;
    const link::ClientEvent event = session_.on_datagram(std::span(buffer_).first(size), came_ns);
    replied |= event == link::ClientEvent::kReply;
    on_event(event, came_ns);
    if (event == link::ClientEvent::kSceneChunk) {
      if (scene_pipe_ != nullptr) scene_pipe_->take(session_.incoming().scene_chunk);
      continue;  // nothing that the station hears of, nor a recording
    }
    note_datagram(came_ns);
    if (event == link::ClientEvent::kPiece) note_state_piece(session_.incoming().snapshot_piece);
    if (!playout_.active()) continue;
    if (event == link::ClientEvent::kWelcome) playout_.clear();
    if (event == link::ClientEvent::kReply) playout_.push(session_.reply());
    if (const link::Reply* const overtaken = session_.overtaken_reply()) playout_.push(*overtaken);
  }
  const bool waits = waits_for_scene(now_ns);
  if (session_.sessions() != sessions_begun_ && !waits) {
    sessions_begun_ = session_.sessions();
    station_.begin_session(session_.welcome(), !session_.resumed_unknown_account());
    gate_.clear();
    undo_.on_session();
  }

  const double interval_s = hand_interval_s(dt_s);
  device_.read(reading_);
  input_.time_ns = now_ns;
  input_.device_status = reading_.status;
  input_.hand_pos_h_m = reading_.hand_pos_h_m;
  input_.buttons = reading_.buttons | extra_buttons_;
  input_.applied_force_h_n = applied_h_n_;
  input_.session_up = session_.has_session() && !waits;
  input_.command_sequence = session_.commands_sent() + 1;
  input_.next_step = session_.next_step();
  const link::SnapshotFetch& snapshot = session_.snapshot();
  input_.snapshot = snapshot.active() && snapshot.complete() ? &snapshot : nullptr;
  input_.snapshot_pieces = snapshot.active() ? snapshot.pieces_here() : 0;
  input_.snapshot_per_s = rate_.bulk_per_s();
  input_.snapshot_refused = snapshot.refused();
  input_.rtt_s = 1e-9 * session_.stats().rtt_ns();
  input_.reply = waits ? nullptr : next_reply(now_ns, replied);
  if (replied && session_.has_reply())
    undo_.on_reply(session_.reply().command_sequence, session_.reply().fault_bits);
  undo_.on_time(now_ns);
  input_.tip_wish = tip_wish_ | undo_.flag(input_.command_sequence);
  station_.step(input_, interval_s, output_);
  sample.now_ns = now_ns;
  sample.dt_s = interval_s;
  sample.device_status = static_cast<std::int64_t>(reading_.status);
  applied_h_n_ = device_.write_force(output_.hand_force_h_n);

  send(session_.poll(now_ns, buffer_));
  sample.sent_ns = 0;
  rate_.carry_steps(carries_steps());
  rate_.update(now_ns);
  if (output_.has_step) session_.add_step(output_.step);
  fetch_snapshot(now_ns);
  if (wants_to_send(now_ns)) {
    const std::int64_t sent_ns = clock_ != nullptr ? clock_->now_ns() : now_ns;
    session_.repeat_at_most(rate_.redundancy());
    output_.command.reply_deadband = reply_deadband();
    const std::size_t size = session_.make_command(output_.command, sent_ns, buffer_);
    told_reply_deadband_ = output_.command.reply_deadband;
    if (size > 0) sample.sent_ns = sent_ns;
    if (size > 0) rate_.sent(now_ns);
    send(size);
  }

  if (scene_pipe_ != nullptr) {
    scene_pipe_->link_most_per_s.store(rate_.bulk_per_s(), std::memory_order_relaxed);
    if (scene_pipe_->turn(session_, socket_, server_, buffer_) > 0) rate_.bulk_sent(now_ns);
  }

  fill(now_ns, applied_h_n_, sample);
  ++ticks_;
}

/// A session at another scene than the station's, at a server that has several (one that was restarted begins in its
/// first): the station's own is asked for, once in each session. Until the answer there is no session for the station,
/// which so holds the tip and fades its force. If it is refused, the station begins there and stops.
bool StationLoop::waits_for_scene(std::int64_t now_ns) noexcept {
  const link::Welcome& welcome = session_.welcome();
  const std::uint64_t wanted = station_.scene_hash();
  if (session_.sessions() == sessions_begun_ || wanted == 0 || welcome.scene_hash == wanted) return false;
  if (welcome.scene_hash == leaves_for_scene_) return true;
  if (session_.sessions() != asked_for_scene_in_) {
    if (!session_.switch_scene(wanted, now_ns)) return false;
    asked_for_scene_in_ = session_.sessions();
  }
  return session_.scene_switching() == link::SceneSwitching::kAsked;
}

/// The time that lies between two positions of the hand. A hand that moves by the clock on the wall has moved
/// for longer than whole periods where the tick is late: taken for a period, an ordinary motion would look
/// too fast and trip. The tick after a late one is shorter than a period; it is taken for whole ones, because
/// a step of the encoder over a sliver of time would look fast as well.
double StationLoop::hand_interval_s(double dt_s) noexcept {
  if (clock_ == nullptr || !device_.info().moves_by_itself) return dt_s;
  const std::int64_t now_ns = clock_->now_ns();
  const double since_s = static_cast<double>(now_ns - last_read_ns_) * 1e-9;
  const bool first = last_read_ns_ == 0;
  last_read_ns_ = now_ns;
  return first || !(since_s > dt_s) ? dt_s : since_s;
}

/// What the rate learns from a datagram that has just been taken.
void StationLoop::on_event(link::ClientEvent event, std::int64_t came_ns) noexcept {
  // Another slave: perhaps another server, at the end of another way.
  if (event == link::ClientEvent::kWelcome && session_.epoch_changed()) rate_.reset();
  if (event == link::ClientEvent::kReply) {
    const link::LinkStats& stats = session_.stats();
    rate_.on_reply(
        came_ns, stats.samples() != rtt_samples_ ? stats.rtt_last_ns() : -1,
        {session_.reply().command_sequence, session_.reply().sequence, session_.reply().replies_left_out});
    rtt_samples_ = stats.samples();
  }
  if (session_.overtaken_reply() != nullptr) rate_.on_late_reply();
}

bool StationLoop::undo_marks(std::int64_t now_ns) noexcept {
  const bool can = session_.has_session() && (session_.welcome().feature_bits & link::kFeatureUndo) != 0;
  return can && undo_.ask(now_ns);
}

void StationLoop::note_datagram(std::int64_t came_ns) noexcept {
  const link::Incoming& in = session_.incoming();
  recording::DatagramRow& row = datagrams_[datagram_count_++];
  renew(row);
  row.tick = ticks_;
  row.came_ns = came_ns;
  row.type = static_cast<std::uint32_t>(in.type);
  row.drop = static_cast<std::uint32_t>(session_.last_drop());
  const link::StepReport* steps = nullptr;
  if (in.type == link::MessageType::kWelcome) {
    steps = &in.welcome.steps;
    row.epoch = in.welcome.epoch;
  }
  if (in.type == link::MessageType::kReply) {
    steps = &in.reply.steps;
    row.epoch = in.reply.epoch;
    row.sequence = in.reply.sequence;
    row.answers = in.reply.command_sequence;
    row.steps_before = in.reply.steps_before;
    row.left_out = in.reply.replies_left_out;
  }
  if (in.type == link::MessageType::kBye) row.break_reason = static_cast<std::uint32_t>(in.bye.reason);
  if (steps == nullptr) return;
  row.executed = steps->executed;
  row.state_hash = steps->state_hash;
  row.newest = steps->newest;
  row.break_step = steps->break_step;
  row.breaks = steps->breaks;
  row.break_reason = steps->break_reason;
}

void StationLoop::note_state_piece(const link::SnapshotPiece& piece) noexcept {
  static_assert(recording::StatePieceRow::kBytes == link::kSnapshotPieceBytes);
  recording::StatePieceRow& row = state_pieces_[state_piece_count_++];
  row.tick = ticks_;
  row.step = piece.step;
  row.state_hash = piece.state_hash;
  row.breaks = piece.breaks;
  row.snapshot = piece.snapshot;
  row.piece = piece.piece;
  row.total = piece.total;
  row.size = piece.size;
  row.data = piece.data;
}

void StationLoop::say_bye(link::ByeReason reason) noexcept {
  const std::size_t size = session_.make_bye(reason, buffer_);
  for (int i = 0; i < 3; ++i) send(size);
}

void StationLoop::fill(std::int64_t now_ns, const Vec3& applied_h_n, recording::Sample& sample) noexcept {
  using recording::xyz;
  const station::StationTrace& t = output_.trace;
  const link::Reply& shown = station_.reply();
  sample.tick = ticks_;
  sample.time_s = static_cast<double>(now_ns - start_ns_) * 1e-9;
  sample.hand_pos_h_m = xyz(t.hand_pos_h_m);
  sample.tip_target_w_nm = xyz(t.tip_target_pos_w_nm);
#define TELENANO_KEEP(column, unit, description, member) keep(shown.member, sample.column);
  TELENANO_REPLY_COLUMNS(TELENANO_KEEP)
#undef TELENANO_KEEP
  sample.hand_force_scaled_h_n = xyz(t.scaled_force_h_n);
  sample.hand_force_rendered_h_n = xyz(t.rendered_force_h_n);
  sample.hand_force_commanded_h_n = xyz(t.commanded_force_h_n);
  sample.hand_force_applied_h_n = xyz(applied_h_n);
  sample.damper_n_s_m = t.damper_n_s_m;
  sample.clamp_n = t.force_bound_n;
  sample.energy_j = t.energy_j;
  sample.energy_bound_j = t.quantisation_bound_j;
  sample.energy_in_j = t.energy_in_j;
  sample.energy_out_j = t.energy_out_j;
  sample.account_j = t.account_j;
  sample.velocity_scale = station_.config().scaling.velocity;
  sample.force_scale = station_.config().scaling.force;
  sample.station_mode = static_cast<std::uint32_t>(t.mode);
  sample.station_faults = t.faults;
  sample.buttons = input_.buttons;
  sample.method = static_cast<std::uint32_t>(t.method);
  sample.reply_sequence = static_cast<std::int64_t>(t.reply_sequence);
  sample.reply_age_ms = t.stale_s * 1e3;

  if (session_.has_reply()) {
    const link::Reply& reply = session_.reply();
    sample.slave_energy_in_aj = reply.energy_in_aj;
    sample.slave_energy_out_aj = reply.energy_out_aj;
    sample.measurement_age_ms = static_cast<double>(reply.measurement_age_ns) * 1e-6;
  }
  quality_ = session_.quality(now_ns);
  sample.rtt_us = quality_.rtt_last_us;
  sample.rtt_smoothed_us = quality_.rtt_us;
  sample.rtt_min_us = quality_.rtt_min_us;
  sample.jitter_us = quality_.jitter_us;
  sample.clock_offset_us = quality_.offset_us;
  sample.clock_drift_ppm = quality_.drift_ppm;
  sample.up_excess_us = quality_.up_excess_us;
  sample.down_excess_us = quality_.down_excess_us;
  sample.force_age_ms = quality_.force_age_ms;
  sample.commands_sent = static_cast<std::int64_t>(quality_.commands_sent);
  sample.commands_lost = static_cast<std::int64_t>(quality_.commands_lost);
  sample.playout_delay_ms = playout_.active() ? static_cast<double>(playout_.delay_ns()) * 1e-6 : 0;
  sample.playout_late = static_cast<std::int64_t>(playout_.counts().late);
  const link::SequenceWindow& replies = session_.replies();
  sample.lost = static_cast<std::int64_t>(replies.lost());
  sample.reordered = static_cast<std::int64_t>(replies.reordered());
  sample.duplicates = static_cast<std::int64_t>(replies.duplicate());
  sample.dropped = static_cast<std::int64_t>(session_.drops().total());

  using namespace recording;
  std::uint32_t flags = 0;
  if (t.damper_n_s_m > 0) flags |= kLimitDamper;
  if (t.clamped) flags |= kLimitClamp;
  if (t.limited) flags |= kLimitForce;
  if (t.slewed) flags |= kLimitSlew;
  if ((t.faults & (station::kFaultStale | station::kFaultOld)) != 0) flags |= kLimitStale;
  if ((t.faults & station::kFaultVelocityTrip) != 0) flags |= kLimitVelocity;
  if ((shown.fault_bits & link::kFaultWorkspace) != 0) flags |= kLimitWorkspace;
  if (t.ramp < 1) flags |= kLimitRamp;
  if (t.mode == station::Mode::kStopped) flags |= kLimitStop;
  if (t.observes) flags |= kLimitObserves;
  constexpr std::uint32_t kNonFinite = station::kFaultHandPosNonFinite | station::kFaultAppliedNonFinite |
                                       station::kFaultReplyNonFinite | station::kFaultForceNonFinite;
  if ((t.faults & kNonFinite) != 0) flags |= kLimitNonFinite;
  sample.limit_flags = flags;
}

}  // namespace telenano::loop
