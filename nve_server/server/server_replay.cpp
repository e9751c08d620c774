#include "telenano/nve_server/server/server.h"

// For who replays a session: its log comes from a recording, not from datagrams of the size of a network's.

namespace telenano::server {

/// The slot of a session that logs its steps; kNone: there is none.
std::size_t Server::logging_slot(std::uint64_t session_id) noexcept {
  const std::size_t slot = table_.find(session_id);
  const bool logs = slot != link::SessionTable::kNone && records_[slot].steps.enabled() && tip_of(slot).slave;
  return logs ? slot : link::SessionTable::kNone;
}

void Server::bring_steps(std::uint64_t session_id, const link::StepBatch& steps, std::int64_t now_ns,
                         std::uint32_t hold) noexcept {
  const std::size_t slot = logging_slot(session_id);
  if (slot != link::SessionTable::kNone) records_[slot].steps.take(steps, now_ns, hold);
}

void Server::hold_tip(std::uint64_t session_id, std::int64_t now_ns) noexcept {
  const std::size_t slot = logging_slot(session_id);
  if (slot == link::SessionTable::kNone || !shared()) return;
  if (holder_.on_command(slot, net::Rights::kOperate, 0, now_ns)) tips_[0].moved_by = slot;
}

void Server::make_steps(std::uint64_t session_id, std::size_t most, std::int64_t now_ns) noexcept {
  const std::size_t slot = logging_slot(session_id);
  if (slot != link::SessionTable::kNone) run_log(slot, most, now_ns);
}

bool Server::take_up(std::uint64_t session_id, std::span<const std::uint8_t> state,
                     const link::StepReport& log, const link::LoggedStep* last, bool others) noexcept {
  const std::size_t slot = logging_slot(session_id);
  if (slot == link::SessionTable::kNone) return false;
  Tip& tip = tip_of(slot);
  if (!tip.slave->load(state) || tip.slave->state_hash() != log.state_hash ||
      !tip.slave->say_again(tip.output))
    return false;
  tip.last_target_w_nm = last != nullptr ? link::target_w_nm(*last) : tip.output.commanded_pos_w_nm;
  tip.at_rest = false;
  records_[slot].steps.go_on_after(log);
  if (others) records_[slot].account.take_over(tip.output);
  return true;
}

void Server::set_account(std::uint64_t session_id, double in_aj, double out_aj) noexcept {
  const std::size_t slot = logging_slot(session_id);
  if (slot != link::SessionTable::kNone) records_[slot].account.set(in_aj, out_aj);
}

}  // namespace telenano::server
