// What the codec makes of datagrams, for comparing it with another implementation. Standard input: datagrams,
// each after its length in two bytes, little-endian. Standard output: a line for each, its drop cause, and
// where there is none what its message encodes to, in hexadecimal.
#include <array>
#include <cstdio>
#include <vector>

#include "telenano/common/link/codec.h"

namespace {

using namespace telenano::link;

std::size_t encode(Codec& codec, const Incoming& in, std::span<std::uint8_t> out) {
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

}  // namespace

int main() {
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  std::array<std::uint8_t, 2> length{};
  std::vector<std::uint8_t> datagram;
  while (std::fread(length.data(), 1, 2, stdin) == 2) {
    datagram.resize(static_cast<std::size_t>(length[0]) | static_cast<std::size_t>(length[1]) << 8);
    if (std::fread(datagram.data(), 1, datagram.size(), stdin) != datagram.size()) return 1;
    std::printf("%s ", name(codec.decode(datagram, in)));
    const std::size_t size = encode(codec, in, out);
    for (std::size_t i = 0; i < size; ++i) std::printf("%02x", out[i]);
    std::printf("\n");
  }
  return 0;
}
