// A server that is one of several. The kernel gives each peer's datagrams to one worker, by its address; so a
// station that comes back from another address may find another worker. Its session then moves there, once,
// and is served there from then on: nothing is forwarded, and an exchange never looks beyond its worker.
#include <new>
#include <utility>

#include "telenano/nve_server/server/server.h"

namespace telenano::server {

using link::SlotState;

void Server::settle_cap() noexcept {
  if (config_.cap == nullptr) return;
  const auto active = static_cast<std::int64_t>(table_.active());
  config_.cap->give_back(cap_held_ - active);
  cap_held_ = active;
}

/// Where it cannot be sent, it stays, and no answer goes: the station asks again.
void Server::hand_over(std::size_t slot, const HandoffMessage& question) noexcept {
  SessionState* const state =
      new (std::nothrow) SessionState{table_[slot], std::move(tips_[slot]), std::move(records_[slot])};
  if (state == nullptr) return;
  HandoffMessage message;
  message.kind = HandoffMessage::Kind::kState;
  message.from = static_cast<std::uint32_t>(config_.worker);
  message.ticket = question.ticket;
  message.state = state;
  if (!config_.mail->post(question.from, message)) {
    tips_[slot] = std::move(state->tip);
    records_[slot] = std::move(state->record);
    delete state;
    return;
  }
  // From here on the state is the other worker's; its place under the cap goes with it.
  if (table_[slot].state == SlotState::kActive) --cap_held_;
  table_.release(slot);
  tips_[slot] = {};
  records_[slot] = {};
  ++counters_.moved_out;
}

bool Server::adopt(SessionState& state) noexcept {
  if (state.session.state == SlotState::kActive) ++cap_held_;
  const std::size_t slot = table_.adopt(state.session);
  // With a cap there is a place, as at most as many sessions are active as each worker has slots; but silent
  // ones of a greater right may hold all of them, and do not give way.
  if (slot != link::SessionTable::kNone) {
    tips_[slot] = std::move(state.tip);
    records_[slot] = std::move(state.record);
  }
  settle_cap();
  return slot != link::SessionTable::kNone;
}

void Server::exchange_mail() noexcept {
  if (!search_.has_others()) return;
  HandoffMessage message;
  while (config_.mail->fetch(config_.worker, message)) {
    switch (message.kind) {
      case HandoffMessage::Kind::kAsk: {
        const std::size_t slot = table_.find_token(message.token, message.owner);
        if (slot != link::SessionTable::kNone) {
          hand_over(slot, message);
          break;
        }
        HandoffMessage answer;
        answer.kind = HandoffMessage::Kind::kNotHere;
        answer.from = static_cast<std::uint32_t>(config_.worker);
        answer.ticket = message.ticket;
        config_.mail->post(message.from, answer);
        break;
      }
      case HandoffMessage::Kind::kNotHere:
        search_.on_answer(message.ticket, false);
        break;
      case HandoffMessage::Kind::kState:
        // Also one that nobody waits for any more: the station's next Hello finds it here.
        adopt(*message.state);
        ++counters_.moved_in;
        delete message.state;
        search_.on_answer(message.ticket, true);
        break;
    }
  }
}

std::size_t Server::next_answer(std::int64_t now_ns, std::span<std::uint8_t> out, net::Address& to) noexcept {
  TokenSearch::Question question;
  clock_ = nullptr;  // there is no datagram at hand
  while (search_.take_answered(question)) {
    net::Standing standing = question.standing;
    standing.address_proven = true;  // before it was asked
    const std::size_t n = on_hello(question.hello, question.from, now_ns, out, standing, false);
    to = question.from;
    if (n > 0) return n;
  }
  return 0;
}

}  // namespace telenano::server
