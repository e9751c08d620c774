// Checkpoints of sessions: what the loop gives to who keeps them, and how a session of another server goes on
// here. The energy that a station is told is a sum of the epoch, and it believes the highest: a session that is
// taken up as it was some time ago says less than before, and what had been given since is not given again.
#include <utility>

#include "telenano/nve_server/server/checkpoint.h"
#include "telenano/nve_server/server/server.h"

namespace telenano::server {
namespace {

using link::SlotState;

/// Written in one look at the time-outs: what a state takes of the loop's time goes with its size, also where it
/// is mostly a search for marks.
constexpr std::size_t kBytesPerLook = 65536;
/// A state that is let go without being written again may be as old as this: who takes it up counts its age, and gives
/// it up after --resume-s.
constexpr std::int64_t kFreshNs = 5'000'000'000;

bool is_kept(const link::Session& session) noexcept {
  return session.used && (session.state == SlotState::kActive || session.state == SlotState::kSilent);
}

}  // namespace

/// The size of the buffer that it went with; 0: it could not be posted now.
std::size_t Server::post_checkpoint(std::size_t slot, CheckpointNote::Kind kind,
                                    std::int64_t now_ns) noexcept {
  CheckpointQueue& queue = *config_.checkpoints;
  const std::span<std::uint8_t> out = queue.next_buffer();
  if (out.empty()) return 0;
  SessionRecord& record = records_[slot];
  CheckpointNote note;
  note.kind = kind;
  note.size = write_checkpoint({scene_of(slot).scene.hash, scene_of(slot).scene.physics}, table_[slot],
                               tips_[slot], record, out);
  note.token = table_[slot].resume_token;
  note.owner = table_[slot].owner;
  note.number = record.checkpoints + 1;
  if (note.size == 0 || !queue.post_state(note)) return 0;
  ++record.checkpoints;
  record.token = note.token;
  record.owner = note.owner;
  record.changed = false;
  record.checked_ns = now_ns;
  return out.size();
}

void Server::write_checkpoints(std::int64_t now_ns) noexcept {
  if (config_.checkpoints == nullptr || shutting_down_) return;
  std::size_t bytes = 0;
  for (std::size_t looked = 0; looked < table_.capacity() && bytes < kBytesPerLook; ++looked) {
    const SessionRecord& record = records_[next_checkpoint_];
    const bool due = record.changed && is_kept(table_[next_checkpoint_]) &&
                     (record.token == 0 || now_ns - record.checked_ns >= config_.checkpoint_period_ns);
    if (due) {
      const std::size_t size = post_checkpoint(next_checkpoint_, CheckpointNote::Kind::kState, now_ns);
      if (size == 0) return;
      bytes += size;
    }
    next_checkpoint_ = (next_checkpoint_ + 1) % table_.capacity();
  }
}

/// Those that are left to others are not ended by it.
void Server::end_checkpoints(SessionRecord& record) noexcept {
  if (record.token == 0 || shutting_down_ || config_.checkpoints == nullptr) return;
  CheckpointNote note;
  note.kind = CheckpointNote::Kind::kEnded;
  note.token = std::exchange(record.token, 0);
  note.owner = record.owner;
  note.number = record.checkpoints + 1;
  config_.checkpoints->post(note);
}

/// As it was written last, it is the next one's. False: no room for the note.
bool Server::post_give_back(SessionRecord& record) noexcept {
  CheckpointNote note;
  note.kind = CheckpointNote::Kind::kGiveBack;
  note.token = record.token;
  note.owner = record.owner;
  note.number = record.checkpoints + 1;
  if (!config_.checkpoints->post(note)) return false;
  ++record.checkpoints;
  return true;
}

/// A session that has not moved since its last state was written needs no new one: of thousands at 1 Hz that is most.
bool Server::post_hand_out(std::size_t slot, std::int64_t now_ns) noexcept {
  SessionRecord& record = records_[slot];
  if (record.token == 0 || record.changed || now_ns - record.checked_ns > kFreshNs)
    return post_checkpoint(slot, CheckpointNote::Kind::kHandOut, now_ns) != 0;
  return post_give_back(record);
}

bool Server::hand_out(std::int64_t now_ns) noexcept {
  if (config_.checkpoints == nullptr) return true;
  shutting_down_ = true;
  for (; next_hand_out_ < table_.capacity(); ++next_hand_out_) {
    if (!is_kept(table_[next_hand_out_]) || !tips_[next_hand_out_].slave) continue;
    if (!post_hand_out(next_hand_out_, now_ns)) return false;
    // Its tip is another server's from now on, and is not withdrawn here.
    tips_[next_hand_out_] = {};
    ++counters_.handed_out;
  }
  return config_.checkpoints->idle();
}

std::size_t Server::next_handed_bye(std::int64_t now_ns, std::span<std::uint8_t> out,
                                    net::Address& to) noexcept {
  if (config_.checkpoints == nullptr || !config_.checkpoints->idle()) return 0;
  for (; next_handed_bye_ < next_hand_out_; ++next_handed_bye_) {
    const std::size_t slot = next_handed_bye_;
    if (table_[slot].state != SlotState::kActive || tips_[slot].slave) continue;
    end(slot, link::ByeReason::kShuttingDown, now_ns);
    to = records_[slot].address;
    return codec_.encode(link::Bye{table_[slot].session_id, link::ByeReason::kShuttingDown}, out);
  }
  return 0;
}

/// A session of another server, silent until its Hello, which waits for it, resumes it.
void Server::restore(SessionState& state, std::uint32_t ticket) noexcept {
  const TokenSearch::Question* const question = search_.find(ticket);
  const net::Address from = question != nullptr ? question->from : net::Address{};
  state.session.party = party_of(from, state.session.owner);
  state.session.state_since_ns = state.session.last_heard_ns = now_ns_;
  state.tip.last_step_ns = state.tip.moved_ns = now_ns_;
  SessionRecord& record = state.record;
  record.opening = ++counters_.opened;
  if (config_.mail != nullptr)
    record.opening = (record.opening - 1) * config_.mail->workers() + config_.worker + 1;
  record.changed = true;
  record.checked_ns = now_ns_;
  record.token = state.session.resume_token;
  record.owner = state.session.owner;
  if (!shutting_down_ && adopt(state)) {
    ++counters_.taken_up;
  } else if (config_.checkpoints != nullptr) {
    post_give_back(record);
  }
}

/// Taken up, but other workers had the last places under the cap meanwhile: its station asks elsewhere next.
void Server::give_back(std::uint64_t token, std::uint64_t owner) noexcept {
  const std::size_t slot = table_.find_token(token, owner);
  if (slot == link::SessionTable::kNone || !records_[slot].restored || config_.checkpoints == nullptr) return;
  if (!post_give_back(records_[slot])) return;
  records_[slot].token = 0;
  forget(slot, now_ns_);
  table_.release(slot);
}

/// Its station is told that there is no such session, and asks again.
void Server::let_go(const HandoffMessage& message) noexcept {
  const std::size_t slot = table_.find_token(message.token, message.owner);
  if (slot == link::SessionTable::kNone) return;
  records_[slot].token = 0;
  forget(slot, now_ns_);
  table_.release(slot);
  settle_cap();
}

}  // namespace telenano::server
