#include <algorithm>
#include <utility>

#include "telenano/nve_server/server/guarded_step.h"
#include "telenano/nve_server/server/server.h"

namespace telenano::server {

namespace {

/// A slave that has not moved for so long on its way up has arrived: it may have a rate of its own.
constexpr std::int64_t kRestNs = 50'000'000;

}  // namespace

void Server::poll(std::int64_t now_ns) noexcept {
  now_ns_ = now_ns;
  table_.expire(now_ns, [&](std::size_t slot, link::SlotState state) {
    leave_tip(slot, now_ns);
    if (state == link::SlotState::kSilent) {
      ++counters_.timed_out;
      audit(AuditEvent::Kind::kTimedOut, slot, now_ns);
      if (!shared()) tips_[slot].last_step_ns = now_ns;
      if (records_[slot].steps.enabled()) records_[slot].steps.declare_break(link::kBreakSilence);
    }
    if (state == link::SlotState::kFree) forget(slot, now_ns);
  });
  active_parties_ =
      static_cast<std::size_t>(std::count_if(parties_.begin(), parties_.end(), [&](const PartyWork& p) {
        return p.used_ns >= now_ns - kPartyActiveNs;
      }));
  for (std::size_t n = behind_.size(); n > 0 && catch_up(now_ns); --n) {
  }
  if (shared()) return withdraw_shared_tip(now_ns);
  if (table_.occupied() == table_.active()) return;  // nobody leaves
  for (std::size_t slot = 0; slot < tips_.size(); ++slot) {
    const link::Session& session = table_[slot];
    const bool leaving =
        session.state == link::SlotState::kSilent || session.state == link::SlotState::kEnding;
    if (leaving && tips_[slot].slave && now_ns - session.state_since_ns <= table_.config().ending_ns) {
      retract(tips_[slot], &records_[slot].control, now_ns);
    }
  }
}

void Server::retract(Tip& tip, PortControl* control, std::int64_t now_ns) noexcept {
  slave::SlaveInput input;
  input.follow = false;
  input.retract = true;
  if (config_.work.enforced) input.work_most = static_cast<std::uint32_t>(config_.work.a_datagram);
  input.tip_target_pos_w_nm = tip.output.commanded_pos_w_nm;
  const double dt_s =
      std::clamp(1e-9 * static_cast<double>(now_ns - tip.last_step_ns), kStepMinS, config_.step_max_s);
  const slave::SlaveOutput last = tip.output;
  step_guarded(*tip.slave, input, dt_s, last, tip.output);
  if (control != nullptr) control->after(last, tip.output, dt_s);
  tip.last_step_ns = now_ns;
  const bool stuck = (tip.output.fault_bits & link::kFaultNoEquilibrium) != 0;
  if (stuck || tip.output.commanded_pos_w_nm != last.commanded_pos_w_nm) tip.moved_ns = now_ns;
  tip.at_rest = now_ns - tip.moved_ns >= kRestNs;
}

void Server::withdraw_shared_tip(std::int64_t now_ns) noexcept {
  const bool was_withdrawing = std::exchange(
      withdrawing_, holder_.must_withdraw(now_ns, shutting_down_ ? 0 : table_.config().timeout_ns));
  if (!withdrawing_) return;
  Tip& tip = tips_[0];
  if (!was_withdrawing)
    tip.last_step_ns = tip.moved_ns = now_ns;  // not all at once what was not moved until now
  retract(tip, nullptr, now_ns);               // nobody's energy
  if (tip.at_rest) holder_.withdrawn();
}

bool Server::at_rest() const noexcept {
  return std::all_of(tips_.begin(), tips_.end(), [](const Tip& tip) { return !tip.slave || tip.at_rest; });
}

}  // namespace telenano::server
