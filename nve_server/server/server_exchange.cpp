#include <algorithm>

#include "telenano/nve_server/server/peer_key.h"
#include "telenano/nve_server/server/server.h"
#include "telenano/nve_server/server/session_features.h"

namespace telenano::server {

using link::DropCause;

namespace {

/// What was computed is true until the tip moves: it has no age. What was measured has grown older since.
std::uint64_t age_of_force_ns(const slave::SlaveOutput& output, std::int64_t since_step_ns) noexcept {
  if (output.measurement_age_ns == slave::kNeverMeasuredNs) return link::kNeverMeasuredNs;
  if (output.measurement_age_ns <= 0) return 0;
  return static_cast<std::uint64_t>(output.measurement_age_ns + std::max<std::int64_t>(since_step_ns, 0));
}

}  // namespace

std::size_t Server::on_command(const link::Command& command, const net::Address& from, std::int64_t now_ns,
                               std::span<std::uint8_t> out, const rt::Clock* clock) noexcept {
  std::size_t slot = link::SessionTable::kNone;
  const std::size_t of = table_.find(command.session_id);
  if (!within_rate(of, from, now_ns)) return drop(DropCause::kRateLimited);
  const bool logs = of != link::SessionTable::kNone && logs_steps(table_[of]);
  if (!logs && (incoming_.steps.count > 0 || command.control.method == link::kMethodTwin) &&
      of != link::SessionTable::kNone)
    return drop(DropCause::kUnexpected);
  const DropCause cause =
      table_.accept(command, peer_key(from), now_ns, slot, incoming_.recent.count > 0, standing_.identity);
  if (cause == DropCause::kStale && logs) take_overtaken_steps(slot, command, now_ns);
  if (cause != DropCause::kNone) return on_unusable_command(command, cause, slot, now_ns, out);

  link::Session& session = table_[slot];
  SessionRecord& record = records_[slot];
  note_address(slot, from, now_ns);
  const Tip& tip = tip_of(slot);
  const bool controls = (session.feature_bits & link::kFeaturePortControl) != 0;
  if (shared()) share_tip(slot, command, now_ns);
  const bool moves = !shared() || holder_.holds(slot);
  if (logs_steps(session)) {
    move_by_log(slot, command, now_ns);
  } else if (moves) {
    move_tip(slot, command, incoming_.recent, now_ns);
  } else if (controls) {
    record.control.observe(command.control);
  }

  const std::uint32_t undo_faults = undo(slot, command);

  link::Reply reply;
  reply.session_id = session.session_id;
  reply.command_sequence = command.sequence;
  reply.command_send_time_ns = command.send_time_ns;
  reply.epoch = session.epoch;
  reply.contact_state = tip.output.contact_state;
  reply.fault_bits = tip.output.fault_bits | undo_faults;
  reply.force_w_nn = tip.output.force_w_nn;
  reply.tip_pos_w_nm = tip.output.tip_pos_w_nm;
  reply.deflection_nm = tip.output.deflection_nm;
  reply.energy_in_aj = shared() ? record.account.in_aj() : tip.output.energy_in_aj;
  reply.energy_out_aj = shared() ? record.account.out_aj() : tip.output.energy_out_aj;
  if (controls) reply.port = record.control.answer();
  if (moves && wants_model(session, command)) reply.model = tip.output.model;
  if ((session.feature_bits & link::kFeatureStepHistory) != 0) reply.steps_before = session.steps_before;
  if ((session.feature_bits & link::kFeatureParticle) != 0) reply.particle = tip.output.particle;
  if (logs_steps(session)) reply.steps = step_report(slot);
  if (shared()) reply.tip = {moves ? holder_.number() : 0, tip.output.commanded_pos_w_nm};
  const std::int64_t sent_ns = clock != nullptr ? std::max(clock->now_ns(), now_ns) : now_ns;
  reply.server_time_ns = static_cast<std::uint64_t>(sent_ns);
  reply.hold_time_ns = static_cast<std::uint64_t>(sent_ns - now_ns);
  reply.measurement_age_ns = age_of_force_ns(tip.output, moves ? 0 : sent_ns - tip.last_step_ns);
  if (clock != nullptr) service_.add(sent_ns - now_ns);
  ++counters_.exchanges;
  if ((session.feature_bits & link::kFeatureReplyDeadband) != 0) {
    if (!record.replies.wants(reply, command, session.spacing_s)) {
      ++counters_.left_out;
      return 0;
    }
    reply.replies_left_out = record.replies.left_out();
  }
  reply.sequence = ++session.reply_sequence;
  session.peer_stats.on_reply(reply.sequence, sent_ns);
  return codec_.encode(reply, out);
}

/// A station that talks to a session which is gone, asleep or shutting down is told, so that it need not wait
/// for its own time-out.
std::size_t Server::on_unusable_command(const link::Command& command, DropCause cause, std::size_t slot,
                                        std::int64_t now_ns, std::span<std::uint8_t> out) noexcept {
  drops_.add(cause);
  link::ByeReason reason = link::ByeReason::kUnknownSession;
  if (cause == DropCause::kUnexpected && table_[slot].state == link::SlotState::kSilent) {
    reason = link::ByeReason::kIdle;
  } else if (cause == DropCause::kUnexpected && shutting_down_) {
    reason = link::ByeReason::kShuttingDown;
  } else if (cause != DropCause::kUnknownSession) {
    return 0;
  }
  if (command.session_id == 0 || !handshake_.may_answer(now_ns)) return 0;
  return codec_.encode(link::Bye{command.session_id, reason}, out);
}

/// Only its own station's commands count. One that is beyond is as lost as by the network.
bool Server::within_rate(std::size_t slot, const net::Address& from, std::int64_t now_ns) noexcept {
  if (config_.rate_slack <= 0 || slot == link::SessionTable::kNone) return true;
  const link::Session& session = table_[slot];
  const bool own = link::is_same_peer(session.peer, peer_key(from)) && session.owner == standing_.identity;
  return !own || records_[slot].commands.take(now_ns);
}

/// Where the station of this session is now.
void Server::note_address(std::size_t slot, const net::Address& from, std::int64_t now_ns) noexcept {
  const bool elsewhere = !(records_[slot].address == from);
  records_[slot].address = from;
  if (elsewhere) audit(AuditEvent::Kind::kMoved, slot, now_ns);
}

}  // namespace telenano::server
