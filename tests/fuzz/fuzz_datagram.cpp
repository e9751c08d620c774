// Any bytes as a datagram: scanning never reads beyond them, each outcome is one cause or one message, a
// message that is accepted keeps the promises of PROTOCOL.md and comes back the same from our own encoder.
#include <array>
#include <cmath>
#include <memory>

#include "fuzz_input.h"
#include "telenano/common/link/codec.h"
#include "telenano/common/link/wire_scan.h"
#include "tests/support/encode_incoming.h"

namespace telenano::link {
namespace {

using fuzz::Script;

void check_promises(const Incoming& in) {
  switch (in.type) {
    case MessageType::kHello:
      FUZZ_CHECK(in.hello.nonce != 0 && in.hello.version_min >= 1);
      FUZZ_CHECK(in.hello.version_min <= in.hello.version_max);
      break;
    case MessageType::kWelcome:
      FUZZ_CHECK(in.welcome.session_id != 0 && in.welcome.epoch != 0 && in.welcome.timeout_ms != 0);
      FUZZ_CHECK((in.welcome.workspace_min_w_nm.array() <= in.welcome.workspace_max_w_nm.array()).all());
      FUZZ_CHECK(std::isfinite(in.welcome.force_max_nn) && in.welcome.force_max_nn >= 0);
      break;
    case MessageType::kCommand:
      FUZZ_CHECK(in.command.sequence != 0);
      FUZZ_CHECK(telenano::is_finite(in.command.tip_pos_w_nm) &&
                 telenano::is_finite(in.command.tip_vel_w_nm_s));
      FUZZ_CHECK(in.command.energy_in_j >= 0 && in.command.energy_out_j >= 0);
      break;
    case MessageType::kReply:
      FUZZ_CHECK(in.reply.sequence != 0);
      FUZZ_CHECK(telenano::is_finite(in.reply.force_w_nn) && telenano::is_finite(in.reply.tip_pos_w_nm));
      FUZZ_CHECK(in.reply.energy_in_aj >= 0 && in.reply.energy_out_aj >= 0);
      FUZZ_CHECK(is_finite(in.reply.particle) && in.reply.particle.radius_nm >= 0);
      break;
    case MessageType::kSceneChunk:
      FUZZ_CHECK(in.scene_chunk.size >= 1 && in.scene_chunk.size <= kSceneChunkBytes);
      FUZZ_CHECK(in.scene_chunk.session_id != 0 && in.scene_chunk.bundle != 0);
      break;
    default:
      break;
  }
}

}  // namespace
}  // namespace telenano::link

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telenano::link;
  static Codec codec;
  static Incoming first, second;
  const std::span<const std::uint8_t> bytes(data, size);

  WireFrame frame;
  const DropCause scanned = scan(bytes, frame);
  if (scanned == DropCause::kNone) {
    FUZZ_CHECK(size >= kHeaderBytes && size <= kMaxDatagramBytes);
    FUZZ_CHECK(frame.payload.data() >= data && frame.payload.data() + frame.payload.size() <= data + size);
  }
  const DropCause cause = codec.decode(bytes, first);
  FUZZ_CHECK(static_cast<std::size_t>(cause) < kDropCauseCount);
  if (scanned != DropCause::kNone) FUZZ_CHECK(cause == scanned);
  if (cause != DropCause::kNone) {
    FUZZ_CHECK(first.type == MessageType::kNone);
    return 0;
  }
  FUZZ_CHECK(first.type == frame.type);
  check_promises(first);

  // What was accepted can be said again, and then has one form only.
  std::array<std::uint8_t, kMaxDatagramBytes> once{}, twice{};
  const std::size_t n = encode(codec, first, once);
  FUZZ_CHECK(n > 0);
  FUZZ_CHECK(codec.decode({once.data(), n}, second) == DropCause::kNone && second.type == first.type);
  FUZZ_CHECK(encode(codec, second, twice) == n && once == twice);
  return 0;
}
