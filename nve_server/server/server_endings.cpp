#include <cstdint>

#include "telenano/nve_server/server/peer_key.h"
#include "telenano/nve_server/server/server.h"

namespace telenano::server {

using link::DropCause;

namespace {

/// Who moved a shared tip last is no longer known: nobody who comes.
constexpr std::size_t kForgotten = SIZE_MAX - 1;

}  // namespace

void Server::on_bye(const link::Bye& bye, const net::Address& from, std::int64_t now_ns) noexcept {
  const std::size_t slot = table_.find(bye.session_id);
  if (slot == link::SessionTable::kNone) {
    drops_.add(DropCause::kUnknownSession);
  } else if (!link::is_same_peer(table_[slot].peer, peer_key(from)) ||
             table_[slot].owner != standing_.identity) {
    drops_.add(DropCause::kUnauthenticated);
  } else if (table_[slot].state == link::SlotState::kEnding) {
    drops_.add(DropCause::kDuplicate);  // Byes are sent more than once
  } else {
    end(slot, bye.reason, now_ns);
    ++counters_.ended;
  }
}

void Server::end(std::size_t slot, link::ByeReason reason, std::int64_t now_ns) noexcept {
  leave_tip(slot, now_ns);
  audit(AuditEvent::Kind::kEnded, slot, now_ns, static_cast<std::uint32_t>(reason));
  records_[slot].open = false;
  table_.end(slot, now_ns);
}

void Server::leave_tip(std::size_t slot, std::int64_t now_ns) noexcept {
  const std::size_t before = holder_.holder();
  holder_.leave(slot, now_ns);
  audit_holder(before, now_ns);
}

/// Nothing is left of the session in this slot.
void Server::forget(std::size_t slot, std::int64_t now_ns) noexcept {
  leave_tip(slot, now_ns);
  if (records_[slot].open) audit(AuditEvent::Kind::kForgotten, slot, now_ns);
  records_[slot] = {};
  if (!shared()) {
    tips_[slot] = {};
  } else if (tips_[0].moved_by == slot) {
    tips_[0].moved_by = kForgotten;
  }
}

std::size_t Server::next_bye(std::int64_t now_ns, std::span<std::uint8_t> out, net::Address& to) noexcept {
  shutting_down_ = true;
  for (std::size_t slot = 0; slot < records_.size(); ++slot) {
    if (table_[slot].state != link::SlotState::kActive) continue;
    end(slot, link::ByeReason::kShuttingDown, now_ns);
    to = records_[slot].address;
    return codec_.encode(link::Bye{table_[slot].session_id, link::ByeReason::kShuttingDown}, out);
  }
  return 0;
}

}  // namespace telenano::server
