#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "telenano/common/link/drop_cause.h"
#include "telenano/common/link/link_quality.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/link/received_energy.h"
#include "telenano/common/link/sequence_window.h"
#include "telenano/common/link/siphash.h"

namespace telenano::link {

/// Where a peer is, as opaque bytes (16 of address, 2 of port): this layer only compares and hashes it. And the
/// channel that it came through, where that is known wherever the peer is (net::Address::channel); 0: none.
struct PeerKey {
  std::array<std::uint8_t, 18> bytes{};
  std::uint64_t channel = 0;
};

/// Is `now` who `before` was? By the channel, which may have come to another address; or by the address, where
/// there may be another channel by now.
constexpr bool is_same_peer(const PeerKey& before, const PeerKey& now) noexcept {
  return (now.channel != 0 && now.channel == before.channel) || now.bytes == before.bytes;
}

/// free → active (Welcome) → silent (time-out; resumable) → free, and active → ending (Bye; not resumable) →
/// free.
enum class SlotState : std::uint8_t { kFree, kActive, kSilent, kEnding };

/// Who opens a session.
struct Opener {
  std::uint64_t owner = 0;  ///< identity of its key; 0 in the clear
  std::uint64_t party = 0;  ///< whom the session counts for
  std::uint8_t rank = 0;    ///< of its right: a lesser one never takes a greater one's place
};

/// One session of the server. `epoch` and `resume_token` belong to the slave and stay over a resume;
/// everything else starts anew with each session id.
struct Session {
  SlotState state = SlotState::kFree;
  std::uint64_t session_id = 0;
  std::uint64_t resume_token = 0;
  std::uint32_t epoch = 0;
  std::uint32_t rate_hz = 0;
  std::uint64_t feature_bits = 0;  ///< agreed
  std::uint64_t wanted_bits = 0;   ///< by the newest Hello: another slave may have others of them
  PeerKey peer;
  std::uint64_t owner = 0;                ///< identity of the key that opened it; nobody else's may use it
  std::uint64_t party = 0;                ///< whom it counts for
  std::uint8_t rank = 0;                  ///< of the right that it was opened or resumed with
  std::array<std::uint64_t, 4> nonces{};  ///< of the Hellos that opened and resumed it, newest first
  SequenceWindow commands;
  std::uint64_t steps_before = 0;       ///< which of the 64 commands before the newest one had been accepted
  std::uint64_t last_send_time_ns = 0;  ///< of the newest command, station clock
  double spacing_s = 0;                 ///< between the two newest commands, by the station's clock
  std::uint64_t missed = 0;             ///< commands between those two that did not come, or not in time
  PeerStats peer_stats;
  std::uint64_t reply_sequence = 0;  ///< of the last reply sent
  std::uint64_t newest_reply = 0;    ///< that the station has seen
  bool used = false;                 ///< a command has come, under this id or one before
  bool awaits_first = false;         ///< none has come since it was opened, or resumed when it was silent
  std::int64_t last_heard_ns = 0;
  std::int64_t state_since_ns = 0;
  ReceivedEnergy station_energy;  ///< J, since the Welcome of this session id
};

struct SessionTableConfig {
  std::size_t capacity = 64;                ///< 1 … kCapacityMax
  std::int64_t timeout_ns = 2'000'000'000;  ///< silence after which a session is silent (its slave retracts)
  /// The same before the first command, if that is more: Welcome and first command take a whole round trip,
  /// which may be longer than the time-out that a scene asks for.
  std::int64_t first_command_ns = 2'000'000'000;
  std::int64_t resume_ns = 30'000'000'000;  ///< how long a silent one can be resumed
  std::int64_t ending_ns =
      2'000'000'000;  ///< how long an ended one keeps its slot, so that its slave can retract
  /// Sessions that one party may have, silent ones included: one key must not take the place of all others.
  std::size_t per_party = kCapacityAny;
  static constexpr std::size_t kCapacityAny = SIZE_MAX;
};

/// The server's sessions: a fixed number of slots, found by session id in constant time (the slot's index is
/// the id's low byte, or its low 12 bits in a table of more than 256 slots; the others cannot be guessed).
class SessionTable {
 public:
  static constexpr std::size_t kNone = SIZE_MAX;
  static constexpr std::size_t kCapacityMax = 4096;

