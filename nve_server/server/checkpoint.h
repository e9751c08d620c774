#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "telenano/nve_server/server/session_port.h"

namespace telenano::server {

/// What a checkpoint must agree on to be taken up: the same description, and physics that make the same bits
/// of it. With other ones the station gets a new session, and so a new epoch.
struct CheckpointOf {
  std::uint64_t scene_hash = 0;
  std::uint64_t physics = 0;
};

/// Whose it is. The token is a secret.
struct CheckpointHead {
  CheckpointOf of;
  std::uint64_t token = 0;
  std::uint64_t owner = 0;  ///< identity of the key that opened the session; 0 in the clear
};

/// Bytes of a session besides its slave's.
inline constexpr std::size_t kCheckpointBytes = 2048;

/// A session as bytes: its slave with marks and account, its epoch, where its log of steps stands, the energy that
/// its side of the port has in hand. Not the ends of its link, which begin anew when it is resumed. Returns the
/// size; 0: `out` is too small, or the slave gives no state away. Does not allocate.
std::size_t write_checkpoint(const CheckpointOf& of, const link::Session& session, const Tip& tip,
                             const SessionRecord& record, std::span<std::uint8_t> out) noexcept;

/// The first look. False for what is no checkpoint.
bool read_checkpoint_head(std::span<const std::uint8_t> bytes, CheckpointHead& head) noexcept;

/// The session, silent, in `slave`, which is a new one of the scene. Bytes may be anybody's: null for what is no
/// checkpoint of `of`, whose slave does not take it up, or comes to another state by it. Allocates, and may
/// throw std::bad_alloc.
std::unique_ptr<SessionState> read_checkpoint(const CheckpointOf& of, std::span<const std::uint8_t> bytes,
                                              std::unique_ptr<slave::Slave> slave);

/// What stands round it in a file.
struct CheckpointEnvelope {
  std::uint64_t written_ms = 0;  ///< UTC
  std::uint64_t number = 0;      ///< CheckpointNote::number
};
inline constexpr std::size_t kEnvelopeBytes = 48;

/// Writes the 40 bytes that go before `payload` in a file, and the 8 that go after it: a sum over all.
void seal(const CheckpointEnvelope& envelope, std::span<const std::uint8_t> payload,
          std::span<std::uint8_t, 40> before, std::span<std::uint8_t, 8> after) noexcept;
/// The payload of a file; empty: it is not whole.
std::span<const std::uint8_t> unseal(std::span<const std::uint8_t> file,
                                     CheckpointEnvelope& envelope) noexcept;

}  // namespace telenano::server
