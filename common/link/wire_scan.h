#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "telenano/common/link/drop_cause.h"
#include "telenano/common/link/messages.h"

namespace telenano::link {

/// The 8 bytes before every message: 'T' 'L' 'N' 'O', version, type, payload length (little-endian).
inline constexpr std::size_t kHeaderBytes = 8;
inline constexpr std::size_t kMaxPayloadBytes = kMaxDatagramBytes - kHeaderBytes;

struct WireFrame {
  MessageType type = MessageType::kNone;
  std::span<const std::uint8_t> payload;  ///< what Protobuf may parse: the padding of a Hello is left out
  std::span<const std::uint8_t> recent;  ///< of a Command: its repeated commands, which Protobuf does not see
  std::span<const std::uint8_t> steps;   ///< of a Command, instead of these: its steps (step_log.h), likewise
  std::span<const std::uint8_t> data;    ///< of a SceneChunk: likewise
};

void write_header(std::span<std::uint8_t, kHeaderBytes> out, MessageType type,
                  std::size_t payload_bytes) noexcept;

/// Before the repeated commands of a Command, and before its steps: a tag and a length, 3 or 4 bytes.
inline constexpr std::size_t kRecentTagBytes = 2;

/// Checks a datagram down to the last tag before Protobuf sees it: header, total length, and that every field
/// is one of the message's list, with its wire type, once, and whole. One unknown length-delimited field
/// would make Protobuf allocate twice, and a hostile peer decides what comes.
DropCause scan(std::span<const std::uint8_t> datagram, WireFrame& frame) noexcept;

/// Its two parts: header and length; then the fields of what it has found.
DropCause scan_header(std::span<const std::uint8_t> datagram, WireFrame& frame) noexcept;
DropCause scan_payload(WireFrame& frame) noexcept;
/// True if what begins at `at` of a Command's payload is its repeated commands, or its steps, and the rest of
/// it; then `frame` has their records.
bool take_tail(std::span<const std::uint8_t> payload, std::size_t at, WireFrame& frame) noexcept;

}  // namespace telenano::link