  SessionTable(const SessionTableConfig& config, const SipKey& secret);

  std::size_t capacity() const noexcept { return sessions_.size(); }
  Session& operator[](std::size_t slot) noexcept { return sessions_[slot]; }
  const Session& operator[](std::size_t slot) const noexcept { return sessions_[slot]; }
  std::size_t active() const noexcept { return active_; }
  std::size_t occupied() const noexcept { return occupied_; }  ///< active, silent or ending
  const SessionTableConfig& config() const noexcept { return config_; }

  std::size_t find(std::uint64_t session_id) const noexcept;
  /// The session that this token resumes, if it is `owner`'s.
  std::size_t find_token(std::uint64_t resume_token, std::uint64_t owner = 0) const noexcept;
  /// The session that the same Hello has opened before (its Welcome was lost); `newest` tells whether by its
  /// latest.
  std::size_t find_nonce(const PeerKey& peer, std::uint64_t nonce, bool& newest) const noexcept;

  /// A new session in a free slot, else in place of one that is ending, else of a silent one whose right is
  /// not greater: the least first, and of equals the one that is so longest. A party that has all that it may
  /// have gives up its own one that is silent longest. kNone: all active, or out of reach.
  std::size_t open(const PeerKey& peer, std::uint64_t nonce, std::uint32_t rate_hz, std::int64_t now_ns,
                   const Opener& opener = {}) noexcept;
  /// Could open() do so now?
  bool has_room(const Opener& opener) const noexcept;
  /// The same slave and account under a new session id, perhaps from another address.
  void resume(std::size_t slot, const PeerKey& peer, std::uint64_t nonce, std::uint32_t rate_hz,
              std::int64_t now_ns) noexcept;
  /// Another slave for the same station: a new session id and a new epoch. `nonce`: what asked for it, as a Hello's.
  /// The next command may be as late as after a Welcome.
  void begin_anew(std::size_t slot, std::uint64_t nonce, std::int64_t now_ns) noexcept;
  void end(std::size_t slot,
           std::int64_t now_ns) noexcept;  ///< not resumable; the slot is kept for ending_ns
  void release(std::size_t slot) noexcept { replace(slot, {}); }

  /// Is this command of a known session, from its address and owner, of its epoch, without fields of features
  /// that were not agreed (`repeats_others`: it brings older ones along), and newer than all before, but no
  /// further ahead than the rate explains? If so, accounts for it: sequence, energies, time. `slot` is set as soon
  /// as the session is known.
  DropCause accept(const Command& command, const PeerKey& peer, std::int64_t now_ns, std::size_t& slot,
                   bool repeats_others = false, std::uint64_t owner = 0) noexcept;

  /// Applies the time-outs. Calls `changed(slot, state)` for every session that becomes silent or free.
  template <class Changed>
  void expire(std::int64_t now_ns, Changed&& changed) noexcept {
    for (std::size_t slot = 0; slot < sessions_.size(); ++slot) {
      const SlotState before = sessions_[slot].state;
      if (before == SlotState::kFree) continue;
      const SlotState after = expire_one(slot, now_ns);
      if (after != before) changed(slot, after);
    }
  }

 private:
  void start(std::size_t slot, const PeerKey& peer, std::uint64_t nonce, std::uint32_t rate_hz,
             std::int64_t now_ns) noexcept;
  SlotState expire_one(std::size_t slot, std::int64_t now_ns) noexcept;
  std::size_t place(std::uint8_t rank) const noexcept;
  std::size_t oldest_silent_of(std::uint64_t party) const noexcept;
  bool party_is_full(std::uint64_t party) const noexcept;
  // All changes of state go through these two, which keep the counts.
  void set_state(std::size_t slot, SlotState state) noexcept;
  void replace(std::size_t slot, const Session& session) noexcept;
  std::uint64_t secret_number() noexcept;
  std::uint32_t new_epoch() noexcept;

  SessionTableConfig config_;
  SipKey secret_;
  std::uint64_t counter_ = 0;
  std::uint32_t next_epoch_;
  std::uint64_t slot_mask_;
  std::vector<Session> sessions_;
  std::size_t active_ = 0;
  std::size_t occupied_ = 0;
};

}  // namespace telenano::link
