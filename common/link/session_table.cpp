#include "telenano/common/link/session_table.h"

#include <algorithm>

#include "proto/wire_fields.h"
namespace telenano::link {
namespace {

/// Counts for its party.
bool is_held(SlotState state) noexcept {
  return state == SlotState::kActive || state == SlotState::kSilent;
}

}  // namespace

SessionTable::SessionTable(const SessionTableConfig& config, const SipKey& secret) : config_(config) {
  const std::uint64_t labels[] = {3, 4, 5};
  secret_ = {siphash_words(secret, {labels, 1}), siphash_words(secret, {labels + 1, 1})};
  // A restarted server starts somewhere else, so that a station notices that the slave is a new one.
  next_epoch_ = static_cast<std::uint32_t>(siphash_words(secret, {labels + 2, 1}));
  config_.capacity = std::clamp<std::size_t>(config.capacity, 1, kCapacityMax);
  sessions_.resize(config_.capacity);
  slot_mask_ = (sessions_.size() > 256 ? kCapacityMax : 256) - 1;
}

std::uint64_t SessionTable::secret_number() noexcept {
  for (;;) {
    const std::uint64_t word = ++counter_;
    const std::uint64_t number = siphash_words(secret_, {&word, 1});
    if (number > slot_mask_) return number;
  }
}

void SessionTable::set_state(std::size_t slot, SlotState state) noexcept {
  SlotState& now = sessions_[slot].state;
  if (now == SlotState::kActive) --active_;
  if (now != SlotState::kFree) --occupied_;
  now = state;
  if (now == SlotState::kActive) ++active_;
  if (now != SlotState::kFree) ++occupied_;
}

void SessionTable::replace(std::size_t slot, const Session& session) noexcept {
  set_state(slot, session.state);
  sessions_[slot] = session;
}

std::size_t SessionTable::find(std::uint64_t session_id) const noexcept {
  const std::size_t slot = session_id & slot_mask_;
  if (slot >= sessions_.size() || session_id == 0 || sessions_[slot].session_id != session_id) return kNone;
  return slot;
}

std::size_t SessionTable::find_token(std::uint64_t resume_token, std::uint64_t owner) const noexcept {
  if (resume_token == 0) return kNone;
  for (std::size_t slot = 0; slot < sessions_.size(); ++slot) {
    const Session& s = sessions_[slot];
    const bool resumable = s.state == SlotState::kActive || s.state == SlotState::kSilent;
    if (resumable && s.resume_token == resume_token && s.owner == owner) return slot;
  }
  return kNone;
}

std::size_t SessionTable::find_nonce(const PeerKey& peer, std::uint64_t nonce, bool& newest) const noexcept {
  for (std::size_t slot = 0; slot < sessions_.size(); ++slot) {
    const Session& s = sessions_[slot];
    if (s.state == SlotState::kFree || !is_same_peer(s.peer, peer)) continue;
    const auto it = std::find(s.nonces.begin(), s.nonces.end(), nonce);
    if (it == s.nonces.end()) continue;
    newest = it == s.nonces.begin();
    return slot;
  }
  return kNone;
}

void SessionTable::start(std::size_t slot, const PeerKey& peer, std::uint64_t nonce, std::uint32_t rate_hz,
                         std::int64_t now_ns) noexcept {
  Session& session = sessions_[slot];
  // Without a pause its slave has not withdrawn, and must not stand in the sample for longer than otherwise.
  session.awaits_first = session.awaits_first || session.state != SlotState::kActive;
  set_state(slot, SlotState::kActive);
  session.session_id = (secret_number() & ~slot_mask_) | slot;
  session.rate_hz = std::max<std::uint32_t>(rate_hz, 1);
  session.peer = peer;
  std::shift_right(session.nonces.begin(), session.nonces.end(), 1);
  session.nonces[0] = nonce;
  session.commands.reset();
  session.last_send_time_ns = 0;
  session.reply_sequence = 0;
  session.newest_reply = 0;
  session.last_heard_ns = session.state_since_ns = now_ns;
  session.station_energy.reset();
  session.peer_stats.reset();
  session.missed = 0;
  session.steps_before = 0;
}

std::size_t SessionTable::place(std::uint8_t rank) const noexcept {
  std::size_t best = kNone;
  // Nothing is lost with one that is ending but the end of its way up.
  const auto before = [](const Session& a, const Session& b) {
    const auto worth = [](const Session& s) { return s.state == SlotState::kEnding ? 0 : 1 + s.rank; };
    return worth(a) != worth(b) ? worth(a) < worth(b) : a.state_since_ns < b.state_since_ns;
  };
  for (std::size_t slot = 0; slot < sessions_.size(); ++slot) {
    const Session& s = sessions_[slot];
    if (s.state == SlotState::kFree) return slot;
    if (s.state == SlotState::kActive || (s.state == SlotState::kSilent && s.rank > rank)) continue;
    if (best == kNone || before(s, sessions_[best])) best = slot;
  }
  return best;
}

std::size_t SessionTable::oldest_silent_of(std::uint64_t party) const noexcept {
  std::size_t best = kNone;
  for (std::size_t slot = 0; slot < sessions_.size(); ++slot) {
    const Session& s = sessions_[slot];
    if (s.state != SlotState::kSilent || s.party != party) continue;
    if (best == kNone || s.state_since_ns < sessions_[best].state_since_ns) best = slot;
  }
  return best;
}

bool SessionTable::party_is_full(std::uint64_t party) const noexcept {
  if (config_.per_party == SessionTableConfig::kCapacityAny) return false;
  const auto held = std::count_if(sessions_.begin(), sessions_.end(),
                                  [&](const Session& s) { return is_held(s.state) && s.party == party; });
  return static_cast<std::size_t>(held) >= config_.per_party;
}

bool SessionTable::has_room(const Opener& opener) const noexcept {
  if (party_is_full(opener.party)) return oldest_silent_of(opener.party) != kNone;
  return place(opener.rank) != kNone;
}

std::size_t SessionTable::open(const PeerKey& peer, std::uint64_t nonce, std::uint32_t rate_hz,
                               std::int64_t now_ns, const Opener& opener) noexcept {
  const bool one_for_one = party_is_full(opener.party);
  const std::size_t best = one_for_one ? oldest_silent_of(opener.party) : place(opener.rank);
  if (best == kNone) return kNone;
  release(best);
  Session& session = sessions_[best];
  session.owner = opener.owner;
  session.party = opener.party;
  session.rank = opener.rank;
  session.resume_token = secret_number();
  session.epoch = new_epoch();
  start(best, peer, nonce, rate_hz, now_ns);
  return best;
}

void SessionTable::resume(std::size_t slot, const PeerKey& peer, std::uint64_t nonce, std::uint32_t rate_hz,
                          std::int64_t now_ns) noexcept {
  start(slot, peer, nonce, rate_hz, now_ns);
}

std::uint32_t SessionTable::new_epoch() noexcept {
  if (next_epoch_ == 0) ++next_epoch_;  // 0 is "none"
  return next_epoch_++;
}

void SessionTable::begin_anew(std::size_t slot, std::uint64_t nonce, std::int64_t now_ns) noexcept {
  Session& session = sessions_[slot];
  session.epoch = new_epoch();
  session.awaits_first = true;
  start(slot, PeerKey(session.peer), nonce, session.rate_hz, now_ns);
}

void SessionTable::end(std::size_t slot, std::int64_t now_ns) noexcept {
  set_state(slot, SlotState::kEnding);
  sessions_[slot].state_since_ns = now_ns;
}

DropCause SessionTable::accept(const Command& command, const PeerKey& peer, std::int64_t now_ns,
                               std::size_t& slot, bool repeats_others, std::uint64_t owner) noexcept {
  slot = find(command.session_id);
  if (slot == kNone) return DropCause::kUnknownSession;
  Session& s = sessions_[slot];
  if (!is_same_peer(s.peer, peer) || s.owner != owner) return DropCause::kUnauthenticated;
  if (s.state != SlotState::kActive) return DropCause::kUnexpected;
  if (command.epoch != s.epoch) return DropCause::kWrongEpoch;
  if (command.newest_reply > s.reply_sequence) return DropCause::kOutOfRange;
  if ((features_used(command) & ~s.feature_bits) != 0) return DropCause::kUnexpected;
  if ((s.feature_bits & kFeatureRedundancy) == 0 && repeats_others) return DropCause::kUnexpected;
  const std::uint64_t before = s.commands.newest();
  const DropCause cause =
      s.commands.accept(command.sequence, SequenceWindow::max_leap(s.rate_hz, now_ns - s.last_heard_ns));
  if (cause != DropCause::kNone) return cause;

  s.peer = peer;  // of the newest command: where the station is

  // Spacing by the station's clock: the network's jitter is not in it. Where that clock makes no sense, count
  // ticks.
  const auto elapsed_ns = static_cast<std::int64_t>(command.send_time_ns - s.last_send_time_ns);
  const double ticks = static_cast<double>(before == 0 ? 1 : command.sequence - before);
  const bool clock_usable = before != 0 && elapsed_ns > 0 && elapsed_ns < 10'000'000'000;
  s.spacing_s = clock_usable ? 1e-9 * static_cast<double>(elapsed_ns) : ticks / s.rate_hz;
  s.last_send_time_ns = command.send_time_ns;
  s.missed = command.sequence - before - 1;
  const std::uint64_t leap = command.sequence - before;
  const std::uint64_t older = leap < 64 ? s.steps_before << leap : 0;
  s.steps_before = older | (before != 0 && leap <= 64 ? 1ull << (leap - 1) : 0);
  s.peer_stats.on_command(command.send_time_ns, now_ns, command.newest_reply);
  s.newest_reply = std::max(s.newest_reply, command.newest_reply);
  s.station_energy.update(command.energy_in_j, command.energy_out_j);
  s.used = true;
  s.awaits_first = false;
  s.last_heard_ns = now_ns;
  return DropCause::kNone;
}

SlotState SessionTable::expire_one(std::size_t slot, std::int64_t now_ns) noexcept {
  Session& s = sessions_[slot];
  switch (s.state) {
    case SlotState::kFree:
      break;
    case SlotState::kActive: {
      const std::int64_t patience_ns =
          s.awaits_first ? std::max(config_.timeout_ns, config_.first_command_ns) : config_.timeout_ns;
      if (now_ns - s.last_heard_ns > patience_ns) {
        // Nothing to resume if not one command came: a Hello repeated by the network, or a station that gave
        // up.
        if (!s.used) {
          release(slot);
        } else {
          set_state(slot, SlotState::kSilent);
          s.state_since_ns = now_ns;
        }
      }
      break;
    }
    case SlotState::kSilent:
      if (now_ns - s.state_since_ns > config_.resume_ns) release(slot);
      break;
    case SlotState::kEnding:
      if (now_ns - s.state_since_ns > config_.ending_ns) release(slot);
      break;
  }
  return s.state;
}

}  // namespace telenano::link
