#include <algorithm>
#include <array>
#include <cstring>

#include "telenano/common/link/codec.h"
#include "telenano/common/link/codec_messages.h"
#include "telenano/common/link/command_tail.h"
#include "telenano/common/link/flat_fields.h"
#include "telenano/common/link/wire_bytes.h"
#include "telenano/common/link/wire_scan.h"

namespace telenano::link {
namespace {

template <class Wire>
std::size_t write(MessageType type, const Wire& wire, std::span<std::uint8_t> out) noexcept {
  const std::size_t payload_bytes = wire.ByteSizeLong();
  const std::size_t total = kHeaderBytes + payload_bytes;
  if (out.size() < total) return 0;
  write_header(out.first<kHeaderBytes>(), type, payload_bytes);
  wire.SerializeWithCachedSizesToArray(out.data() + kHeaderBytes);
  return total;
}

const RecentCommands kNoRecent;

template <class Message>
std::size_t write_flat(MessageType type, const Message& message, const RecentCommands& recent,
                       std::span<std::uint8_t> out, std::span<const std::uint8_t> steps = {}) noexcept {
  // Where `out` might be too short; and with steps, where fields that no session has together would come to more than
  // a datagram holds.
  std::array<std::uint8_t, kMaxDatagramBytes + 64> apart;
  const bool fits = steps.empty() && out.size() >= kMaxDatagramBytes;
  std::uint8_t* const begin = fits ? out.data() : apart.data();
  FlatWriter writer{begin + kHeaderBytes};
  visit_fields(message, writer);
  AnyBits features;
  visit_feature_fields(message, features);
  if (features.bits != 0) visit_feature_fields(message, writer);
  if (recent.count > 0) write_recent(recent, writer.at);
  if (!steps.empty()) write_steps(steps, writer.at);
  const std::size_t total = static_cast<std::size_t>(writer.at - begin) + recent_field_bytes(recent.count) +
                            steps_field_bytes(steps.size());
  if (total > kMaxDatagramBytes || out.size() < total) return 0;
  write_header(std::span<std::uint8_t, kHeaderBytes>(begin, kHeaderBytes), type, total - kHeaderBytes);
  if (fits) return total;
  std::memcpy(out.data(), begin, total);
  return total;
}

/// Of a message that comes in the usual form only; `data` is its last field, or none.
template <class Message>
std::size_t write_in_order(MessageType type, const Message& m, std::span<std::uint8_t> out,
                           std::uint32_t data_field = 0, std::span<const std::uint8_t> data = {}) noexcept {
  if (out.size() < kMaxDatagramBytes) return 0;
  FlatWriter writer{out.data() + kHeaderBytes};
  visit_fields(m, writer);
  if (!data.empty()) {
    put(writer.at, (data_field << 3) | 2u, 1);
    put_length(writer.at, data.size());
    std::memcpy(writer.at, data.data(), data.size());
  }
  const std::size_t total = static_cast<std::size_t>(writer.at - out.data()) + data.size();
  write_header(out.first<kHeaderBytes>(), type, total - kHeaderBytes);
  return total;
}

/// The bytes of a name, up to its end.
std::span<const std::uint8_t> bytes_of(const SceneName& name) noexcept {
  const auto end = std::find(name.text.begin(), name.text.end(), '\0');
  return {reinterpret_cast<const std::uint8_t*>(name.text.data()),
          static_cast<std::size_t>(end - name.text.begin())};
}

}  // namespace

std::size_t Codec::encode(const Hello& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->hello;
  to_wire(m, w);
  if (out.size() < kMaxDatagramBytes) return 0;
  const std::size_t fields = w.ByteSizeLong();
  write_header(out.first<kHeaderBytes>(), MessageType::kHello, kMaxPayloadBytes);
  w.SerializeWithCachedSizesToArray(out.data() + kHeaderBytes);
  // Padding by hand (field 15, length in two bytes, zeros), so that no string is needed for it.
  std::uint8_t* const tail = out.data() + kHeaderBytes + fields;
  const std::size_t zeros = kMaxPayloadBytes - fields - 3;
  tail[0] = (15u << 3) | 2u;
  tail[1] = static_cast<std::uint8_t>((zeros & 0x7fu) | 0x80u);
  tail[2] = static_cast<std::uint8_t>(zeros >> 7);
  std::memset(tail + 3, 0, zeros);
  return kMaxDatagramBytes;
}

std::size_t Codec::encode(const Challenge& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->challenge;
  to_wire(m, w);
  return write(MessageType::kChallenge, w, out);
}

std::size_t Codec::encode(const Welcome& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->welcome;
  to_wire(m, w);
  const auto& text = m.scene_name.text;
  w.mutable_scene_name()->assign(
      text.data(), static_cast<std::size_t>(std::find(text.begin(), text.end(), '\0') - text.begin()));
  return write(MessageType::kWelcome, w, out);
}

std::size_t Codec::encode(const Refuse& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->refuse;
  to_wire(m, w);
  return write(MessageType::kRefuse, w, out);
}
std::size_t Codec::encode(const Command& m, std::span<std::uint8_t> out) noexcept {
  return write_flat(MessageType::kCommand, m, kNoRecent, out);
}

std::size_t Codec::encode(const Command& m, const RecentCommands& recent,
                          std::span<std::uint8_t> out) noexcept {
  return write_flat(MessageType::kCommand, m, recent, out);
}

std::size_t Codec::encode(const Command& m, std::span<const std::uint8_t> steps,
                          std::span<std::uint8_t> out) noexcept {
  if (steps.size() > kStepsBytesMost) return 0;
  return write_flat(MessageType::kCommand, m, kNoRecent, out, steps);
}

std::size_t Codec::encode(const Reply& m, std::span<std::uint8_t> out) noexcept {
  return write_flat(MessageType::kReply, m, kNoRecent, out);
}

std::size_t Codec::encode(const Bye& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->bye;
  to_wire(m, w);
  return write(MessageType::kBye, w, out);
}
std::size_t Codec::encode(const SnapshotRequest& m, std::span<std::uint8_t> out) noexcept {
  return write_in_order(MessageType::kSnapshotRequest, m, out);
}

std::size_t Codec::encode(const SnapshotPiece& m, std::span<std::uint8_t> out) noexcept {
  if (m.size > kSnapshotPieceBytes) return 0;
  return write_in_order(MessageType::kSnapshotPiece, m, out, kSnapshotPieceData,
                        std::span<const std::uint8_t>(m.data).first(m.size));
}

std::size_t Codec::encode(const SceneListRequest& m, std::span<std::uint8_t> out) noexcept {
  return write_in_order(MessageType::kSceneListRequest, m, out);
}

std::size_t Codec::encode(const SceneListEntry& m, std::span<std::uint8_t> out) noexcept {
  return write_in_order(MessageType::kSceneListEntry, m, out, kSceneListEntrySceneName,
                        bytes_of(m.scene_name));
}

std::size_t Codec::encode(const SceneSwitch& m, std::span<std::uint8_t> out) noexcept {
  return write_in_order(MessageType::kSceneSwitch, m, out);
}

std::size_t Codec::encode(const SceneRequest& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->scene_request;
  to_wire(m, w);
  return write(MessageType::kSceneRequest, w, out);
}

/// Its bytes by hand behind the other fields, as with a Hello's padding.
std::size_t Codec::encode(const SceneChunk& m, std::span<std::uint8_t> out) noexcept {
  auto& w = messages_->scene_chunk;
  to_wire(m, w);
  const std::size_t size = std::min<std::size_t>(m.size, kSceneChunkBytes);
  const std::size_t fields = w.ByteSizeLong();
  const std::size_t total = kHeaderBytes + fields + 1 + length_bytes(size) + size;
  if (size == 0 || out.size() < total) return 0;
  write_header(out.first<kHeaderBytes>(), MessageType::kSceneChunk, total - kHeaderBytes);
  w.SerializeWithCachedSizesToArray(out.data() + kHeaderBytes);
  std::uint8_t* at = out.data() + kHeaderBytes + fields;
  put(at, (kSceneChunkData << 3) | 2u, 1);
  put_length(at, size);
  std::memcpy(at, m.data.data(), size);
  return total;
}

}  // namespace telenano::link
