#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "telenano/common/link/codec.h"

namespace telenano::link {

/// What was decoded, encoded again, without the logged steps of a Command; 0: nothing was.
inline std::size_t encode(Codec& codec, const Incoming& in, std::span<std::uint8_t> out) {
  switch (in.type) {
    case MessageType::kHello:
      return codec.encode(in.hello, out);
    case MessageType::kChallenge:
      return codec.encode(in.challenge, out);
    case MessageType::kWelcome:
      return codec.encode(in.welcome, out);
    case MessageType::kRefuse:
      return codec.encode(in.refuse, out);
    case MessageType::kCommand:
      return codec.encode(in.command, in.recent, out);
    case MessageType::kReply:
      return codec.encode(in.reply, out);
    case MessageType::kBye:
      return codec.encode(in.bye, out);
    case MessageType::kSceneRequest:
      return codec.encode(in.scene_request, out);
    case MessageType::kSceneChunk:
      return codec.encode(in.scene_chunk, out);
    case MessageType::kSnapshotRequest:
      return codec.encode(in.snapshot_request, out);
    case MessageType::kSnapshotPiece:
      return codec.encode(in.snapshot_piece, out);
    case MessageType::kSceneListRequest:
      return codec.encode(in.scene_list_request, out);
    case MessageType::kSceneListEntry:
      return codec.encode(in.scene_list_entry, out);
    case MessageType::kSceneSwitch:
      return codec.encode(in.scene_switch, out);
    case MessageType::kNone:
      break;
  }
  return 0;
}

}  // namespace telenano::link
