#include "common/link/wire_scan.h"

#include <array>

namespace telenano::link {
namespace {

constexpr std::array<std::uint8_t, 4> kMagic = {'T', 'L', 'N', 'O'};

// Wire types of Protobuf; 0 stands for "no such field", since no message here has a varint field.
constexpr std::uint8_t kNoField = 0;
constexpr std::uint8_t kF64 = 1;
constexpr std::uint8_t kLen = 2;
constexpr std::uint8_t kF32 = 5;

constexpr std::size_t kMaxFields = 24;
constexpr std::uint8_t kPaddingField = 15;

/// Wire type by field number, as in telenano.proto (the codec's tests hold the two together).
using FieldList = std::array<std::uint8_t, kMaxFields + 1>;

constexpr FieldList kHelloFields = {kNoField, kF32, kF32, kF64, kF64, kF64, kF64, kF32,
                                    0,        0,    0,    0,    0,    0,    0,    kLen};
constexpr FieldList kChallengeFields = {kNoField, kF64, kF64};
constexpr FieldList kWelcomeFields = {kNoField, kF32, kF64, kF64, kF64, kF64, kF32, kF32, kF32,
                                      kLen,     kF64, kF64, kF64, kF64, kF64, kF64, kF64, kF64,
                                      kF64,     kF64, kF64, kF64, kF64, kF64, kF64};
constexpr FieldList kRefuseFields = {kNoField, kF64, kF32, kF32, kF32};
constexpr FieldList kCommandFields = {kNoField, kF64, kF64, kF64, kF64, kF32, kF32, kF64,
                                      kF64,     kF64, kF64, kF64, kF64, kF64, kF64};
constexpr FieldList kReplyFields = {kNoField, kF64, kF64, kF64, kF64, kF64, kF64, kF64, kF32, kF32,
                                    kF32,     kF64, kF64, kF64, kF64, kF64, kF64, kF64, kF64, kF64};
constexpr FieldList kByeFields = {kNoField, kF64, kF32};
constexpr FieldList kNoFields = {};

constexpr std::array<const FieldList*, 8> kFieldsOf = {&kNoFields,      &kHelloFields,  &kChallengeFields,
                                                       &kWelcomeFields, &kRefuseFields, &kCommandFields,
                                                       &kReplyFields,   &kByeFields};

/// Reads a tag or length of one or two bytes (all that the lists need), in its shortest form. False: cut or
/// longer.
bool read_short_varint(std::span<const std::uint8_t> bytes, std::size_t& at, std::uint32_t& value) noexcept {
  if (at >= bytes.size()) return false;
  value = bytes[at++];
  if (value < 0x80) return true;
  if (at >= bytes.size()) return false;
  const std::uint32_t high = bytes[at++];
  if (high >= 0x80 || high == 0) return false;
  value = (value & 0x7fu) | (high << 7);
  return true;
}

/// True if every field is on the list, whole, and there once. `parse_bytes` ends before a Hello's padding.
bool scan_fields(MessageType type, std::span<const std::uint8_t> payload, std::size_t& parse_bytes) noexcept {
  const FieldList& fields = *kFieldsOf[static_cast<std::size_t>(type)];
  std::uint32_t seen = 0;
  std::size_t at = 0;
  parse_bytes = payload.size();
  while (at < payload.size()) {
    const std::size_t field_start = at;
    std::uint32_t tag = 0;
    if (!read_short_varint(payload, at, tag)) return false;
    const std::uint32_t number = tag >> 3;
    const std::uint32_t wire_type = tag & 7u;
    if (number == 0 || number > kMaxFields || fields[number] == kNoField || fields[number] != wire_type)
      return false;
    if ((seen >> number) & 1u) return false;
    seen |= 1u << number;
    std::uint32_t bytes = 8;
    if (wire_type == kF32) bytes = 4;
    if (wire_type == kLen) {
      if (!read_short_varint(payload, at, bytes)) return false;
      if (type == MessageType::kWelcome && bytes > kSceneNameBytes) return false;
      if (type == MessageType::kHello) {
        if (number != kPaddingField || at + bytes != payload.size()) return false;
        parse_bytes = field_start;
      }
    }
    if (payload.size() - at < bytes) return false;
    at += bytes;
  }
  return true;
}

}  // namespace

void write_header(std::span<std::uint8_t, kHeaderBytes> out, MessageType type,
                  std::size_t payload_bytes) noexcept {
  for (std::size_t i = 0; i < kMagic.size(); ++i) out[i] = kMagic[i];
  out[4] = kProtocolVersion;
  out[5] = static_cast<std::uint8_t>(type);
  out[6] = static_cast<std::uint8_t>(payload_bytes & 0xffu);
  out[7] = static_cast<std::uint8_t>(payload_bytes >> 8);
}

DropCause scan(std::span<const std::uint8_t> datagram, WireFrame& frame) noexcept {
  frame = {};
  if (datagram.size() > kMaxDatagramBytes) return DropCause::kOversize;
  if (datagram.size() < kHeaderBytes) return DropCause::kTruncated;
  for (std::size_t i = 0; i < kMagic.size(); ++i) {
    if (datagram[i] != kMagic[i]) return DropCause::kBadMagic;
  }
  const std::uint8_t type_byte = datagram[5];
  const auto type = static_cast<MessageType>(type_byte);
  // Hello and Refuse never change their layout: they are how two versions find out about each other.
  const bool any_version = type == MessageType::kHello || type == MessageType::kRefuse;
  if (datagram[4] != kProtocolVersion && !any_version) return DropCause::kWrongVersion;
  if (type_byte == 0 || type_byte >= kFieldsOf.size()) return DropCause::kUnknownType;
  const std::size_t payload_bytes =
      static_cast<std::size_t>(datagram[6]) | (static_cast<std::size_t>(datagram[7]) << 8);
  const std::size_t behind_header = datagram.size() - kHeaderBytes;
  if (behind_header < payload_bytes) return DropCause::kTruncated;
  if (behind_header > payload_bytes) return DropCause::kBadLength;
  if (type == MessageType::kHello && datagram.size() != kMaxDatagramBytes) return DropCause::kBadLength;
  const auto payload = datagram.subspan(kHeaderBytes);
  std::size_t parse_bytes = 0;
  if (!scan_fields(type, payload, parse_bytes)) return DropCause::kMalformedField;
  frame.type = type;
  frame.payload = payload.first(parse_bytes);
  return DropCause::kNone;
}

}  // namespace telenano::link
