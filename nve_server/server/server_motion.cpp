// How a session's commands and logged steps move its slave, and what of the server's work each may take.
#include <algorithm>
#include <cmath>

#include "telenano/nve_server/server/guarded_step.h"
#include "telenano/nve_server/server/server.h"
#include "telenano/nve_server/server/session_features.h"
#include "telenano/nve_server/slave/logged_step.h"

namespace telenano::server {
namespace {

/// Steps that one datagram, and one look of catch_up(), may execute of a log: catching up must not keep the
/// others waiting.
constexpr double kNoWorkBound = UINT32_MAX;
constexpr std::size_t kStepsPerLook = 64;
constexpr double kStepRingMost = 32768;  // 1.5 MB

}  // namespace

/// Makes room for the steps of a session: in a handshake, never within an exchange.
void Server::begin_log(std::size_t slot) noexcept {
  SessionRecord& record = records_[slot];
  if (!logs_steps(table_[slot])) {
    record.steps = {};
    return;
  }
  if (record.steps.enabled()) return;
  const double ring = config_.step_ring_s * table_[slot].rate_hz;
  try {
    record.steps = link::StepReceiver(static_cast<std::size_t>(std::clamp(ring, 64.0, kStepRingMost)));
    record.frozen.bytes.resize(
        std::min(tip_of(slot).slave->snapshot_bytes_max(), config_.snapshot_bytes_most));
  } catch (...) {  // out of memory: nothing moves the slave, the session stands still
    record.steps = {};
  }
}

link::StepReport Server::step_report(std::size_t slot) noexcept {
  link::StepReport report = records_[slot].steps.report();
  report.state_hash = tip_of(slot).slave->state_hash();
  return report;
}

/// Executes what has come to its turn, `most` steps at once: the rest when catch_up() comes by.
void Server::run_log(std::size_t slot, std::size_t most, std::int64_t now_ns) noexcept {
  SessionRecord& record = records_[slot];
  Tip& tip = tip_of(slot);
  if (record.steps.gap() &&
      1e-9 * static_cast<double>(now_ns - record.steps.gap_since_ns()) > config_.step_gap_s)
    record.steps.skip_to_newest(link::kBreakGap);
  // Each step is made whole, whatever it takes: both ends make the same. So what it takes is owed afterwards.
  double left = work_left(slot, now_ns);
  double taken = 0;
  // For their share, or since their sender's clock runs ahead.
  if (record.steps.waits() &&
      1e-9 * static_cast<double>(now_ns - record.steps.waits_since_ns()) > config_.step_gap_s) {
    record.steps.skip_to_newest(link::kBreakShare);
    left = std::max(left, 1.0);
  }
  const bool moves = !shared() || holder_.holds(slot);
  link::LoggedStep step;
  for (std::size_t i = 0; i < most && taken < left && record.steps.pop(now_ns, step); ++i) {
    if (!moves) continue;  // who observes has a log too, of steps that are none of the slave's
    link::Command command;
    command.control = record.last_control;
    command.flags = step.flags;
    command.tip_hold = step.hold;
    command.tip_pos_w_nm = link::target_w_nm(step);
    command.tip_vel_w_nm_s = (command.tip_pos_w_nm - tip.last_target_w_nm) / link::dt_s(step);
    taken += move_tip_once(slot, command, link::dt_s(step), record.operates, kNoWorkBound);
    tip.last_step_ns = tip.moved_ns = now_ns;
    tip.at_rest = false;
    last_flags_ = step.flags;
  }
  take_work(slot, taken);
  if (record.steps.waits() && !is_behind_[slot]) {
    is_behind_[slot] = true;
    behind_.push_back(slot);  // there is room for every slot
  }
}

/// One session after the other, so that what comes meanwhile waits for one session's part at most
/// (WorkBounds::a_datagram).
bool Server::catch_up(std::int64_t now_ns) noexcept {
  now_ns_ = now_ns;
  for (std::size_t tries = behind_.size(); tries > 0; --tries) {
    if (next_behind_ >= behind_.size()) next_behind_ = 0;
    const std::size_t slot = behind_[next_behind_];
    link::StepReceiver& steps = records_[slot].steps;
    const std::uint64_t before = steps.executed();
    if (table_[slot].state == link::SlotState::kActive && steps.waits() && tip_of(slot).slave)
      run_log(slot, kStepsPerLook, now_ns);
    const bool moved = steps.executed() != before;
    if (table_[slot].state == link::SlotState::kActive && steps.waits()) {
      ++next_behind_;
    } else {
      is_behind_[slot] = false;
      behind_[next_behind_] = behind_.back();
      behind_.pop_back();
    }
    if (moved) return true;
  }
  return false;
}

/// Found by its number, or in place of the one that nobody has used for longest.
Server::PartyWork& Server::party_work(std::size_t slot) noexcept {
  const std::uint64_t party = table_[slot].party;
  std::size_t& at = records_[slot].party;
  const auto is_it = [&](std::size_t i) {
    return parties_[i].used_ns != INT64_MIN && parties_[i].party == party;
  };
  if (at < parties_.size() && is_it(at)) return parties_[at];
  std::size_t oldest = 0;
  for (at = 0; at < parties_.size() && !is_it(at); ++at)
    if (parties_[at].used_ns < parties_[oldest].used_ns) oldest = at;
  if (at == parties_.size()) {
    at = oldest;
    parties_[at] = {party, 0, {}};
  }
  return parties_[at];
}

/// What the datagram at hand may take: 0 or less is nothing.
double Server::work_left(std::size_t slot, std::int64_t now_ns) noexcept {
  const WorkBounds& bounds = config_.work;
  if (!bounds.enforced) return kNoWorkBound;
  PartyWork& party = party_work(slot);
  if (party.used_ns < now_ns - kPartyActiveNs) ++active_parties_;  // until poll() counts again
  party.used_ns = now_ns;
  const double per_s =
      bounds.of_session(table_[slot].rate_hz, scene_of(slot).limits.balances_per_s, table_.active());
  const double of_session = records_[slot].work.left(now_ns, per_s, bounds);
  const double of_party = party.work.left(now_ns, bounds.of_party(active_parties_), bounds);
  return std::min({of_session, bounds.a_datagram, std::max(of_party, bounds.free_a_datagram)});
}

void Server::take_work(std::size_t slot, double work) noexcept {
  counters_.work += static_cast<std::uint64_t>(work);
  if (!config_.work.enforced) return;
  records_[slot].work.take(work);
  party_work(slot).work.take(std::max(0.0, work - config_.work.free_a_datagram));
}

/// A command of a session that logs its steps: only they move the tip. What takes motion away does not wait
/// for its turn: a stop leaves out what is missing before it, and without the right to operate no step moves.
void Server::move_by_log(std::size_t slot, const link::Command& command, std::int64_t now_ns) noexcept {
  SessionRecord& record = records_[slot];
  if (!record.steps.enabled()) return;
  record.last_control = command.control;
  const bool operates = standing_.rights >= net::Rights::kOperate;
  if (record.operates && !operates) record.steps.declare_break(link::kBreakRight);
  record.operates = operates;
  record.steps.take(incoming_.steps, now_ns, command.tip_hold);
  const bool stops =
      operates && (command.flags & link::kFlagStop) != 0 && is_anchored(slot, command.tip_hold);
  last_flags_ = 0;
  run_log(slot, config_.steps_at_once, now_ns);
  if (!stops) return;
  if (record.steps.executed() < record.steps.newest()) {
    record.steps.skip_to_newest(link::kBreakStop);
    run_log(slot, 1, now_ns);
  }
  if ((last_flags_ & link::kFlagStop) != 0) return;
  // No step says so, or none has come: the command alone stops the tip.
  Tip& tip = tip_of(slot);
  if ((tip.output.fault_bits & link::kFaultRetracted) == 0) record.steps.declare_break(link::kBreakStop);
  link::Command stop = command;
  stop.tip_pos_w_nm = tip.output.commanded_pos_w_nm;
  stop.tip_vel_w_nm_s.setZero();
  take_work(slot, move_tip_once(slot, stop, std::min(table_[slot].spacing_s, config_.step_max_s), true,
                                config_.work.enforced ? config_.work.a_stop : kNoWorkBound));
  tip.last_step_ns = tip.moved_ns = now_ns;
  tip.at_rest = false;
}

/// Of a command that a later one has overtaken only the steps count: a log does not depend on when they come. Where a path
/// jitters, what is sent again for a gap comes in any order, and most of it would be in vain.
void Server::take_overtaken_steps(std::size_t slot, const link::Command& command,
                                  std::int64_t now_ns) noexcept {
  SessionRecord& record = records_[slot];
  if (!record.steps.enabled() || incoming_.steps.count == 0) return;
  // A right that was taken away meanwhile is declared by the next command; until then nothing moves for this one.
  if (record.operates && standing_.rights < net::Rights::kOperate) return;
  record.steps.take(incoming_.steps, now_ns, command.tip_hold);
  run_log(slot, config_.steps_at_once, now_ns);
}

/// May this command have the shared tip? Who gets it finds it where it stands.
void Server::share_tip(std::size_t slot, const link::Command& command, std::int64_t now_ns) noexcept {
  const std::size_t before = holder_.holder();
  const bool taken = holder_.on_command(slot, standing_.rights, command.flags, now_ns);
  audit_holder(before, now_ns);
  if (!taken) return;
  ++counters_.holdings;
  begin_holding(slot);
  Tip& tip = tips_[0];
  if (tip.moved_by != slot && tip.moved_by != TipHolder::kNobody)
    records_[slot].account.take_over(tip.output);
  tip.moved_by = slot;
}

/// Does what belongs to this holding move the tip? Who has just got a shared one must first have taken up its
/// position.
bool Server::is_anchored(std::size_t slot, std::uint32_t hold) const noexcept {
  return !shared() || (holder_.holds(slot) && hold == holder_.number());
}

/// The shared tip is this session's from here on, and in a state that its log does not say.
void Server::begin_holding(std::size_t slot) noexcept {
  if (records_[slot].steps.enabled()) records_[slot].steps.declare_break(link::kBreakHolder);
}

/// Steps the tip by a command of a session that may do so.
double Server::move_tip_once(std::size_t slot, const link::Command& command, double spacing_s,
                             bool may_operate, double work_most) noexcept {
  const link::Session& session = table_[slot];
  Tip& tip = tip_of(slot);
  SessionRecord& record = records_[slot];
  const bool anchored = is_anchored(slot, command.tip_hold);
  const bool operates = may_operate && anchored;
  const bool was_up = (tip.output.fault_bits & link::kFaultRetracted) != 0;
  slave::SlaveInput input =
      slave::input_of(command.tip_pos_w_nm, command.tip_vel_w_nm_s, command.flags, operates, was_up);
  input.opening = record.opening;
  input.work_most = static_cast<std::uint32_t>(std::clamp(work_most, 1.0, kNoWorkBound));
  input.wants_model = wants_model(session, command);
  const bool controls = (session.feature_bits & link::kFeaturePortControl) != 0;
  const double dt_s = std::clamp(spacing_s, kStepMinS, config_.step_max_s);
  const slave::SlaveOutput last = tip.output;
  // Of a shared slave's account the port's control sees this session's part.
  const PortAccount before = record.account;
  if (controls && anchored) input = record.control.before(command, input, last, tip.slave->limits(), dt_s);
  if (controls && !anchored) record.control.observe(command.control);
  step_guarded(*tip.slave, input, dt_s, last, tip.output);
  if (shared() && anchored && was_up && (tip.output.fault_bits & link::kFaultRetracted) == 0) {
    holder_.renew();
    begin_holding(slot);
  }
  if (shared()) record.account.add(last, tip.output);
  if (controls && anchored) {
    if (shared()) {
      record.control.after(before.seen(last), record.account.seen(tip.output), dt_s);
    } else {
      record.control.after(last, tip.output, dt_s);
    }
  }
  tip.last_target_w_nm = command.tip_pos_w_nm;
  if ((tip.output.fault_bits & link::kFaultShare) != 0) ++counters_.cut;
  audit_faults(slot, tip.output.fault_bits & ~last.fault_bits, now_ns_);
  return tip.output.work;
}

/// Of a shared tip the marks are many people's: who operates takes back what it made itself, and nothing that
/// another has marked since; who administers, whatever was marked last.
std::uint32_t Server::undo(std::size_t slot, const link::Command& command) noexcept {
  if ((table_[slot].feature_bits & link::kFeatureUndo) == 0) return 0;
  SessionRecord& record = records_[slot];
  const bool asks = (command.flags & link::kFlagUndo) != 0;
  const bool begins = asks && !record.undo_asked;
  record.undo_asked = asks;
  if (!asks) record.undo_faults = 0;
  if (!begins) return record.undo_faults;
  Tip& tip = tip_of(slot);
  const slave::SlaveOutput last = tip.output;
  const bool may = standing_.rights >= net::Rights::kOperate && is_anchored(slot, command.tip_hold) &&
                   (last.fault_bits & link::kFaultRetracted) == 0;
  const bool own = shared() && standing_.rights < net::Rights::kAdminister;
  const auto result =
      may ? tip.slave->undo_marks(own ? record.opening : 0, tip.output) : slave::UndoResult::kTouches;
  if (result != slave::UndoResult::kDone) {
    record.undo_faults = link::kFaultUndo;
    if (result == slave::UndoResult::kAnothers) record.undo_faults |= link::kFaultUndoAnothers;
    return record.undo_faults;
  }
  if (shared()) record.account.add(last, tip.output);
  if (record.steps.enabled()) record.steps.declare_break(link::kBreakUndo);
  ++counters_.undone;
  return 0;
}

/// Beyond the session's share, and where a newer command waits, a command moves nothing: its place is in the
/// newer one's, its time and its energies are added to that. Only a stop never waits.
void Server::move_tip(std::size_t slot, const link::Command& command, const link::RecentCommands& recent,
                      std::int64_t now_ns) noexcept {
  const link::Session& session = table_[slot];
  Tip& tip = tip_of(slot);
  const bool operates = standing_.rights >= net::Rights::kOperate;
  SessionRecord& record = records_[slot];
  double left = work_left(slot, now_ns);
  if (superseded_ && command.flags == record.command_flags) left = 0;
  record.command_flags = command.flags;
  double taken = 0;
  bool moved = false;
  const auto follow = [&](const link::Command& next, double next_spacing_s) {
    double most = left - taken;
    if ((next.flags & link::kFlagStop) != 0) most = std::max(most, config_.work.a_stop);
    if (most <= 0) {
      record.behind_s += next_spacing_s;
      return;
    }
    taken += move_tip_once(slot, next, next_spacing_s + record.behind_s, operates, most);
    record.behind_s = 0;
    moved = true;
  };
  double spacing_s = session.spacing_s;
  if (recent.count > 0 && session.missed > 0) {
    link::MissedSteps plan;
    link::plan_steps(recent, session.missed, session.spacing_s, 1.0 / session.rate_hz, plan);
    for (std::size_t i = 0; i < plan.count; ++i) {
      const link::MissedSteps::Step& step = plan.step[i];
      const Vec3 vel_w_nm_s = (step.command.tip_pos_w_nm - tip.last_target_w_nm) / step.spacing_s;
      follow(link::with_recent(command, step.command, vel_w_nm_s), step.spacing_s);
    }
    counters_.recovered += plan.count;
    spacing_s = plan.last_spacing_s;
  }
  follow(command, spacing_s);
  take_work(slot, taken);
  if (record.behind_s > 0) {
    tip.output.fault_bits |= link::kFaultShare;
    ++counters_.deferred;
  }
  if (!moved) return;
  tip.last_step_ns = tip.moved_ns = now_ns;
  tip.at_rest = false;
}

}  // namespace telenano::server
