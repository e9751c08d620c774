#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "telenano/common/link/drop_cause.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/link/recent_commands.h"
#include "telenano/common/link/step_log.h"

namespace telenano::link {

/// One decoded message: `type` says which member was filled; the others keep old values.
struct Incoming {
  MessageType type = MessageType::kNone;
  Hello hello;
  Challenge challenge;
  Welcome welcome;
  Refuse refuse;
  Command command;
  RecentCommands recent;  ///< with the command
  StepBatch steps;        ///< likewise
  Reply reply;
  Bye bye;
  SnapshotRequest snapshot_request;
  SnapshotPiece snapshot_piece;
  SceneRequest scene_request;
  SceneChunk scene_chunk;
  SceneListRequest scene_list_request;
  SceneListEntry scene_list_entry;
  SceneSwitch scene_switch;
};

/// Between structs and datagrams; the only place that sees Protobuf. Its messages are made once and reused:
/// nothing is allocated after construction. One codec a thread.
///
/// encode: writes the whole datagram (header and message) to the front of `out` and returns its size; 0 if
/// `out` is too short (512 bytes are always enough). decode: never trusts the bytes. Answers kNone and fills
/// `incoming`, or says why not and leaves type = kNone.
class Codec {
 public:
  Codec();
  ~Codec();
  Codec(const Codec&) = delete;
  Codec& operator=(const Codec&) = delete;

  std::size_t encode(const Hello& message, std::span<std::uint8_t> out) noexcept;
  std::size_t encode(const Challenge& message, std::span<std::uint8_t> out) noexcept;
  std::size_t encode(const Welcome& message, std::span<std::uint8_t> out) noexcept;
  std::size_t encode(const Refuse& message, std::span<std::uint8_t> out) noexcept;
  std::size_t encode(const Command& message, std::span<std::uint8_t> out) noexcept;
  /// With the commands before it, where kFeatureRedundancy was agreed.
  std::size_t encode(const Command& message, const RecentCommands& recent,
                     std::span<std::uint8_t> out) noexcept;
  /// With steps as StepSender writes them, where kFeatureStepLog was agreed; at most kStepsBytesMost bytes.
  std::size_t encode(const Command& message, std::span<const std::uint8_t> steps,
                     std::span<std::uint8_t> out) noexcept;
  std::size_t encode(const Reply& message, std::span<std::uint8_t> out) noexcept;
  std::size_t encode(const Bye& message, std::span<std::uint8_t> out) noexcept;
  std::size_t encode(const SnapshotRequest& message, std::span<std::uint8_t> out) noexcept;
  std::size_t encode(const SnapshotPiece& message, std::span<std::uint8_t> out) noexcept;
  std::size_t encode(const SceneRequest& message, std::span<std::uint8_t> out) noexcept;
  std::size_t encode(const SceneChunk& message, std::span<std::uint8_t> out) noexcept;
  std::size_t encode(const SceneListRequest& message, std::span<std::uint8_t> out) noexcept;
  std::size_t encode(const SceneListEntry& message, std::span<std::uint8_t> out) noexcept;
  std::size_t encode(const SceneSwitch& message, std::span<std::uint8_t> out) noexcept;

  DropCause decode(std::span<const std::uint8_t> datagram, Incoming& incoming) noexcept;

 private:
  struct Messages;
  std::unique_ptr<Messages> messages_;
};

}  // namespace telenano::link
