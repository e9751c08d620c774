#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "telenano/common/net/datagram.h"
#include "telenano/nve_server/nanonis/codec.h"

namespace telenano::afm {

using DeadmanKey = std::array<std::uint8_t, 32>;

/// What the deadman (deploy/afm/deadman.py) on the controller's computer is told of the tip.
enum class DeadmanBeat : std::uint16_t {
  kQuiet,  ///< nothing has moved yet, or there is nobody who would withdraw it: I am no sign of life
  kWatch,  ///< the tip may be out: withdraw it when no heartbeat comes any more
  kDone    ///< it is up and stays up
};
/// What the deadman answers.
enum class DeadmanState : std::uint16_t { kReady, kLatched, kInUse, kNoController };

/// 64 hexadecimal digits and white space after them; nothing else is a key.
std::optional<DeadmanKey> parse_deadman_key(std::string_view text) noexcept;

/// One end of the heartbeats, sans-IO: whole frames go in and come out, on the same connection as the
/// requests that the deadman passes on. The deadman greets each connection with a fresh nonce; a heartbeat
/// bears a number that grows and an HMAC over both nonces, the number and the beat, so that none can be
/// forged, nor used again on another connection or on the same one. Its answer is proved in the same way.
class DeadmanLink {
 public:
  /// `nonce`: new for each process.
  DeadmanLink(const DeadmanKey& key, const std::array<std::uint8_t, 16>& nonce) : key_(key), nonce_(nonce) {}

  /// A new connection: waits for its greeting.
  void restart() noexcept;
  /// True when this was one of the deadman's own frames, and no reply of the controller's.
  bool feed(const nanonis::Header& header, std::span<const std::uint8_t> body);
  /// The next heartbeat. Only once greeted().
  nanonis::Bytes beat(DeadmanBeat what);

  bool greeted() const noexcept { return greeted_; }
  /// The last beat is not answered yet: the next one waits.
  bool waiting() const noexcept { return number_ > answers_; }
  /// A frame of the deadman's that is none, or whose proof is wrong: it has another key, or is none.
  bool broken() const noexcept { return broken_; }
  /// Proved answers on this connection.
  std::uint64_t answers() const noexcept { return answers_; }
  /// To the beat of answers().
  DeadmanState state() const noexcept { return state_; }
  DeadmanBeat answered_beat() const noexcept { return answered_beat_; }
  int silence_ms() const noexcept { return silence_ms_; }

 private:
  void on_greeting(std::span<const std::uint8_t> body) noexcept;
  void on_answer(std::span<const std::uint8_t> body);

  DeadmanKey key_;
  std::array<std::uint8_t, 16> nonce_;
  std::array<std::uint8_t, 16> greeting_{};
  bool greeted_ = false;
  bool broken_ = false;
  std::uint64_t number_ = 0;  // of the last beat
  DeadmanBeat beat_ = DeadmanBeat::kQuiet;
  std::uint64_t answers_ = 0;
  DeadmanBeat answered_beat_ = DeadmanBeat::kQuiet;
  DeadmanState state_ = DeadmanState::kReady;
  int silence_ms_ = 0;
};

/// 16 bytes from the kernel's generator.
std::array<std::uint8_t, 16> fresh_nonce();

/// Before anything else: is there a deadman at that address, has it this key, does it reach the controller,
/// and is it free? Throws UserError, one line that says what to do. Waits for two seconds at most.
void meet_deadman(const net::Address& address, const DeadmanKey& key);

}  // namespace telenano::afm
